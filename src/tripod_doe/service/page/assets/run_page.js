// A page of a run with nothing live but its head; it is loaded anew when the state changes.

import { liveHead } from "./run.js";

const head = document.getElementById("run-head"), first = head.dataset.state;
liveHead(() => {
  if (head.dataset.state !== first || location.pathname.endsWith("/steps")) location.reload();
});
