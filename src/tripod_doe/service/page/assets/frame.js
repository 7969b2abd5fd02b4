// One figure in its place, whatever draws it; the point under the pointer is marked in all frames of the page.

import { drawMatrix } from "./matrix.js";
import { drawParallel } from "./parallel.js";
import { wordsOf, unpacked } from "./points_canvas.js";
import { settings, themed, themedData } from "./theme.js";

export function makeFrame(place, { chosen, hovered, describe }) {
  const ring = Object.assign(document.createElement("div"), { className: "ring", hidden: true });
  const tip = Object.assign(document.createElement("div"), { className: "tip", hidden: true });
  place.after(ring, tip);
  const state = { figure: null, canvas: null, places: null };

  async function draw(figure) {
    const before = state.figure;
    state.figure = figure;
    state.places = null;
    ring.hidden = tip.hidden = true;
    place.classList.toggle("parallel", Boolean(figure.axes));
    if (figure.axes || before?.axes) Plotly.purge(place);
    if (figure.axes) {
      state.canvas = (figure.matrix ? drawMatrix : drawParallel)(place, figure, { chosen, hovered: pointed, describe });
    } else {
      await drawPlot(figure, before);
      describe(figure.note || "");
    }
    place.dataset.drawn = String(Number(place.dataset.drawn || 0) + 1);
  }

  async function drawPlot(figure, before) {
    if (before?.axes) {
      place.points = null;
      place.style.height = "";
      place.replaceChildren();
    }
    state.canvas = null;
    await Plotly.react(place, themedData(figure), themed(figure), settings);
    for (const name of ["plotly_click", "plotly_hover", "plotly_unhover"]) place.removeAllListeners?.(name);
    place.on("plotly_click", (event) => { const number = numberOf(event); if (number !== null) chosen(number); });
    place.on("plotly_hover", (event) => hovered(numberOf(event)));
    place.on("plotly_unhover", () => hovered(null));
  }

  function pointed(number) {
    hovered(number);
    const points = place.points, row = number === null ? -1 : points.numbers.indexOf(number);
    tip.hidden = row < 0;
    if (row >= 0) tip.innerText = wordsOf(points.axes, row).join("\n");
  }

  place.addEventListener("pointermove", (event) => {
    if (tip.hidden) return;
    const box = place.getBoundingClientRect(), x = event.clientX - box.left, y = event.clientY - box.top;
    tip.style.left = `${Math.min(x + 16, box.width - tip.offsetWidth - 4)}px`;
    tip.style.top = `${Math.max(y - tip.offsetHeight - 10, 0)}px`;
  });

  function mark(number) {
    if (state.canvas) return state.canvas.mark(number);
    const found = number === null || !state.figure ? null : (state.places ??= placesOf(state.figure)).get(number);
    const layout = place._fullLayout;
    ring.hidden = !found || !layout?.xaxis;
    if (ring.hidden) return false;
    const across = layout.xaxis, up = found.foot ? layout.yaxis2 : layout.yaxis;
    ring.style.left = `${across._offset + across.d2p(found.x)}px`;
    ring.style.top = `${up._offset + up.d2p(found.y)}px`;
    return true;
  }

  return { draw, mark, get figure() { return state.figure; } };
}

function numberOf(event) {
  const number = event.points[0].customdata;
  return Number.isInteger(number) && number >= 0 ? number : null;
}

function placesOf(figure) {  // where each point is drawn, by its number
  const found = new Map();
  for (const trace of figure.data) {
    if (!trace.customdata) continue;
    const numbers = unpacked(trace.customdata), x = unpacked(trace.x), y = unpacked(trace.y);
    const foot = trace.yaxis === "y2", cells = trace.type === "heatmap";
    for (let at = 0; at < numbers.length; at += 1) {
      if (found.has(numbers[at])) continue;
      const place = cells ? { x: middle(x, at % (x.length - 1)), y: middle(y, Math.floor(at / (x.length - 1))) } : { x: x[at], y: y[at], foot };
      if (!Number.isNaN(place.y)) found.set(numbers[at], place);
    }
  }
  return found;
}

function middle(edges, at) {
  return (edges[at] + edges[at + 1]) / 2;
}
