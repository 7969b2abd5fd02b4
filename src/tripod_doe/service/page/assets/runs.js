// The list of runs, live.

import { takeActions } from "./actions.js";
import { root } from "./address.js";
import { askJson, complain, say } from "./asking.js";
import { refresh } from "./fragments.js";
import { watch } from "./live.js";

const list = document.getElementById("list");
const LOOK = 2500;  // ms from a change to the next look for the extremes of runs
let due = null;

function order() {
  return document.getElementById("order").value;
}

async function lookForExtremes() {
  const found = await askJson(`${root}/parts/extremes?order=${order()}`);
  if (found.new) await refresh(list, `${root}/parts/runs?order=${order()}`);
}

function states() {
  return new Map([...list.querySelectorAll("tr[id]")].map((row) => [row.id, row.dataset.state]));
}

async function update() {
  const before = states();
  try {
    await refresh(list, `${root}/parts/runs?order=${order()}`);
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

document.getElementById("order").addEventListener("change", async () => {
  history.replaceState(null, "", `${root}/?order=${order()}`);
  await refresh(list, `${root}/parts/runs?order=${order()}`);
  lookForExtremes().catch(complain);
});
takeActions(update);
watch(`${root}/api/v1/events`, update);
lookForExtremes().catch(complain);
