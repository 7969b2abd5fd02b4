// Parallel axes: one line per point, their density where lines are too many; marks on axes narrow them down.

import {
  FINISHED, MOST_MARKS, NOT_RUN, folded, layers, marksOf, pictureOfSums, pointsOf, redrawWhenResized, shade, sized,
} from "./points_canvas.js";
import { colour } from "./theme.js";

const BINS = 120, ROOM = 20, TOP = 44, BOTTOM = 40, SIDE = 56, LEAST = 92, GRIP = 22, HEIGHT = 440;

export function drawParallel(place, figure, { chosen, hovered, describe }) {
  const before = place.points;
  const kept = before?.brushes && names(before.figure) === names(figure);
  const state = { ...pointsOf(figure), ...layers(place), figure, chosen, hovered, describe, brushes: kept ? before.brushes : new Map() };
  place.points = state;
  state.redraw = () => paint(state, place);
  takePointer(state);
  state.redraw();
  redrawWhenResized(place, state);
  return { mark: (number) => mark(state, number) };
}

function names(figure) {
  return figure.axes.map((axis) => axis.name).join();
}

function paint(state, place) {
  const { axes } = state;
  state.width = place.clientWidth;
  const width = Math.max(place.clientWidth, LEAST * (axes.length - 1) + 2 * SIDE);
  const pen = sized(state.base, width, HEIGHT);
  state.upper = sized(state.over, width, HEIGHT);
  state.left = axes.map((_, at) => (axes.length === 1 ? width / 2 : SIDE + at * (width - 2 * SIDE) / (axes.length - 1)));
  state.bottom = HEIGHT - BOTTOM;
  const passing = state.passing = rowsWithin(state);
  if (passing.length > MOST_MARKS) paintDensity(pen, state, passing);
  else paintLines(pen, state, passing);
  axes.forEach((axis, at) => paintAxis(pen, state, axis, at));
  tell(state, passing.length);
}

function heightOf(state, axis, value) {
  if (Number.isNaN(value)) return state.bottom + 16;
  return state.bottom - (value - axis.low) / (axis.high - axis.low) * (state.bottom - TOP);
}

function rowsWithin({ axes, brushes, numbers }) {
  const limits = [...brushes].map(([at, limit]) => [axes[at].values, ...limit]);
  const found = [];
  for (let row = 0; row < numbers.length; row += 1) {
    if (limits.every(([values, low, high]) => values[row] >= low && values[row] <= high)) found.push(row);
  }
  return found;
}

function paintLines(pen, state, rows) {
  const { axes, outcome, left } = state;
  const last = axes[axes.length - 1];
  const alpha = Math.min(0.9, 0.25 + 60 / Math.max(rows.length, 1));
  pen.lineWidth = rows.length < 300 ? 1.4 : 1;
  for (const row of rows) {
    const bad = outcome[row] !== FINISHED;
    pen.setLineDash(bad ? [5, 4] : []);
    pen.strokeStyle = !bad ? shade((last.values[row] - last.low) / (last.high - last.low), alpha)
      : outcome[row] === NOT_RUN ? colour("--axis") : "#b5532a";
    pen.beginPath();
    axes.forEach((axis, at) => pen.lineTo(left[at], heightOf(state, axis, axis.values[row])));
    pen.stroke();
  }
  pen.setLineDash([]);
}

function paintDensity(pen, state, rows) {  // lines are added up pixel by pixel: a stroke for each would take seconds
  const { axes, left } = state;
  const height = state.bottom - TOP + ROOM;
  for (let at = 0; at + 1 < axes.length; at += 1) {
    const width = Math.round(left[at + 1] - left[at]);
    const sums = addedLines(pairCounts(axes[at], axes[at + 1], rows), width, height);
    pen.drawImage(pictureOfSums(sums, width, height), left[at], TOP);
  }
}

function pairCounts(one, two, rows) {  // of the classes that lines join, the last one for points without a value
  const counts = new Float64Array((BINS + 1) ** 2);
  const bin = (axis, row) => {
    const value = axis.values[row];
    return Number.isNaN(value) ? BINS : Math.min(BINS - 1, Math.floor((value - axis.low) / (axis.high - axis.low) * BINS));
  };
  for (const row of rows) counts[bin(one, row) * (BINS + 1) + bin(two, row)] += 1;
  return counts;
}

function addedLines(counts, width, height) {
  const sums = new Float64Array(width * height), span = height - ROOM;
  const middle = (place) => (place === BINS ? span + ROOM - 4 : span - (place + 0.5) / BINS * span);
  for (let cell = 0; cell < counts.length; cell += 1) {
    if (!counts[cell]) continue;
    const start = middle(Math.floor(cell / (BINS + 1))), slope = (middle(cell % (BINS + 1)) - start) / width;
    for (let x = 0; x < width; x += 1) sums[Math.floor(start + slope * (x + 0.5)) * width + x] += counts[cell];
  }
  return sums;
}

function paintAxis(pen, state, axis, at) {
  const x = state.left[at];
  pen.strokeStyle = colour("--rule");
  pen.lineWidth = 1.5;
  pen.beginPath();
  pen.moveTo(x, TOP);
  pen.lineTo(x, state.bottom);
  pen.stroke();
  pen.fillStyle = colour("--ink");
  pen.font = `12px ${getComputedStyle(document.body).fontFamily}`;
  pen.textAlign = "center";
  const room = state.left.length > 1 ? state.left[1] - state.left[0] - 6 : 2 * SIDE;
  folded(pen, axis.label, room).forEach((line, row, lines) => pen.fillText(line, x, TOP - 12 - 14 * (lines.length - 1 - row)));
  pen.fillStyle = colour("--muted");
  pen.textAlign = "left";
  for (const [value, word] of marksOf(axis).slice(0, 12)) write(pen, word, x, heightOf(state, axis, value));
  if (axis.values.some(Number.isNaN)) write(pen, "no value", x, state.bottom + 16);
  const brush = state.brushes.get(at);
  if (!brush) return;
  const [top, bottom] = [heightOf(state, axis, brush[1]), heightOf(state, axis, brush[0])];
  pen.fillStyle = `${colour("--accent")}33`;
  pen.strokeStyle = colour("--accent");
  pen.fillRect(x - 7, top, 14, bottom - top);
  pen.strokeRect(x - 7, top, 14, bottom - top);
}

function write(pen, word, x, y) {  // on lines, so with a rim of paper
  pen.strokeStyle = colour("--paper");
  pen.lineWidth = 3;
  pen.beginPath();
  pen.strokeText(word, x + 6, y + 4);
  pen.fillText(word, x + 6, y + 4);
  pen.beginPath();
  pen.strokeStyle = colour("--rule");
  pen.lineWidth = 1.5;
  pen.moveTo(x, y);
  pen.lineTo(x + 4, y);
  pen.stroke();
}

function tell(state, count) {
  const total = state.numbers.length;
  const few = count === total ? `${total.toLocaleString("en")} points` : `${count.toLocaleString("en")} of ${total.toLocaleString("en")} points within the marks`;
  state.describe(`${few}. Drag along an axis to narrow them down, click the axis to clear it, click a line for its point.`);
}

function valueAt(state, axis, height) {
  const part = (state.bottom - height) / (state.bottom - TOP);
  return axis.low + Math.min(Math.max(part, 0), 1) * (axis.high - axis.low);
}

function takePointer(state) {
  let start = null;
  const { over } = state;
  const near = (x) => state.left.findIndex((left) => Math.abs(left - x) < GRIP);
  over.addEventListener("pointerdown", (event) => {
    start = { at: near(event.offsetX), y: event.offsetY };
    if (start.at >= 0) over.setPointerCapture(event.pointerId);
  });
  over.addEventListener("pointermove", (event) => {
    over.style.cursor = near(event.offsetX) >= 0 ? "ns-resize" : "pointer";
    if (!start && near(event.offsetX) < 0) hover(state, event);
    if (!start || start.at < 0 || Math.abs(event.offsetY - start.y) < 4) return;
    const axis = state.axes[start.at];
    state.brushes.set(start.at, [valueAt(state, axis, start.y), valueAt(state, axis, event.offsetY)].sort((a, b) => a - b));
    state.redraw();
  });
  over.addEventListener("pointerleave", () => state.hovered(null));
  over.addEventListener("pointerup", (event) => {
    if (!start) return;
    const { at, y } = start;
    start = null;
    if (at >= 0 && Math.abs(event.offsetY - y) < 4) {
      state.brushes.delete(at);
      state.redraw();
    } else if (at < 0) {
      const row = nearest(state, event.offsetX, event.offsetY);
      if (row !== null) state.chosen(state.numbers[row]);
    }
  });
}

function hover(state, event) {
  const row = nearest(state, event.offsetX, event.offsetY);
  state.hovered(row === null ? null : state.numbers[row]);
}

function mark(state, number) {
  const { upper, over, axes, left } = state, row = number === null ? -1 : state.numbers.indexOf(number);
  upper.clearRect(0, 0, over.width, over.height);
  if (row < 0) return false;
  const path = () => {
    upper.beginPath();
    axes.forEach((axis, at) => upper.lineTo(left[at], heightOf(state, axis, axis.values[row])));
    upper.stroke();
  };
  [upper.strokeStyle, upper.lineWidth] = [colour("--paper"), 6];
  path();
  [upper.strokeStyle, upper.lineWidth] = [colour("--ink"), 2.5];
  path();
  return true;
}

function nearest(state, x, y) {
  const at = state.left.findLastIndex((left) => left <= x);
  if (at < 0 || at + 1 >= state.axes.length) return null;
  const part = (x - state.left[at]) / (state.left[at + 1] - state.left[at]);
  let best = null, least = 12;
  for (const row of state.passing) {
    const one = heightOf(state, state.axes[at], state.axes[at].values[row]);
    const two = heightOf(state, state.axes[at + 1], state.axes[at + 1].values[row]);
    const distance = Math.abs(one + part * (two - one) - y);
    if (distance < least) [best, least] = [row, distance];
  }
  return best;
}
