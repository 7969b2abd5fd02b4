// The cube explorer: controls make an address, the address makes a figure, a mark leads to its point.

import { ask, askJson, complain, say } from "./asking.js";
import { makeFrame } from "./frame.js";
import { saveImage } from "./images.js";
import { askPoint, showPoint } from "./point.js";
import { liveHead } from "./run.js";
import { whenThemeChanges } from "./theme.js";

const explorer = document.getElementById("explorer");
const controls = document.getElementById("controls");
const place = document.getElementById("figure");
const api = explorer.dataset.api;
const page = location.pathname.replace(/\/$/, "");
const main = makeFrame(place, { chosen: open, hovered: markAll, describe: note });
const second = makeFrame(document.getElementById("second-figure"), {
  chosen: open, hovered: markAll, describe: (text) => { document.getElementById("second-note").textContent = text; },
});
const exports = document.getElementById("exports");
let shownExports = exports.innerHTML;
let asked = null, opened = null, unsaved = false, taking = false;

const FIELDS = ["analysis", "variable", "x", "by", "low", "high", "where", "minus"];
const VIEW = ["step", "kind", "select", ...FIELDS];  // what an address says of the view, and of nothing else

function stepItems() {
  const step = document.getElementById("step");
  return step ? [["step", step.value]] : [];
}

function itemsOfAddress() {
  const items = [...new URLSearchParams(location.search)].filter(([name]) => VIEW.includes(name));
  return items.some(([name]) => name === "step") ? items : [...stepItems(), ...items];
}

function ofAddress(name) {
  return new URLSearchParams(location.search).get(name);
}

function itemsOfControls() {
  const items = stepItems();
  const chosen = controls.querySelector("[name=kind]:checked");
  if (chosen) items.push(["kind", chosen.value]);
  for (const name of FIELDS) {
    const field = controls.elements[name];
    if (field && (field.value || name === "by")) items.push([name, field.value]);
  }
  for (const field of controls.querySelectorAll("[data-select]")) {
    if (field.value !== "") items.push(["select", `${field.dataset.select}=${field.value}`]);
  }
  for (const range of controls.querySelectorAll("[data-range]")) {
    const [low, high] = [...range.querySelectorAll("input")].map((field) => field.value.trim());
    if (low || high) items.push(["select", `${range.dataset.range}=${low === high ? low : `${low}:${high}`}`]);
  }
  return items;
}

function isEdited(field) {  // its text would be lost, and sent half written, if the controls were replaced now
  return controls.contains(field) && field.type === "text" && field.value !== field.defaultValue;
}

async function look(items, { remember = true, live = false } = {}) {
  if (live && isEdited(document.activeElement)) return;
  asked?.abort();
  asked = new AbortController();
  unsaved ||= remember;  // of a view that this one replaces before it was there
  const query = new URLSearchParams(items).toString();
  try {
    const parts = askJson(`${page}/view?${query}`, { signal: asked.signal });
    if (!controls.elements.variable) {  // until a point has finished there is nothing to draw
      take(await parts);
      if (!controls.elements.variable) return;
    }
    const drawn = askJson(`${api}/figure?${query}`, { signal: asked.signal });
    const [taken, figure] = await Promise.all([parts, drawn]);
    if (live && isEdited(document.activeElement)) return;
    take(taken);
    if (unsaved) history.pushState(null, "", `${page}?${withKept(items)}`);
    unsaved = false;
    await main.draw(figure);
    if (document.getElementById("numbers").open) fillNumbers();
  } catch (error) {
    if (error.name === "AbortError") return;
    unsaved = false;
    const complaint = document.getElementById("complaint");
    if (complaint) complaint.textContent = error.message;
    else complain(error);
  }
}

function withKept(items) {  // the point that is open and the view beside stay when the view changes
  const kept = ["point", "at", "beside"].map((name) => [name, ofAddress(name)]).filter(([, value]) => value !== null && value !== "");
  return new URLSearchParams([...items, ...kept]);
}

function changeAddress(name, value) {
  const query = new URLSearchParams(location.search);
  if (value === null) query.delete(name);
  else query.set(name, value);
  history.replaceState(null, "", `${page}?${query}`);
}

function take(parts) {
  const focused = document.activeElement?.name || document.activeElement?.id;
  const start = document.activeElement?.selectionStart;
  taking = true;  // a field that is removed while it is written in tells of a change
  controls.innerHTML = parts.controls;
  taking = false;
  takeExports(parts.exports);
  document.getElementById("seen-title").textContent = parts.title;
  if (!focused) return;
  const field = controls.elements[focused]?.length && !controls.elements[focused].options
    ? controls.querySelector(`[name="${focused}"]:checked`) : controls.elements[focused];
  field?.focus();
  if (start != null && field?.setSelectionRange && field.type === "text") field.setSelectionRange(start, start);
}

function takeExports(text) {  // a menu in use is replaced only by another one
  const made = document.createElement("template");
  made.innerHTML = text;
  if (made.innerHTML === shownExports) return;
  shownExports = made.innerHTML;
  exports.innerHTML = text;
}

function note(text) {
  document.getElementById("figure-note").textContent = text;
}

function markAll(number) {
  main.mark(number);
  second.mark(number);
  for (const row of document.querySelectorAll("#numbers tr.marked")) row.classList.remove("marked");
  if (number !== null) document.querySelector(`#numbers [data-point="${number}"]`)?.closest("tr").classList.add("marked");
}

async function lookBeside() {
  const query = ofAddress("beside"), box = document.getElementById("second");
  if (query) {
    const [parts, figure] = await Promise.all([askJson(`${page}/view?${query}`), askJson(`${api}/figure?${query}`)]);
    box.hidden = false;
    document.getElementById("second-title").textContent = parts.title;
    await second.draw(figure);
  }
  box.hidden = !query;
}

async function open(number, at = "") {
  if (controls.elements.analysis?.value) {  // a number of an analysis leads to the points behind it
    location.assign(`${page}/behind?${new URLSearchParams([...itemsOfControls(), ["cell", number]])}`);
    return;
  }
  try {
    takePoint(await askPoint(number, at));
  } catch (error) {
    complain(error);
  }
}

function takePoint(answer) {
  opened = answer;
  changeAddress("point", answer.number);
  changeAddress("at", answer.at);
  showPoint(document.getElementById("point"), answer, { open, close });
}

async function followPoint() {  // its number moves when the study grows
  if (!opened) return;
  const answer = await askPoint(opened.number, opened.at);
  if (answer.number !== opened?.number) takePoint(answer);
}

function close() {
  opened = null;
  for (const name of ["point", "at"]) changeAddress(name, null);
  document.getElementById("point").hidden = true;
  place.focus();
}

async function fillNumbers() {
  const box = document.querySelector("#numbers > div");
  try {
    const text = await (await ask(`${page}/numbers?${new URLSearchParams(itemsOfControls())}`)).text();
    box.innerHTML = text;
  } catch (error) {
    box.textContent = error.message;
  }
}

controls.addEventListener("submit", (event) => { event.preventDefault(); look(itemsOfControls()); });
controls.addEventListener("change", (event) => {  // what is chosen for one cube says nothing of another
  if (taking) return;
  const { name, value } = event.target;
  look(name === "analysis" ? [...stepItems(), ["analysis", value]] : itemsOfControls());
});
controls.addEventListener("click", (event) => {
  const button = event.target.closest(".step");
  if (!button) return;
  const list = button.parentElement.querySelector("select");
  const next = list.selectedIndex + Number(button.dataset.by);
  if (next < 0 || next >= list.options.length) return;
  list.selectedIndex = next;
  look(itemsOfControls());
});
exports.addEventListener("click", async (event) => {
  const { copy, image } = event.target.dataset;
  if (copy !== undefined) {
    await navigator.clipboard.writeText(event.target.parentElement.querySelector("pre").textContent);
    say("Copied");
    event.target.textContent = "Copied";
  }
  if (image) saveImage(place, main.figure, image, document.getElementById("seen-title").textContent).catch(complain);
});
document.getElementById("numbers").addEventListener("toggle", (event) => { if (event.target.open) fillNumbers(); });
document.querySelector("#numbers > div").addEventListener("click", (event) => {
  const number = event.target.closest("[data-point]")?.dataset.point;
  if (number !== undefined) open(Number(number));
});
document.getElementById("numbers").addEventListener("pointerover", (event) => {
  const number = event.target.closest("tr")?.querySelector("[data-point]")?.dataset.point;
  markAll(number === undefined ? null : Number(number));
});
document.getElementById("keep").addEventListener("click", () => {
  changeAddress("beside", new URLSearchParams(itemsOfControls()).toString());
  lookBeside().then(() => say("This view is kept below"), complain);
});
document.getElementById("second").addEventListener("click", (event) => {
  const { does } = event.target.dataset;
  if (!does) return;
  const kept = ofAddress("beside");
  changeAddress("beside", does === "swap" ? new URLSearchParams(itemsOfControls()).toString() : null);
  if (does === "swap") look([...new URLSearchParams(kept)]);
  lookBeside().catch(complain);
  if (does === "close") document.getElementById("keep").focus();
});
document.getElementById("step")?.addEventListener("change", () => look(stepItems()));
document.addEventListener("click", (event) => {  // a menu closes when the reader turns to something else
  for (const menu of document.querySelectorAll("details.menu[open]")) if (!menu.contains(event.target)) menu.open = false;
});
document.addEventListener("keydown", (event) => {
  if (event.key === "Escape") for (const menu of document.querySelectorAll("details.menu[open]")) menu.open = false;
});
window.addEventListener("popstate", () => { look(itemsOfAddress(), { remember: false }); lookBeside().catch(complain); });
whenThemeChanges(() => { for (const frame of [main, second]) if (frame.figure) frame.draw(frame.figure); });
liveHead(() => {
  look(controls.elements.variable ? itemsOfControls() : itemsOfAddress(), { remember: false, live: true });
  lookBeside().catch(complain);
  followPoint().catch(complain);
});
if (controls.elements.variable) await look(itemsOfAddress(), { remember: false });
lookBeside().catch(complain);
if (ofAddress("point")) open(Number(ofAddress("point")), ofAddress("at") ?? "");
