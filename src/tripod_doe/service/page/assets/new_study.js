// A study as text and as a form, each following the other, with its price and its faults while it is written.

import { post } from "./asking.js";

const text = document.getElementById("text");
const form = document.getElementById("form");
const lines = document.getElementById("lines");
const problems = document.getElementById("problems");
const price = document.getElementById("price");
const submit = document.getElementById("submit");
const PAUSE = 350;  // ms after the last key
let timer = null, asked = null, files = {};

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

function body(more = {}) {
  const workflow = /^\s*\[workflow\]/m.test(text.value);
  return { [workflow ? "workflow" : "study"]: text.value, files, ...more };
}

async function check({ timing = false, keepForm = false } = {}) {
  asked?.abort();
  asked = new AbortController();
  submit.disabled = true;
  try {
    if (!keepForm && !form.contains(document.activeElement)) {
      form.innerHTML = await (await post("/parts/form", { study: text.value }, { signal: asked.signal })).text();
    }
    const html = await (await post("/parts/price", body({ timing }), { signal: asked.signal })).text();
    price.innerHTML = html;
    problems.replaceChildren();
    submit.disabled = false;
  } catch (error) {
    if (error.name === "AbortError") return;
    price.replaceChildren();
    show(error.problems || [{ message: error.message }]);
  }
  number();
}

function show(found) {
  problems.replaceChildren(...found.map((problem) => {
    const item = document.createElement("p");
    item.textContent = problem.message;
    if (problem.line) {
      const button = document.createElement("button");
      button.type = "button";
      button.className = "link";
      button.textContent = `Line ${problem.line}`;
      button.addEventListener("click", () => goTo(problem.line));
      item.dataset.line = problem.line;
      item.prepend(button, ": ");
    }
    return item;
  }));
}

function goTo(line) {
  const all = text.value.split("\n"), start = all.slice(0, line - 1).join("\n").length + (line > 1 ? 1 : 0);
  text.focus();
  text.setSelectionRange(start, start + all[line - 1].length);
  text.scrollTop = (line - 5) * parseFloat(getComputedStyle(text).lineHeight);
}

function soon() {
  clearTimeout(timer);
  timer = setTimeout(check, PAUSE);
}

text.addEventListener("input", () => { number(); soon(); });
text.addEventListener("scroll", () => { lines.scrollTop = text.scrollTop; });
form.addEventListener("submit", (event) => event.preventDefault());
form.addEventListener("change", async (event) => {
  const { name, value } = event.target;
  if (!name) return;
  try {
    const changed = await (await post("/parts/change", { study: text.value, key: name, value })).json();
    text.value = changed.study;
    event.target.setCustomValidity("");
    event.target.closest("label").classList.toggle("varied", /[,:]/.test(value) && name.startsWith("parameter."));
    await check({ keepForm: name !== "study.scene" });
    if (name === "study.scene") form.innerHTML = await (await post("/parts/form", { study: text.value })).text();
  } catch (error) {
    show(error.problems || [{ message: error.message }]);
  }
});
document.getElementById("files").addEventListener("change", async (event) => {
  files = {};
  for (const file of event.target.files) files[file.name] = await file.text();
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
  try {
    const key = crypto.randomUUID?.() ?? String(Math.random());
    const run = await (await post("/api/v1/runs", body(), { headers: { "idempotency-key": key } })).json();
    location.assign(`/runs/${run.id}`);
  } catch (error) {
    show(error.problems || [{ message: error.message }]);
    submit.disabled = false;
  }
});
number();
check({ keepForm: true });
