// Parts of a page that the server writes anew: only what changed is replaced, and the keyboard stays where it is.

import { ask } from "./asking.js";
import { localTimes } from "./local_times.js";

function name(element) {
  return element?.dataset.post || element?.dataset.delete || element?.id || element?.getAttribute("href");
}

const turns = new WeakMap();  // the last question of each place: an answer to an earlier one may come after it

export async function refresh(place, address) {
  const turn = (turns.get(place) ?? 0) + 1;
  turns.set(place, turn);
  const text = await (await ask(address)).text();
  if (turns.get(place) !== turn) return;
  const fresh = document.createElement("template");
  fresh.innerHTML = text;
  localTimes(fresh.content);
  replaceChanged(place, fresh.content);
}

export function replaceChanged(place, content) {
  const focused = place.contains(document.activeElement) ? name(document.activeElement) : null;
  const rows = [...content.querySelectorAll("[id]")].filter((row) => row.tagName === "TR");
  const known = rows.every((row) => document.getElementById(row.id)) && rows.length === place.querySelectorAll("tr[id]").length;
  if (rows.length && known) {
    for (const row of rows) update(document.getElementById(row.id), row);
  } else {
    place.replaceChildren(content);
  }
  if (focused && !place.contains(document.activeElement)) {
    [...place.querySelectorAll("a, button")].find((element) => name(element) === focused)?.focus();
  }
}

function update(row, fresh) {
  row.dataset.state = fresh.dataset.state;
  [...row.cells].forEach((cell, at) => {
    if (cell.innerHTML !== fresh.cells[at].innerHTML) cell.replaceChildren(...fresh.cells[at].childNodes);
  });
}
