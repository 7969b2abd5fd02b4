// Colours of figures, taken from the style sheet, so that they follow light and dark.

const series = ["--series-1", "--series-2", "--series-3", "--series-4", "--series-5", "--series-6"];

export function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

export function template() {
  const axis = {
    gridcolor: colour("--grid"), linecolor: colour("--axis"), tickcolor: colour("--axis"), zeroline: true,
    zerolinecolor: colour("--line"), zerolinewidth: 1, showline: true, ticks: "outside", ticklen: 4,
    title: { font: { size: 13 }, standoff: 10 },
  };
  return {
    layout: {
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", colorway: series.map(colour),
      font: { family: getComputedStyle(document.body).fontFamily, size: 12.5, color: colour("--ink") },
      margin: { l: 64, r: 16, t: 12, b: 52 }, hovermode: "closest", xaxis: axis, yaxis: axis, bargap: 0.25,
      hoverlabel: { bgcolor: colour("--paper"), bordercolor: colour("--rule"), font: { color: colour("--ink"), size: 13 } },
      legend: { font: { size: 12.5 }, title: { font: { size: 12.5 } } }, modebar: {
        bgcolor: "rgba(0,0,0,0)", color: colour("--muted"), activecolor: colour("--accent"),
      },
    },
  };
}

export const settings = {
  displaylogo: false, responsive: true,
  modeBarButtonsToRemove: ["toImage", "select2d", "lasso2d", "autoScale2d", "sendDataToCloud"],
};

export function themed(figure, more = {}) {
  const layout = { ...figure.layout, template: template(), ...more };
  if (layout.showlegend && innerWidth < 700) layout.legend = { ...layout.legend, orientation: "h", y: -0.25 };
  return layout;
}

const LEAST = 3;  // contrast of a line with its paper

function channels(hex) {
  return [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16));
}

function luminance(rgb) {
  const [red, green, blue] = rgb.map((c) => (c / 255 <= 0.04045 ? c / 255 / 12.92 : ((c / 255 + 0.055) / 1.055) ** 2.4));
  return 0.2126 * red + 0.7152 * green + 0.0722 * blue;
}

export function contrast(a, b) {
  const [low, high] = [luminance(a), luminance(b)].sort((x, y) => x - y);
  return (high + 0.05) / (low + 0.05);
}

// A colour made darker, or on dark paper lighter, until a line of it is seen: scales are dark at one end and light at the
// other. Its hue stays, by which lines are told apart.
export function legible(hex, paper = colour("--paper")) {
  if (!/^#[0-9a-f]{6}$/i.test(hex ?? "")) return hex;
  const ground = channels(paper), dark = luminance(ground) < 0.2;
  let now = channels(hex);
  for (let step = 0; contrast(now, ground) < LEAST && step < 40; step++) now = now.map((c) => (dark ? c + 0.06 * (255 - c) : 0.95 * c));
  return `#${now.map((c) => Math.round(c).toString(16).padStart(2, "0")).join("")}`;
}

export function themedData(figure) {
  return figure.data.map((trace) => {
    const one = { ...trace };
    if (typeof trace.line?.color === "string") one.line = { ...trace.line, color: legible(trace.line.color) };
    if (typeof trace.marker?.color === "string") one.marker = { ...trace.marker, color: legible(trace.marker.color) };
    return one;
  });
}

export function whenThemeChanges(redraw) {
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
}
