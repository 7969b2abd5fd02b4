// Parallel axes on a canvas: one line per point, their density where lines are too many; marks on axes narrow them down.
// Plotly draws such axes with WebGL only, which a remote desktop or a virtual machine often lacks.

import { colour } from "./theme.js";

const MOST_LINES = 4000, BINS = 120, ROOM = 20, TOP = 44, BOTTOM = 40, SIDE = 56, LEAST = 92, GRIP = 22;
const STOPS = [[31, 59, 115], [38, 100, 142], [42, 145, 135], [107, 181, 107], [201, 201, 79], [251, 225, 131]];
const FINISHED = 0, NOT_RUN = 10;

export function unpacked({ bdata, dtype }) {
  const letters = atob(bdata), bytes = new Uint8Array(letters.length);
  for (let at = 0; at < bytes.length; at += 1) bytes[at] = letters.charCodeAt(at);
  return dtype === "f8" ? new Float64Array(bytes.buffer) : new Int32Array(bytes.buffer);
}

export function drawParallel(place, figure, { chosen, brushed }) {
  const kept = place.parallel?.figure?.axes.map((axis) => axis.name).join() === figure.axes.map((axis) => axis.name).join();
  const state = {
    figure, chosen, brushed, brushes: kept ? place.parallel.brushes : new Map(),
    axes: figure.axes.map(prepare), numbers: unpacked(figure.numbers), outcome: unpacked(figure.outcome),
  };
  place.parallel = state;
  state.canvas = document.createElement("canvas");
  place.replaceChildren(state.canvas);
  state.redraw = () => paint(state, place);
  takePointer(state);
  place.watcher?.disconnect();
  place.watcher = new ResizeObserver(() => { if (place.parallel === state && state.width !== place.clientWidth) state.redraw(); });
  state.redraw();
  place.watcher.observe(place);
}

export function pictureOfParallel(place) {
  const source = place.parallel.canvas;
  const copy = document.createElement("canvas");
  [copy.width, copy.height] = [source.width, source.height];
  const pen = copy.getContext("2d");
  pen.fillStyle = colour("--paper");
  pen.fillRect(0, 0, copy.width, copy.height);
  pen.drawImage(source, 0, 0);
  return copy.toDataURL("image/png");
}

function prepare(axis) {
  const values = unpacked(axis.values);
  let low = Infinity, high = -Infinity;
  for (const value of values) {
    if (value < low) low = value;
    if (value > high) high = value;
  }
  if (!(low <= high)) [low, high] = [0, 1];
  if (low === high) [low, high] = [low - 0.5, high + 0.5];
  return { ...axis, values, low, high };
}

function paint(state, place) {
  const { canvas, axes } = state;
  state.width = place.clientWidth;
  const scale = devicePixelRatio || 1;
  const width = Math.max(place.clientWidth, LEAST * (axes.length - 1) + 2 * SIDE), height = 440;
  canvas.width = width * scale;
  canvas.height = height * scale;
  canvas.style.width = `${width}px`;
  canvas.style.height = `${height}px`;
  const pen = canvas.getContext("2d");
  pen.scale(scale, scale);
  state.left = axes.map((_, at) => (axes.length === 1 ? width / 2 : SIDE + at * (width - 2 * SIDE) / (axes.length - 1)));
  state.bottom = height - BOTTOM;
  const passing = rowsWithin(state);
  if (passing.length > MOST_LINES) paintDensity(pen, state, passing);
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

function mixed(part) {
  const place = Math.min(Math.max(0.12 + 0.76 * part, 0), 1) * (STOPS.length - 1);
  const below = Math.min(Math.floor(place), STOPS.length - 2), rest = place - below;
  return STOPS[below].map((channel, at) => Math.round(channel + rest * (STOPS[below + 1][at] - channel)));
}

function shade(part, alpha) {
  return `rgba(${mixed(part).join()},${alpha})`;
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
    const picture = new OffscreenCanvas(width, height), inside = picture.getContext("2d");
    const pixels = inside.createImageData(width, height), ink = new Uint32Array(pixels.data.buffer);
    const most = Math.log1p(sums.reduce((one, two) => Math.max(one, two)));
    for (let cell = 0; cell < sums.length; cell += 1) {
      if (sums[cell]) ink[cell] = INKS[Math.round(255 * Math.log1p(sums[cell]) / most)];
    }
    inside.putImageData(pixels, 0, 0);
    pen.drawImage(picture, left[at], TOP);
  }
}

const INKS = Uint32Array.from({ length: 256 }, (_, level) => {  // little-endian: alpha, blue, green, red
  const part = level / 255, [red, green, blue] = mixed(1 - part);
  return ((255 * Math.min(1, 0.06 + part * part)) << 24 | blue << 16 | green << 8 | red) >>> 0;
});

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

function text(value) {
  return Number(value.toPrecision(4)).toString().replace("-", "\u2212");
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
  folded(pen, axis.label, LEAST + 10).forEach((line, row, lines) => pen.fillText(line, x, TOP - 12 - 14 * (lines.length - 1 - row)));
  pen.fillStyle = colour("--muted");
  pen.textAlign = "left";
  const marks = axis.words ? axis.words.map((word, place) => [place, word]) : ticks(axis).map((value) => [value, text(value)]);
  for (const [value, word] of marks.slice(0, 12)) write(pen, word, x, heightOf(state, axis, value));
  if (axis.values.some(Number.isNaN)) write(pen, "no value", x, state.bottom + 16);
  const brush = state.brushes.get(at);
  if (!brush) return;
  const [top, bottom] = [heightOf(state, axis, brush[1]), heightOf(state, axis, brush[0])];
  pen.fillStyle = `${colour("--accent")}33`;
  pen.strokeStyle = colour("--accent");
  pen.fillRect(x - 7, top, 14, bottom - top);
  pen.strokeRect(x - 7, top, 14, bottom - top);
}

function ticks({ low, high }) {  // about five round values
  const rough = (high - low) / 4, power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 2.5, 5, 10].find((part) => part * power >= rough);
  const found = [];
  for (let at = Math.ceil(low / step - 1e-9); at * step <= high + 1e-9 * step; at += 1) found.push(at * step);
  return found;
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

function folded(pen, label, width) {
  const lines = [""];
  for (const word of label.split(" ")) {
    const longer = lines.at(-1) ? `${lines.at(-1)} ${word}` : word;
    if (pen.measureText(longer).width > width && lines.at(-1) && lines.length < 2) lines.push(word);
    else lines[lines.length - 1] = longer;
  }
  return lines;
}

function tell(state, count) {
  const total = state.numbers.length;
  const few = count === total ? `${total.toLocaleString("en")} points` : `${count.toLocaleString("en")} of ${total.toLocaleString("en")} points within the marks`;
  state.brushed(`${few}. Drag along an axis to narrow them down, click the axis to clear it, click a line for its point.`);
}

function valueAt(state, axis, height) {
  const part = (state.bottom - height) / (state.bottom - TOP);
  return axis.low + Math.min(Math.max(part, 0), 1) * (axis.high - axis.low);
}

function takePointer(state) {
  let start = null;
  const { canvas } = state;
  const near = (x) => state.left.findIndex((left) => Math.abs(left - x) < GRIP);
  canvas.addEventListener("pointerdown", (event) => {
    start = { at: near(event.offsetX), y: event.offsetY };
    if (start.at >= 0) canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", (event) => {
    canvas.style.cursor = near(event.offsetX) >= 0 ? "ns-resize" : "pointer";
    if (!start || start.at < 0 || Math.abs(event.offsetY - start.y) < 4) return;
    const axis = state.axes[start.at];
    state.brushes.set(start.at, [valueAt(state, axis, start.y), valueAt(state, axis, event.offsetY)].sort((a, b) => a - b));
    state.redraw();
  });
  canvas.addEventListener("pointerup", (event) => {
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

function nearest(state, x, y) {
  const at = state.left.findLastIndex((left) => left <= x);
  if (at < 0 || at + 1 >= state.axes.length) return null;
  const part = (x - state.left[at]) / (state.left[at + 1] - state.left[at]);
  let best = null, least = 12;
  for (const row of rowsWithin(state)) {
    const one = heightOf(state, state.axes[at], state.axes[at].values[row]);
    const two = heightOf(state, state.axes[at + 1], state.axes[at + 1].values[row]);
    const distance = Math.abs(one + part * (two - one) - y);
    if (distance < least) [best, least] = [row, distance];
  }
  return best;
}
