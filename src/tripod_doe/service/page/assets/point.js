// One point: how it ended, its numbers, its curves, and the same point simulated again with other values.

import { root } from "./address.js";
import { ask, askJson, complain, post, say } from "./asking.js";
import { settings, themed } from "./theme.js";

const PAUSE = 400;  // ms after the last key
const PREFERRED = ["thrust", "axial_drift_mm", "thrust_amplitude", "friction_power_w"];
let figures = {}, again = {};

// A point by its number, or wherever its values are since the study has grown.
export function askPoint(number, at) {
  const query = new URLSearchParams({ at }), step = document.getElementById("step")?.value;
  if (step) query.set("step", step);
  return askJson(`${location.pathname.replace(/\/$/, "")}/points/${number}?${query}`);
}

export function showPoint(place, answer, { open, close }) {
  [figures, again] = [answer.figures, {}];
  place.innerHTML = answer.html;
  place.hidden = false;
  for (const button of place.querySelectorAll("[data-point]")) button.addEventListener("click", () => open(Number(button.dataset.point)));
  place.querySelector("[data-close]").addEventListener("click", close);
  takeCurves(place);
  takeAgain(place);
  place.scrollIntoView({ block: "nearest" });
}

function takeCurves(place) {
  const list = place.querySelector("#curve");
  if (!list) return;
  if (!list.options.length) return;
  const wanted = PREFERRED.find((name) => figures[name]);
  if (wanted) list.value = wanted;
  list.addEventListener("change", () => drawCurve(place));
  drawCurve(place);
}

function drawCurve(place) {  // as the study has it, and as it was simulated again
  const name = place.querySelector("#curve").value, own = figures[name], fresh = again[name];
  const more = (fresh?.data ?? []).map((trace) => ({
    ...trace, name: `again${trace.name ? `: ${trace.name}` : ""}`, line: { ...trace.line, dash: own ? "dash" : "solid", color: undefined },
    opacity: own && trace.type === "bar" ? 0.6 : 1,
  }));
  const figure = own ?? fresh;
  Plotly.react(place.querySelector("#curve-figure"), [...(own?.data ?? []), ...more], themed(figure, { showlegend: figure.layout.showlegend || more.length > 0 }), settings);
}

function asked(form) {
  const parameters = {};
  for (const field of form.querySelectorAll("[data-parameter]")) {
    const text = field.value.trim();
    if (text !== "") parameters[field.dataset.parameter] = isNaN(text) ? text : Number(text);
  }
  return { scene: form.dataset.scene, parameters };
}

function takeAgain(place) {
  const form = place.querySelector("#again");
  if (!form) return;
  const status = form.querySelector(".status"), button = form.querySelector("[type=submit]");
  let waiting = null, pricing = null, turn = 0;
  form.addEventListener("input", () => {
    turn += 1;
    if (Object.keys(again).length) lay(place, {});  // curves stand beside the values that they are of
    clearTimeout(waiting);
    waiting = setTimeout(async () => {
      pricing?.abort();
      pricing = new AbortController();
      try {
        status.textContent = (await (await post(`${root}/parts/price-of-point`, asked(form), { signal: pricing.signal })).json()).text;
      } catch (error) {
        if (error.name !== "AbortError") status.textContent = error.message;
      }
    }, PAUSE);
  });
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    clearTimeout(waiting);
    pricing?.abort();
    button.disabled = true;
    status.textContent = "Simulating \u2026";
    const submitted = turn;
    try {
      const answer = await (await post(`${root}/parts/simulate`, asked(form))).json();
      if (turn !== submitted) return;
      status.textContent = answer.text;
      lay(place, answer.figures);
    } catch (error) {
      if (turn !== submitted) return;
      status.textContent = error.message;
      lay(place, {});
    } finally {
      button.disabled = false;
    }
  });
  form.closest("details").addEventListener("toggle", async () => {
    const list = form.querySelector("#add-parameter");
    try {
      if (list.options.length < 2) list.innerHTML = await (await ask(`${root}/parts/parameters?scene=${encodeURIComponent(form.dataset.scene)}`)).text();
    } catch (error) {
      complain(error);
    }
  });
  form.querySelector("#add-parameter").addEventListener("change", (event) => {
    const name = event.target.value;
    if (!name || form.querySelector(`[data-parameter="${name}"]`)) return;
    const label = document.createElement("label");
    label.textContent = event.target.selectedOptions[0].textContent;
    const field = document.createElement("input");
    field.dataset.parameter = name;
    field.value = event.target.selectedOptions[0].dataset.default;
    label.append(" ", field);
    form.querySelector(".fields").append(label);
    event.target.value = "";
    field.focus();
    form.dispatchEvent(new Event("input"));
  });
}

function lay(place, fresh) {  // in place of the curves of the values before
  again = fresh;
  const list = place.querySelector("#curve");
  for (const option of [...list.options]) if (!figures[option.value] && !fresh[option.value]) option.remove();
  const known = new Set([...list.options].map((option) => option.value));
  for (const name of Object.keys(fresh)) if (!known.has(name)) list.append(new Option(`${name.replaceAll("_", " ")} (again)`, name));
  place.querySelector(".curves").hidden = !list.options.length;
  if (!list.options.length) return;
  if (!known.size) list.value = PREFERRED.find((name) => fresh[name]) ?? list.options[0].value;
  drawCurve(place);
  if (Object.keys(fresh).length) say("The new curve is drawn beside the old one");
}
