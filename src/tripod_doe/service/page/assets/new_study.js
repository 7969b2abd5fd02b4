// A file as text, a study also as a form, each following the other, with its price and its faults while it is written.

import { root } from "./address.js";
import { post, textOf } from "./asking.js";

const text = document.getElementById("text");
const form = document.getElementById("form");
const lines = document.getElementById("lines");
const problems = document.getElementById("problems");
const price = document.getElementById("price");
const submit = document.getElementById("submit");
const extended = document.getElementById("extended")?.dataset.run;  // the run whose study grows here
const PAUSE = 350;  // ms after the last key
const LONG = 20000;  // characters of a file from which only its beginning is shown
const attached = document.getElementById("attached"), long = new WeakMap();
const written = new WeakMap();  // by field: what it said when it was written into the text
const refused = new Map();  // by field: why what it says is not in the text
let timer = null, asked = null, typing = null;
let changes = Promise.resolve();  // of the form, one after the other: each starts from the text of the one before

function number() {
  const count = text.value.split("\n").length;
  const wrong = new Set([...problems.querySelectorAll("[data-line]")].map((item) => Number(item.dataset.line)));
  lines.replaceChildren(...Array.from({ length: count }, (_, at) => {
    const line = document.createElement("span");
    line.textContent = `${at + 1}\n`;
    if (wrong.has(at + 1)) line.className = "wrong";
    return line;
  }));
  lines.scrollTop = text.scrollTop;
}

function kind() {
  return text.value.match(/^\s*\[(workflow|fit|optimisation)\]/m)?.[1] ?? "study";
}

function body(more = {}) {
  const files = Object.fromEntries([...attached.children].map((file) => [file.dataset.file, long.get(file) ?? file.querySelector("textarea").value]));
  return { [kind()]: text.value, files, ...more };
}

function attach(given, content) {
  const name = given.replace(/[^A-Za-z0-9._-]+/g, "_").replace(/^[.-]+/, "").replace(/\.{2,}/g, ".").slice(-100);
  const file = document.getElementById("attached-file").content.firstElementChild.cloneNode(true);
  const field = file.querySelector("textarea");
  file.dataset.file = name;
  file.querySelector("summary").textContent = name === given ? name : `${name}, from ${given}`;
  Object.assign(field, { value: content, ariaLabel: name });
  if (content.length > LONG) {  // a field would be slow, and no one writes into a record
    long.set(file, content);
    Object.assign(field, { value: `${content.slice(0, LONG)}\n…`, readOnly: true });
  }
  attached.querySelector(`[data-file="${CSS.escape(name)}"]`)?.remove();
  attached.append(file);
}

async function check({ timing = false, keepForm = false } = {}) {
  asked?.abort();
  asked = new AbortController();
  submit.disabled = true;
  form.hidden = kind() !== "study";
  form.parentElement.classList.toggle("alone", form.hidden);
  submit.textContent = extended ? "Run what is new" : `Run this ${kind()}`;
  try {
    if (!form.hidden && !keepForm && !form.contains(document.activeElement)) {
      form.innerHTML = await (await post(`${root}/parts/form`, { study: text.value }, { signal: asked.signal })).text();
    }
    const html = await (await post(`${root}/parts/${extended ? `runs/${extended}/` : ""}price`, body({ timing }), { signal: asked.signal })).text();
    price.innerHTML = html;
    show(standing());
    submit.disabled = false;
  } catch (error) {
    if (error.name === "AbortError") return;
    price.replaceChildren();
    show([...standing(), ...(error.problems || [{ message: error.message }])]);
  }
  number();
}

// What is wrong with fields that still show what was refused: the text holds another value, or none.
function standing() {
  for (const field of refused.keys()) if (!form.contains(field)) refused.delete(field);
  return [...refused.values()].flat();
}

function show(found) {
  problems.replaceChildren(...found.map((problem) => {
    const item = document.createElement("p");
    item.textContent = problem.message;
    if (problem.line) {
      const button = document.createElement("button");
      button.type = "button";
      button.className = "link";
      const file = attached.querySelector(`[data-file="${CSS.escape(problem.file || "")}"]`);
      button.textContent = file ? `${problem.file}, line ${problem.line}` : `Line ${problem.line}`;
      button.addEventListener("click", () => goTo(file, problem.line));
      if (!file) item.dataset.line = problem.line;
      item.prepend(button, ": ");
    }
    return item;
  }));
}

function goTo(file, line) {
  if (file) file.open = true;
  const field = file ? file.querySelector("textarea") : text, all = field.value.split("\n");
  const start = all.slice(0, line - 1).join("\n").length + (line > 1 ? 1 : 0);
  field.focus();
  field.setSelectionRange(start, start + all[line - 1].length);
  field.scrollTop = (line - 5) * parseFloat(getComputedStyle(field).lineHeight);
}

// Write a field of the form into the text, or keep why it cannot be.
async function change(field) {
  const { name, value } = field;
  try {
    let before, changed;
    do {  // again where the text was typed into meanwhile
      before = text.value;
      changed = await (await post(`${root}/parts/change`, { study: before, key: name, value })).json();
    } while (text.value !== before);
    text.value = changed.study;
    written.set(field, value);
    refused.delete(field);
    field.closest("label").classList.toggle("varied", /[,:]/.test(value) && name.startsWith("parameter."));
    await check({ keepForm: name !== "study.scene" });
    if (name === "study.scene") form.innerHTML = await (await post(`${root}/parts/form`, { study: text.value })).text();
  } catch (error) {
    written.delete(field);
    refused.set(field, error.problems || [{ message: error.message }]);
    show(standing());
  }
}

function take(field) {
  if (!field.name) return;
  asked?.abort();  // the price of the text before
  changes = changes.then(() => change(field));
}

function untouched(field) {
  if (!field.options) return field.value === field.defaultValue;
  return field.selectedIndex === Math.max(0, [...field.options].findIndex((option) => option.defaultSelected));
}

function soon() {
  clearTimeout(timer);
  timer = setTimeout(check, PAUSE);
}

text.addEventListener("input", () => { number(); soon(); });
text.addEventListener("scroll", () => { lines.scrollTop = text.scrollTop; });
attached.addEventListener("input", soon);
form.addEventListener("submit", (event) => event.preventDefault());
form.addEventListener("input", ({ target }) => {
  clearTimeout(typing);
  typing = setTimeout(take, PAUSE, target);
});
form.addEventListener("change", ({ target }) => {  // not again what was taken while it was typed
  clearTimeout(typing);
  if (written.get(target) !== target.value) take(target);
});
document.getElementById("files").addEventListener("change", async (event) => {
  for (const file of event.target.files) attach(file.name, await textOf(file));
  check();
});
document.getElementById("time").addEventListener("click", async (event) => {
  event.target.disabled = true;
  event.target.textContent = "Timing \u2026";
  await check({ timing: true, keepForm: true });
  event.target.disabled = false;
  event.target.textContent = "Time it on this machine";
});
submit.addEventListener("click", async () => {
  submit.disabled = true;
  await changes;  // of a field left by this very click: what is seen is what runs
  const wrong = standing();
  if (wrong.length) {
    show(wrong);
    submit.disabled = false;
    return;
  }
  clearTimeout(timer);
  submit.disabled = true;
  try {
    const key = crypto.randomUUID?.() ?? String(Math.random());
    const address = `${root}/api/v1/runs${extended ? `/${extended}/extend` : ""}`;
    const run = await (await post(address, body(), { headers: { "idempotency-key": key } })).json();
    location.assign(`${root}/runs/${run.id}`);
  } catch (error) {
    show(error.problems || [{ message: error.message }]);
    submit.disabled = false;
  }
});
number();
check({ keepForm: true });
for (const field of form.elements) {  // typed before this script ran, or kept by the browser over a reload
  if (!untouched(field)) take(field);
}
