// What parallel axes and the scatter matrix share: numbers of points, their colours, ticks, and a canvas in two layers.
// Plotly draws both with WebGL only, which a remote desktop or a virtual machine often lacks.

import { colour } from "./theme.js";

export const FINISHED = 0, NOT_RUN = 10;
export const MOST_MARKS = 4000;  // points above which marks and lines give way to their density
const NO_VALUE = "#8b96a3";  // of a finished point
const STOPS = [[31, 59, 115], [38, 100, 142], [42, 145, 135], [107, 181, 107], [201, 201, 79], [251, 225, 131]];

export function unpacked(packed) {
  if (Array.isArray(packed)) return packed;
  const letters = atob(packed.bdata), bytes = new Uint8Array(letters.length);
  for (let at = 0; at < bytes.length; at += 1) bytes[at] = letters.charCodeAt(at);
  return packed.dtype === "f8" ? new Float64Array(bytes.buffer) : new Int32Array(bytes.buffer);
}

export function pointsOf(figure) {
  return { axes: figure.axes.map(prepare), numbers: unpacked(figure.numbers), outcome: unpacked(figure.outcome) };
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

export function layers(place) {  // the upper one holds what the pointer is at: the lower one takes long to draw
  const [base, over] = ["base", "over"].map((name) => {
    const canvas = document.createElement("canvas");
    canvas.className = name;
    return canvas;
  });
  place.replaceChildren(base, over);
  return { base, over };
}

export function sized(canvas, width, height) {
  const scale = devicePixelRatio || 1, pen = canvas.getContext("2d");
  canvas.width = width * scale;
  canvas.height = height * scale;
  canvas.style.width = `${width}px`;
  canvas.style.height = `${height}px`;
  pen.scale(scale, scale);
  return pen;
}

export function pictureOfCanvas(place) {
  const source = place.querySelector("canvas.base"), copy = document.createElement("canvas");
  [copy.width, copy.height] = [source.width, source.height];
  const pen = copy.getContext("2d");
  pen.fillStyle = colour("--paper");
  pen.fillRect(0, 0, copy.width, copy.height);
  pen.drawImage(source, 0, 0);
  return copy.toDataURL("image/png");
}

function mixed(part) {
  const place = Math.min(Math.max(0.12 + 0.76 * part, 0), 1) * (STOPS.length - 1);
  const below = Math.min(Math.floor(place), STOPS.length - 2), rest = place - below;
  return STOPS[below].map((channel, at) => Math.round(channel + rest * (STOPS[below + 1][at] - channel)));
}

export function shade(part, alpha) {
  return Number.isNaN(part) ? NO_VALUE : `rgba(${mixed(part).join()},${alpha})`;
}

const INKS = Uint32Array.from({ length: 256 }, (_, level) => {  // little-endian: alpha, blue, green, red
  const part = level / 255, [red, green, blue] = mixed(1 - part);
  return ((255 * Math.min(1, 0.06 + part * part)) << 24 | blue << 16 | green << 8 | red) >>> 0;
});

export function pictureOfSums(sums, width, height) {  // logarithmic: single points beside crowds stay visible
  const picture = new OffscreenCanvas(width, height), inside = picture.getContext("2d");
  const pixels = inside.createImageData(width, height), ink = new Uint32Array(pixels.data.buffer);
  const most = Math.log1p(sums.reduce((one, two) => Math.max(one, two), 0)) || 1;
  for (let cell = 0; cell < sums.length; cell += 1) {
    if (sums[cell]) ink[cell] = INKS[Math.round(255 * Math.log1p(sums[cell]) / most)];
  }
  inside.putImageData(pixels, 0, 0);
  return picture;
}

export function text(value) {
  return Number(value.toPrecision(4)).toString().replace("-", "\u2212");
}

export function wordAt(axis, row) {
  const value = axis.values[row];
  return Number.isNaN(value) ? "no value" : axis.words ? axis.words[value] : text(value);
}

export function wordsOf(axes, row) {
  return axes.map((axis) => `${axis.label}: ${wordAt(axis, row)}`);
}

export function ticks({ low, high }, count = 4) {  // about that many round values
  const rough = (high - low) / count, power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 2.5, 5, 10].find((part) => part * power >= rough);
  const found = [];
  for (let at = Math.ceil(low / step - 1e-9); at * step <= high + 1e-9 * step; at += 1) found.push(at * step);
  return found;
}

export function marksOf(axis, count) {
  return axis.words ? axis.words.map((word, place) => [place, word]) : ticks(axis, count).map((value) => [value, text(value)]);
}

export function folded(pen, label, width) {
  const lines = [""];
  for (const word of label.split(" ")) {
    const longer = lines.at(-1) ? `${lines.at(-1)} ${word}` : word;
    if (pen.measureText(longer).width > width && lines.at(-1) && lines.length < 3) lines.push(word);
    else lines[lines.length - 1] = longer;
  }
  return lines;
}

export function redrawWhenResized(place, state) {
  place.watcher?.disconnect();
  place.watcher = new ResizeObserver(() => { if (place.points === state && state.width !== place.clientWidth) state.redraw(); });
  place.watcher.observe(place);
}
