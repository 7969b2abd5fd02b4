// The list of runs, live.

import { takeActions } from "./actions.js";
import { root } from "./address.js";
import { askJson, complain, say } from "./asking.js";
import { refresh } from "./fragments.js";
import { watch } from "./live.js";
import { localDay } from "./local_times.js";

const list = document.getElementById("list");
const LOOK = 2500;  // ms from a change to the next look for the extremes of runs
const TYPING = 25;  // ms from a letter to the search
let due = null;

const form = document.getElementById("find");
const days = form.querySelectorAll("[type=date]");
for (const day of days) if (day.dataset.at) day.value = localDay(new Date(day.dataset.at));

function asked() {
  const query = new URLSearchParams([...new FormData(form)].filter(([, value]) => value));
  for (const { name, value } of days) {  // a day of the reader's zone, as the list shows its times
    if (value < "1970") query.delete(name);  // its year is being typed
    else query.set(name, new Date(`${value}T${name === "until" ? "23:59:59.999" : "00:00"}`).toISOString());
  }
  const page = new URLSearchParams(location.search).get("page");
  if (page) query.set("page", page);
  return query;
}

async function lookForExtremes() {
  const found = await askJson(`${root}/parts/extremes?${asked()}`);
  if (found.new) await refresh(list, `${root}/parts/runs?${asked()}`);
}

function states() {
  return new Map([...list.querySelectorAll("tr[id]")].map((row) => [row.id, row.dataset.state]));
}

async function update() {
  const before = states();
  try {
    await refresh(list, `${root}/parts/runs?${asked()}`);
  } catch (error) {
    complain(error);
    return;
  }
  due ??= setTimeout(() => { due = null; lookForExtremes().catch(complain); }, LOOK);
  for (const [id, state] of states()) {
    if (before.has(id) && before.get(id) !== state) {
      say(`${document.getElementById(id).querySelector("a").textContent}: ${state}`);
    }
  }
}

async function find() {
  const query = asked();
  query.delete("page");
  history.replaceState(null, "", `${root}/?${query}`);
  try {
    await refresh(list, `${root}/parts/runs?${query}`);
  } catch (error) {
    complain(error);
    return;
  }
  lookForExtremes().catch(complain);
}

let typed = null;
form.addEventListener("input", (event) => {
  clearTimeout(typed);
  typed = setTimeout(find, event.target.type === "search" ? TYPING : 0);
});
form.addEventListener("submit", (event) => { event.preventDefault(); find(); });
takeActions(update);
watch(`${root}/api/v1/events?after=${list.dataset.newest}`, update);
lookForExtremes().catch(complain);
