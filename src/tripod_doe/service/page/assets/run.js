// The head of the page of a run, live.

import { takeActions } from "./actions.js";
import { root } from "./address.js";
import { complain, say } from "./asking.js";
import { refresh } from "./fragments.js";
import { watch } from "./live.js";

export function liveHead(pointsChanged = () => {}) {
  const head = document.getElementById("run-head");
  const id = head.dataset.run;
  async function update() {
    const before = head.textContent.replace(/\s+/g, " ");
    try {
      await refresh(head, `${root}/parts/runs/${id}`);
    } catch (error) {
      complain(error);
      return;
    }
    const state = head.querySelector(".state").textContent;
    if (state !== head.dataset.state) say(`${head.querySelector("h1").textContent}: ${state}`);
    head.dataset.state = state;
    if (head.textContent.replace(/\s+/g, " ") !== before) pointsChanged();
  }
  takeActions(update);
  watch(`${root}/api/v1/runs/${id}/events`, update);
}

