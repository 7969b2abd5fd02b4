// The list of runs, live.

import { takeActions } from "./actions.js";
import { complain, say } from "./asking.js";
import { refresh } from "./fragments.js";
import { watch } from "./live.js";

const list = document.getElementById("list");

function states() {
  return new Map([...list.querySelectorAll("tr[id]")].map((row) => [row.id, row.dataset.state]));
}

async function update() {
  const before = states();
  try {
    await refresh(list, "/parts/runs");
  } catch (error) {
    complain(error);
    return;
  }
  for (const [id, state] of states()) {
    if (before.has(id) && before.get(id) !== state) {
      say(`${document.getElementById(id).querySelector("a").textContent}: ${state}`);
    }
  }
}

takeActions(update);
watch("/api/v1/events", update);
