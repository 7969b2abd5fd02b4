// A page of a run with little live but its head: steps follow what is done, and all is loaded anew when the state changes.

import { ask, complain } from "./asking.js";
import { liveHead } from "./run.js";

const head = document.getElementById("run-head"), first = head.dataset.state;
const steps = document.getElementById("steps");

async function follow() {
  try {
    const page = new DOMParser().parseFromString(await (await ask(location.href)).text(), "text/html");
    steps.replaceChildren(...page.getElementById("steps").children);
  } catch (error) {
    complain(error);
  }
}

liveHead(() => {
  if (head.dataset.state !== first) location.reload();
  else if (steps) follow();
});
