// A variable by formula, added to the results of a run: faults and price while it is written.

import { root } from "./address.js";
import { askJson, post } from "./asking.js";

const form = document.getElementById("derive");
const problems = form.querySelector(".problems"), price = form.querySelector(".price");
const PAUSE = 350;  // ms after the last key
let timer = null, asked = null;

function body() {
  const { name, formula, unit, meaning } = Object.fromEntries([...new FormData(form)].map(([key, value]) => [key, value.trim()]));
  return { responses: { [name]: { formula, ...(unit && { unit }), ...(meaning && { meaning }) } } };
}

function show(error) {
  price.replaceChildren();
  problems.replaceChildren(...(error.problems || [error]).map((problem) => {
    const line = document.createElement("p");
    line.textContent = problem.message;
    return line;
  }));
}

async function check() {
  asked?.abort();
  asked = new AbortController();
  if (!form.elements.name.value.trim() || !form.elements.formula.value.trim()) {
    problems.replaceChildren();
    price.replaceChildren();
    return;
  }
  try {
    price.innerHTML = await (await post(`${root}/parts/runs/${form.dataset.run}/price`, body(), { signal: asked.signal })).text();
    problems.replaceChildren();
  } catch (error) {
    if (error.name !== "AbortError") show(error);
  }
}

async function ended() {  // the run, as soon as it has ended
  for (;;) {
    const run = await askJson(`${root}/api/v1/runs/${form.dataset.run}`);
    if (["finished", "failed", "stopped"].includes(run.state)) return run;
    await new Promise((resolve) => { setTimeout(resolve, 400); });
  }
}

form.addEventListener("input", () => {
  clearTimeout(timer);
  timer = setTimeout(check, PAUSE);
});
form.addEventListener("submit", async (event) => {
  event.preventDefault();
  clearTimeout(timer);
  asked?.abort();
  const button = form.querySelector("[type=submit]");
  button.disabled = true;
  await change(button, body(), `?variable=${encodeURIComponent(form.elements.name.value.trim())}`);
});

document.getElementById("made")?.addEventListener("click", (event) => {
  const button = event.target.closest("[data-drop]");
  if (!button) return;
  button.disabled = true;
  change(button, { drop: [button.dataset.drop] }, "");
});

async function change(button, asked, view) {
  try {
    await post(`${root}/api/v1/runs/${form.dataset.run}/derive`, asked);
    price.textContent = "The results are being written …";
    const run = await ended();
    if (run.state !== "finished" && run.message) throw new Error(run.message);
    location.assign(`${root}/runs/${form.dataset.run}${view}`);
  } catch (error) {
    show(error);
    button.disabled = false;
  }
}
