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

export function whenThemeChanges(redraw) {
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
}
