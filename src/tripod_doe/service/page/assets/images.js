// Pictures of figures to keep: always in light colours, as they go into documents.

import { pictureOfCanvas } from "./points_canvas.js";
import { themed } from "./theme.js";

function save(address, name) {
  const link = document.createElement("a");
  link.href = address;
  link.download = name;
  link.click();
}

export async function saveImage(place, figure, format, title) {
  const name = title.toLowerCase().replace(/[^a-z0-9]+/g, "-").replace(/^-|-$/g, "") || "figure";
  if (figure.axes) {
    save(pictureOfCanvas(place), `${name}.png`);
    return;
  }
  const root = document.documentElement;
  root.classList.add("light");
  const layout = themed(figure, { title: { text: title, font: { size: 15 }, x: 0.02 }, margin: { t: 46, l: 70, r: 20, b: 60 } });
  root.classList.remove("light");
  layout.paper_bgcolor = layout.plot_bgcolor = "#ffffff";
  const size = { width: 900, height: 560, scale: format === "png" ? 2 : 1 };
  save(await Plotly.toImage({ data: figure.data, layout }, { format, ...size }), `${name}.${format}`);
}
