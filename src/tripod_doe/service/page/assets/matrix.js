// Scatter matrix: every two quantities of the points against each other; a mark drawn in one panel shows in all.

import {
  FINISHED, MOST_MARKS, NOT_RUN, folded, layers, marksOf, pictureOfSums, pointsOf, redrawWhenResized, shade, sized,
} from "./points_canvas.js";
import { colour } from "./theme.js";

const MOST_AXES = 7, LEFT = 58, BOTTOM = 40, TOP = 8, GAP = 10, LEAST = 84, TALLEST = 150, BINS = 48, CLASSES = 20, REACH = 9;

export function drawMatrix(place, figure, { chosen, hovered, describe }) {
  const points = pointsOf(figure), left = points.axes.length - MOST_AXES;
  const axes = left > 0 ? [...points.axes.slice(0, MOST_AXES - 1), points.axes.at(-1)] : points.axes;
  const state = { ...points, ...layers(place), axes, left_out: Math.max(left, 0), chosen, hovered, describe, brush: null };
  place.points = state;
  state.redraw = () => paint(state, place);
  takePointer(state);
  state.redraw();
  redrawWhenResized(place, state);
  return { mark: (number) => mark(state, number) };
}

function paint(state, place) {
  const count = state.axes.length;
  state.width = place.clientWidth;
  state.across = Math.max((place.clientWidth - LEFT - GAP) / count, LEAST);
  state.up = Math.min(Math.max(state.across * 0.75, LEAST), TALLEST);
  const width = LEFT + count * state.across + GAP, height = TOP + count * state.up + BOTTOM;
  const pen = sized(state.base, width, height);
  state.upper = sized(state.over, width, height);
  place.style.height = `${height + 4}px`;
  state.inside = rowsInside(state);
  for (let row = 0; row < count; row += 1) {
    for (let column = 0; column <= row; column += 1) {
      if (row === column) paintSpread(pen, state, row);
      else paintPanel(pen, state, panelAt(state, column, row));
    }
  }
  paintTicks(pen, state);
  tell(state);
}

function panelAt(state, column, row) {
  return {
    column, row, x: LEFT + column * state.across, y: TOP + row * state.up, width: state.across - GAP, height: state.up - GAP,
  };
}

function part(axis, value) {
  return (value - axis.low) / (axis.high - axis.low);
}

function rowsInside({ brush, axes, numbers }) {  // null: no mark is drawn
  if (!brush) return null;
  const [one, two] = [axes[brush.column].values, axes[brush.row].values];
  const found = new Uint8Array(numbers.length);
  for (let row = 0; row < found.length; row += 1) {
    found[row] = one[row] >= brush.x[0] && one[row] <= brush.x[1] && two[row] >= brush.y[0] && two[row] <= brush.y[1];
  }
  return found;
}

function frameOf(pen, panel) {
  pen.strokeStyle = colour("--line");
  pen.lineWidth = 1;
  pen.strokeRect(panel.x + 0.5, panel.y + 0.5, panel.width, panel.height);
}

function placeIn(state, panel, point) {
  const across = part(state.axes[panel.column], state.axes[panel.column].values[point]);
  const up = part(state.axes[panel.row], state.axes[panel.row].values[point]);
  return [panel.x + 4 + across * (panel.width - 8), panel.y + panel.height - 4 - up * (panel.height - 8)];
}

function paintPanel(pen, state, panel) {
  frameOf(pen, panel);
  if (state.numbers.length > MOST_MARKS) paintDensity(pen, state, panel);
  else paintMarks(pen, state, panel);
  if (state.brush?.column !== panel.column || state.brush.row !== panel.row) return;
  const { x, y } = state.brush, [one, two] = [state.axes[panel.column], state.axes[panel.row]];
  const left = panel.x + 4 + part(one, x[0]) * (panel.width - 8), top = panel.y + panel.height - 4 - part(two, y[1]) * (panel.height - 8);
  pen.fillStyle = `${colour("--accent")}22`;
  pen.strokeStyle = colour("--accent");
  const size = [part(one, x[1]) - part(one, x[0]), part(two, y[1]) - part(two, y[0])];
  pen.fillRect(left, top, size[0] * (panel.width - 8), size[1] * (panel.height - 8));
  pen.strokeRect(left, top, size[0] * (panel.width - 8), size[1] * (panel.height - 8));
}

function paintMarks(pen, state, panel) {
  const last = state.axes.at(-1), size = state.numbers.length < 500 ? 2.6 : 1.8;
  const [faint, bad, waiting] = [colour("--grid"), colour("--bad"), colour("--axis")];
  for (let point = 0; point < state.numbers.length; point += 1) {
    const [x, y] = placeIn(state, panel, point), outcome = state.outcome[point];
    if (!Number.isFinite(x + y)) continue;
    const out = state.inside && !state.inside[point];
    pen.beginPath();
    if (outcome === FINISHED) {
      pen.fillStyle = out ? faint : shade(part(last, last.values[point]), 0.85);
      pen.arc(x, y, size, 0, 7);
      pen.fill();
    } else {
      pen.strokeStyle = out ? faint : outcome === NOT_RUN ? waiting : bad;
      for (const turn of [1, -1]) {
        pen.moveTo(x - size, y - turn * size);
        pen.lineTo(x + size, y + turn * size);
      }
      pen.stroke();
    }
  }
}

function paintDensity(pen, state, panel) {
  const sums = new Float64Array(BINS * BINS), [one, two] = [state.axes[panel.column], state.axes[panel.row]];
  for (let point = 0; point < state.numbers.length; point += 1) {
    if (state.inside && !state.inside[point]) continue;
    const [across, up] = [part(one, one.values[point]), part(two, two.values[point])];
    if (!(across + up >= 0)) continue;
    const [x, y] = [across, up].map((place) => Math.min(BINS - 1, Math.floor(place * BINS)));
    sums[(BINS - 1 - y) * BINS + x] += 1;
  }
  pen.imageSmoothingEnabled = false;
  pen.drawImage(pictureOfSums(sums, BINS, BINS), panel.x + 4, panel.y + 4, panel.width - 8, panel.height - 8);
}

function paintSpread(pen, state, at) {  // on the diagonal: how the values of one quantity are spread, and its name
  const panel = panelAt(state, at, at), axis = state.axes[at], sums = new Float64Array(CLASSES), kept = new Float64Array(CLASSES);
  for (let point = 0; point < axis.values.length; point += 1) {
    const place = Math.min(CLASSES - 1, Math.floor(part(axis, axis.values[point]) * CLASSES));
    if (!(place >= 0)) continue;
    sums[place] += 1;
    if (!state.inside || state.inside[point]) kept[place] += 1;
  }
  const most = Math.max(...sums, 1), wide = (panel.width - 8) / CLASSES, room = panel.height - 30;
  for (const [counts, ink] of [[sums, colour("--grid")], [kept, `${colour("--accent")}66`]]) {
    pen.fillStyle = ink;
    counts.forEach((count, place) => {
      const high = count / most * room;
      pen.fillRect(panel.x + 4 + place * wide, panel.y + panel.height - 1 - high, wide - 1, high);
    });
  }
  frameOf(pen, panel);
  pen.fillStyle = colour("--ink");
  pen.font = `600 12px ${getComputedStyle(document.body).fontFamily}`;
  pen.textAlign = "center";
  folded(pen, axis.label, panel.width - 6).forEach((line, row) => pen.fillText(line, panel.x + panel.width / 2, panel.y + 15 + 14 * row));
}

function paintTicks(pen, state) {
  pen.fillStyle = colour("--muted");
  pen.font = `11px ${getComputedStyle(document.body).fontFamily}`;
  state.axes.forEach((axis, at) => {
    const panel = panelAt(state, at, state.axes.length - 1), beside = panelAt(state, 0, at);
    const marks = marksOf(axis, 2).slice(0, 8);
    pen.textAlign = "center";
    for (const [value, word] of marks) pen.fillText(word, panel.x + 4 + part(axis, value) * (panel.width - 8), panel.y + panel.height + 15);
    if (at === 0) return;
    pen.textAlign = "right";
    for (const [value, word] of marks) pen.fillText(word, LEFT - 6, beside.y + beside.height - part(axis, value) * (beside.height - 8));
  });
}

function tell(state) {
  const total = state.numbers.length, count = state.inside ? state.inside.reduce((sum, one) => sum + one, 0) : total;
  const few = count === total ? `${total.toLocaleString("en")} points` : `${count.toLocaleString("en")} of ${total.toLocaleString("en")} points within the mark`;
  const rest = state.left_out ? ` ${state.left_out} more factors are not drawn.` : "";
  state.describe(`${few}.${rest} Drag a frame in a panel to see its points in all, click a mark for its point.`);
}

function panelUnder(state, x, y) {
  const column = Math.floor((x - LEFT) / state.across), row = Math.floor((y - TOP) / state.up);
  return column >= 0 && row < state.axes.length && column < row ? panelAt(state, column, row) : null;
}

function nearest(state, x, y) {
  const panel = panelUnder(state, x, y);
  let best = null, least = REACH;
  for (let point = 0; panel && point < state.numbers.length; point += 1) {
    const [across, up] = placeIn(state, panel, point), distance = Math.hypot(across - x, up - y);
    if (distance < least) [best, least] = [point, distance];
  }
  return best;
}

function valueAt(axis, place) {
  return axis.low + Math.min(Math.max(place, 0), 1) * (axis.high - axis.low);
}

function brushed(state, panel, start, event) {
  const one = state.axes[panel.column], two = state.axes[panel.row];
  const across = [start.x, event.offsetX].map((x) => valueAt(one, (x - panel.x - 4) / (panel.width - 8)));
  const up = [start.y, event.offsetY].map((y) => valueAt(two, (panel.y + panel.height - 4 - y) / (panel.height - 8)));
  return { column: panel.column, row: panel.row, x: across.sort((a, b) => a - b), y: up.sort((a, b) => a - b) };
}

function takePointer(state) {
  let start = null;
  const { over } = state;
  over.addEventListener("pointerdown", (event) => {
    start = { panel: panelUnder(state, event.offsetX, event.offsetY), x: event.offsetX, y: event.offsetY, moved: false };
    over.setPointerCapture(event.pointerId);
  });
  over.addEventListener("pointermove", (event) => {
    if (!start) {
      const point = nearest(state, event.offsetX, event.offsetY);
      over.style.cursor = point === null ? "crosshair" : "pointer";
      state.hovered(point === null ? null : state.numbers[point]);
      return;
    }
    if (!start.panel || Math.hypot(event.offsetX - start.x, event.offsetY - start.y) < 4) return;
    start.moved = true;
    state.brush = brushed(state, start.panel, start, event);
    state.redraw();
  });
  over.addEventListener("pointerleave", () => state.hovered(null));
  over.addEventListener("pointerup", (event) => {
    const ended = start;
    start = null;
    if (!ended || ended.moved) return;
    const point = nearest(state, event.offsetX, event.offsetY);
    if (point !== null) state.chosen(state.numbers[point]);
    else if (state.brush) {
      state.brush = null;
      state.redraw();
    }
  });
}

function mark(state, number) {
  const { upper, over } = state, point = number === null ? -1 : state.numbers.indexOf(number);
  upper.clearRect(0, 0, over.width, over.height);
  if (point < 0) return false;
  for (let row = 1; row < state.axes.length; row += 1) {
    for (let column = 0; column < row; column += 1) ring(upper, placeIn(state, panelAt(state, column, row), point));
  }
  return true;
}

function ring(pen, [x, y]) {
  if (!Number.isFinite(x + y)) return;
  for (const [ink, width] of [[colour("--paper"), 4], [colour("--ink"), 2]]) {
    [pen.strokeStyle, pen.lineWidth] = [ink, width];
    pen.beginPath();
    pen.arc(x, y, 5.5, 0, 7);
    pen.stroke();
  }
}
