// One point: how it ended, its numbers, its curves, and the same point simulated again with other values.

import { ask, askJson, complain, post, say } from "./asking.js";
import { settings, themed } from "./theme.js";

const PREFERRED = ["thrust", "axial_drift_mm", "thrust_amplitude", "friction_power_w"];
let figures = {};

export async function showPoint(place, explorer, number, { open, close }) {
  const step = document.getElementById("step")?.value;
  let told;
  try {
    told = await askJson(`${location.pathname.replace(/\/$/, "")}/points/${number}${step ? `?step=${encodeURIComponent(step)}` : ""}`);
  } catch (error) {
    complain(error);
    return;
  }
  figures = told.figures;
  place.innerHTML = told.html;
  place.hidden = false;
  for (const button of place.querySelectorAll("[data-point]")) button.addEventListener("click", () => open(Number(button.dataset.point)));
  place.querySelector("[data-close]").addEventListener("click", close);
  takeCurves(place);
  takeAgain(place, explorer);
  place.scrollIntoView({ block: "nearest" });
}

function takeCurves(place) {
  const list = place.querySelector("#curve");
  if (!list) return;
  const wanted = PREFERRED.find((name) => figures[name]);
  if (wanted) list.value = wanted;
  list.addEventListener("change", () => drawCurve(place, list.value));
  drawCurve(place, list.value);
}

function drawCurve(place, name, more = []) {
  const figure = figures[name];
  Plotly.react(place.querySelector("#curve-figure"), [...figure.data, ...more], themed(figure, { showlegend: figure.layout.showlegend || more.length > 0 }), settings);
}

function takeAgain(place, explorer) {
  const form = place.querySelector("#again");
  if (!form) return;
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    const told = form.querySelector(".told"), button = form.querySelector("[type=submit]");
    const asked = {};
    for (const field of form.querySelectorAll("[data-parameter]")) {
      if (field.value.trim() !== "") asked[field.dataset.parameter] = isNaN(field.value) ? field.value.trim() : Number(field.value);
    }
    if (form.dataset.scene !== "joint") asked.scene = form.dataset.scene;
    button.disabled = true;
    told.textContent = "Simulating \u2026";
    try {
      const answer = await (await post("/api/v1/simulate", asked)).json();
      const time = `${answer.cost.cpu_seconds.toPrecision(2)} s of CPU time`;
      told.textContent = answer.outcome === "finished" ? `Finished in ${time}.` : `${answer.outcome}: ${answer.outcome_detail}`;
      lay(place, answer);
    } catch (error) {
      told.textContent = error.message;
    } finally {
      button.disabled = false;
    }
  });
  form.closest("details").addEventListener("toggle", async () => {
    const list = form.querySelector("#add-parameter");
    try {
      if (list.options.length < 2) list.innerHTML = await (await ask(`/parts/parameters?scene=${encodeURIComponent(form.dataset.scene)}`)).text();
    } catch (error) {
      complain(error);
    }
  });
  form.querySelector("#add-parameter").addEventListener("change", (event) => {
    const name = event.target.value;
    if (!name || form.querySelector(`[data-parameter="${name}"]`)) return;
    const label = document.createElement("label");
    label.textContent = name.replaceAll("_", " ");
    const field = document.createElement("input");
    field.dataset.parameter = name;
    field.value = event.target.selectedOptions[0].dataset.default;
    label.append(" ", field);
    form.querySelector(".fields").append(label);
    event.target.value = "";
    field.focus();
  });
}

function lay(place, answer) {
  const list = place.querySelector("#curve"), values = answer[list.value], figure = figures[list.value];
  if (answer.outcome !== "finished" || !Array.isArray(values) || Array.isArray(values[0])) return;
  const { type, x } = figure.data[0];
  drawCurve(place, list.value, [{ type, x, y: values, name: "again", mode: "lines", line: { dash: "dash" } }]);
  say("The new curve is drawn beside the old one");
}
