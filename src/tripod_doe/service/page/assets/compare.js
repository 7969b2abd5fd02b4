// A measurement laid over a point of a study.

import { root } from "./address.js";
import { post, textOf } from "./asking.js";
import { settings, themed, themedData, whenThemeChanges } from "./theme.js";

const form = document.getElementById("controls");
let figures = null;

function draw() {
  if (!figures) return;
  for (const [id, figure] of [["waveform", figures.waveform], ["orders", figures.orders]]) {
    Plotly.react(document.getElementById(id), themedData(figure), themed(figure, { showlegend: true, height: id === "waveform" ? 380 : 300 }), settings);
  }
}

form?.addEventListener("submit", async (event) => {
  event.preventDefault();
  const complaint = document.getElementById("complaint"), button = form.querySelector("[type=submit]");
  const angle = document.getElementById("angle").value.trim(), speeds = document.getElementById("speeds").value.trim();
  const select = [...form.querySelectorAll("[data-select]")].filter((field) => field.value !== "")
    .map((field) => `${field.dataset.select}=${field.value}`);
  complaint.textContent = "";
  button.disabled = true;
  try {
    const answer = await (await post(`${root}/parts/runs/${document.getElementById("run").value}/compare`, {
      measurement: await textOf(document.getElementById("table").files[0]), select, nearest: true,
      pulses_per_revolution: Number(document.getElementById("pulses").value),
      reference_angle: angle === "" ? null : Number(angle), speeds: speeds || null,
    })).json();
    const findings = document.getElementById("findings");
    findings.innerHTML = answer.html;
    document.getElementById("table-of-orders").replaceChildren(findings.querySelector("template").content);
    figures = answer.figures;
    draw();
  } catch (error) {
    complaint.textContent = error.message;
  } finally {
    button.disabled = false;
  }
});
document.getElementById("run")?.addEventListener("change", (event) => location.assign(`${root}/compare?run=${event.target.value}`));
whenThemeChanges(draw);
