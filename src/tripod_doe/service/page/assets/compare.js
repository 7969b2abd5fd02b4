// Measurements laid over points of a study: a preview of the first file, an overview, one of them in full.

import { root } from "./address.js";
import { post, textOf } from "./asking.js";
import { settings, themed, themedData, whenThemeChanges } from "./theme.js";

const form = document.getElementById("controls"), at = (id) => document.getElementById(id);
const meanings = { thrust_n: "Force", rotation_deg: "Rotation angle", time_s: "Time", tacho: "Tachometer" };
let figures = null, answers = [], guessed = {}, turn = 0;  // of the fields: an answer to what they said before is dropped

function draw() {
  if (!figures) return;
  for (const [id, figure] of [["waveform", figures.waveform], ["orders", figures.orders]]) {
    Plotly.react(at(id), themedData(figure), themed(figure, { showlegend: true, height: id === "waveform" ? 380 : 300 }), settings);
  }
}

function element(name, text = "", attributes = {}) {
  const made = Object.assign(document.createElement(name), attributes);
  if (text) made.textContent = text;
  return made;
}

function table(heads, rows) {
  const made = element("table"), head = element("thead"), body = element("tbody"), top = element("tr");
  top.append(...heads.map((text) => element("th", text)));
  head.append(top);
  for (const cells of rows) {
    const row = element("tr");
    row.append(...cells.map((cell) => { const made = element("td"); made.append(cell); return made; }));
    body.append(row);
  }
  made.append(head, body);
  return made;
}

function clear() {  // results stand beside nothing else than what they are of
  figures = null;
  turn += 1;
  for (const id of ["waveform", "orders"]) Plotly.purge(at(id));
  for (const id of ["overview", "findings", "table-of-orders"]) at(id).replaceChildren();
}

// The beginning of the first file, and a field for each column.
async function preview() {
  const file = at("table").files[0];
  clear();
  for (const id of ["preview", "columns"]) at(id).replaceChildren();
  at("complaint").textContent = "";
  guessed = {};
  if (!file) return;
  try {
    const lines = (await textOf(file)).split("\n").slice(0, 400).join("\n");
    const seen = await (await post(`${root}/parts/compare/preview`, { measurement: lines })).json();
    guessed = seen.columns;
    at("preview").append(element("p", [file.name, ...seen.notes].join(" · "), { className: "meaning" }), table(seen.headings, seen.rows));
    for (const role of seen.roles) {
      const label = element("label", `${meanings[role]} `), field = element("select", "", { id: `column-${role}` });
      field.dataset.column = role;
      field.append(new Option("none", ""), ...seen.headings.map((heading) => new Option(heading, heading)));
      field.value = guessed[role] ?? "";
      label.append(field);
      at("columns").append(label);
    }
    at("complaint").textContent = seen.complaint;
  } catch (error) {
    at("complaint").textContent = error.message;
  }
}

function request(measurement) {
  const angle = at("angle").value.trim(), speeds = at("speeds").value.trim(), pulses = at("pulses").value.trim();
  const chosen = [...form.querySelectorAll("[data-column]")].filter((field) => field.value !== (guessed[field.dataset.column] ?? ""));
  return {
    measurement, nearest: true,
    select: [...form.querySelectorAll("[data-select]")].filter((field) => field.value !== "").map((field) => `${field.dataset.select}=${field.value}`),
    columns: Object.fromEntries(chosen.map((field) => [field.dataset.column, field.value])),
    pulses_per_revolution: pulses === "" ? null : Number(pulses), sign: Number(at("sign").value),
    reference_angle: angle || null, speeds: speeds || null,
  };
}

function show(answer) {
  at("findings").innerHTML = answer.html;
  at("table-of-orders").replaceChildren(at("findings").querySelector("template").content);
  figures = answer.figures;
  draw();
}

function overview() {
  const rows = answers.map(({ name, answer, trouble }) => {
    if (!answer) return [name, trouble, "", "", ""];
    const button = element("button", name, { type: "button", className: "plain" });
    button.addEventListener("click", () => show(answer));
    return [button, ...answer.third];
  });
  at("overview").replaceChildren(table(["File", "Point", "Measured third order (N)", "Model (N)", "Difference", "Verdict"], rows));
}

at("table")?.addEventListener("change", preview);
form?.addEventListener("input", clear);
form?.addEventListener("submit", async (event) => {
  event.preventDefault();
  const button = form.querySelector("[type=submit]"), files = [...at("table").files];
  at("complaint").textContent = "";
  clear();
  const asked = turn;
  button.disabled = true;
  answers = [];
  for (const file of files) {
    try {
      const answer = await (await post(`${root}/parts/runs/${at("run").value}/compare`, request(await textOf(file)))).json();
      if (turn !== asked) break;
      answers.push({ name: file.name, answer });
      if (answers.filter((one) => one.answer).length === 1) show(answer);
    } catch (error) {
      if (turn !== asked) break;
      answers.push({ name: file.name, trouble: error.message });
      at("complaint").textContent = files.length > 1 ? `${file.name}: ${error.message}` : error.message;
    }
    overview();
  }
  button.disabled = false;
});
at("run")?.addEventListener("change", (event) => location.assign(`${root}/compare?run=${event.target.value}`));
whenThemeChanges(draw);
