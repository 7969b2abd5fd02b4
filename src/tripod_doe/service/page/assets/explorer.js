// The cube explorer: controls make an address, the address makes a figure, a mark leads to its point.

import { ask, askJson, complain, say } from "./asking.js";
import { saveImage } from "./images.js";
import { drawParallel } from "./parallel.js";
import { showPoint } from "./point.js";
import { liveHead } from "./run.js";
import { settings, themed, whenThemeChanges } from "./theme.js";

const explorer = document.getElementById("explorer");
const controls = document.getElementById("controls");
const place = document.getElementById("figure");
const api = explorer.dataset.api;
const page = location.pathname;
let drawn = null, asked = null;

function stepItems() {
  const step = document.getElementById("step");
  return step ? [["step", step.value]] : [];
}

function itemsOfAddress() {
  const items = [...new URLSearchParams(location.search)];
  return items.some(([name]) => name === "step") ? items : [...stepItems(), ...items];
}

function itemsOfControls() {
  const items = stepItems();
  const chosen = controls.querySelector("[name=kind]:checked");
  if (chosen) items.push(["kind", chosen.value]);
  for (const name of ["analysis", "variable", "x", "by", "low", "high", "where", "minus"]) {
    const field = controls.elements[name];
    if (field && (field.value || name === "by")) items.push([name, field.value]);
  }
  for (const field of controls.querySelectorAll("[data-select]")) {
    if (field.value !== "") items.push(["select", `${field.dataset.select}=${field.value}`]);
  }
  for (const range of controls.querySelectorAll("[data-range]")) {
    const [low, high] = [...range.querySelectorAll("input")].map((field) => field.value.trim());
    if (low || high) items.push(["select", `${range.dataset.range}=${low}:${high}`]);
  }
  return items;
}

function pointOfAddress() {
  const number = new URLSearchParams(location.search).get("point");
  return number === null || number === "" ? null : Number(number);
}

async function look(items, { remember = true } = {}) {
  asked?.abort();
  asked = new AbortController();
  const query = new URLSearchParams(items).toString();
  try {
    const [parts, figure] = await Promise.all([
      askJson(`${page.replace(/\/$/, "")}/view?${query}`, { signal: asked.signal }),
      askJson(`${api}/figure?${query}`, { signal: asked.signal }),
    ]);
    take(parts);
    if (remember) history.pushState(null, "", `${page}?${withPoint(query)}`);
    await draw(figure);
  } catch (error) {
    if (error.name === "AbortError") return;
    const complaint = document.getElementById("complaint");
    if (complaint) complaint.textContent = error.message;
    else complain(error);
  }
}

function withPoint(query) {
  const number = pointOfAddress();
  return number === null ? query : `${query}&point=${number}`;
}

function take(parts) {
  const focused = document.activeElement?.name || document.activeElement?.id;
  const start = document.activeElement?.selectionStart;
  controls.innerHTML = parts.controls;
  document.getElementById("exports").innerHTML = parts.exports;
  document.getElementById("seen-title").textContent = parts.title;
  linkExports();
  if (!focused) return;
  const field = controls.elements[focused]?.length && !controls.elements[focused].options
    ? controls.querySelector(`[name="${focused}"]:checked`) : controls.elements[focused];
  field?.focus();
  if (start != null && field?.setSelectionRange && field.type === "text") field.setSelectionRange(start, start);
}

async function draw(figure) {
  const before = drawn;
  drawn = figure;
  const parallel = Boolean(figure.axes);
  place.classList.toggle("parallel", parallel);
  if (parallel || before?.axes) Plotly.purge(place);
  if (parallel) {
    drawParallel(place, figure, { chosen: open, brushed: note });
  } else {
    if (before?.axes) place.replaceChildren();
    await Plotly.react(place, figure.data, themed(figure), settings);
    place.removeAllListeners?.("plotly_click");
    place.on("plotly_click", (event) => {
      const number = event.points[0].customdata;
      if (Number.isInteger(number) && number >= 0) open(number);
    });
    note(figure.note || "");
  }
  place.dataset.drawn = String(Number(place.dataset.drawn || 0) + 1);
  if (document.getElementById("numbers").open) fillNumbers();
}

function note(text) {
  document.getElementById("figure-note").textContent = text;
}

async function open(number) {
  const query = new URLSearchParams(location.search);
  query.set("point", number);
  history.replaceState(null, "", `${page}?${query}`);
  await showPoint(document.getElementById("point"), explorer, number, { open, close });
}

function close() {
  const query = new URLSearchParams(location.search);
  query.delete("point");
  history.replaceState(null, "", `${page}?${query}`);
  document.getElementById("point").hidden = true;
  place.focus();
}

function dataAddress(format) {
  const items = itemsOfControls().filter(([name]) => ["variable", "select", "where", "step", "analysis"].includes(name));
  return `${api}/query?${new URLSearchParams([...items, ["format", format]])}`;
}

function linkExports() {
  for (const link of document.querySelectorAll("#exports [data-format]")) {
    link.href = dataAddress(link.dataset.format);
    link.download = `${controls.elements.variable?.value || "view"}.${link.dataset.format === "csv" ? "csv" : "nc"}`;
  }
  for (const link of document.querySelectorAll("#exports [data-file]")) {
    link.href = `${api}/${link.dataset.file}?${new URLSearchParams(stepItems())}`;
  }
}

async function fillNumbers() {
  const box = document.querySelector("#numbers > div");
  try {
    const text = await (await ask(`${page.replace(/\/$/, "")}/numbers?${new URLSearchParams(itemsOfControls())}`)).text();
    box.innerHTML = text;
  } catch (error) {
    box.textContent = error.message;
  }
}

controls.addEventListener("submit", (event) => { event.preventDefault(); look(itemsOfControls()); });
controls.addEventListener("change", () => look(itemsOfControls()));
controls.addEventListener("click", (event) => {
  const button = event.target.closest(".step");
  if (!button) return;
  const list = button.parentElement.querySelector("select");
  const next = list.selectedIndex + Number(button.dataset.by);
  if (next < 0 || next >= list.options.length) return;
  list.selectedIndex = next;
  look(itemsOfControls());
});
document.getElementById("exports").addEventListener("click", async (event) => {
  const { copy, image } = event.target.dataset;
  if (copy !== undefined) {
    await navigator.clipboard.writeText(event.target.parentElement.querySelector("pre").textContent);
    say("Copied");
    event.target.textContent = "Copied";
  }
  if (image) saveImage(place, drawn, image, document.getElementById("seen-title").textContent).catch(complain);
});
document.getElementById("numbers").addEventListener("toggle", (event) => { if (event.target.open) fillNumbers(); });
document.querySelector("#numbers > div").addEventListener("click", (event) => {
  const number = event.target.closest("[data-point]")?.dataset.point;
  if (number !== undefined) open(Number(number));
});
document.getElementById("step")?.addEventListener("change", () => look(stepItems()));
document.addEventListener("click", (event) => {  // a menu closes when the reader turns to something else
  for (const menu of document.querySelectorAll("details.menu[open]")) if (!menu.contains(event.target)) menu.open = false;
});
document.addEventListener("keydown", (event) => {
  if (event.key === "Escape") for (const menu of document.querySelectorAll("details.menu[open]")) menu.open = false;
});
window.addEventListener("popstate", () => look(itemsOfAddress(), { remember: false }));
whenThemeChanges(() => drawn && draw(drawn));
liveHead(() => look(controls.elements.variable ? itemsOfControls() : itemsOfAddress(), { remember: false }));
if (controls.elements.variable) await look(itemsOfAddress(), { remember: false });
if (pointOfAddress() !== null) open(pointOfAddress());
