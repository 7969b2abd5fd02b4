// Buttons that change runs: a request, and the question before something is deleted.

import { root } from "./address.js";
import { ask, complain, post, say } from "./asking.js";

function sure(text) {
  const dialog = document.getElementById("sure");
  document.getElementById("sure-text").textContent = text;
  dialog.returnValue = "no";
  dialog.showModal();
  return new Promise((resolve) => dialog.addEventListener("close", () => resolve(dialog.returnValue === "yes"), { once: true }));
}

async function act(button) {
  if (button.dataset.delete) {
    if (!await sure(`Delete ${button.dataset.name} with all its results? This cannot be undone.`)) return;
    await ask(button.dataset.delete, { method: "DELETE" });
    say(`${button.dataset.name} is deleted`);
    if (location.pathname !== `${root}/`) location.assign(`${root}/`);
    return;
  }
  await post(button.dataset.post);
}

export function takeActions(done) {
  document.addEventListener("click", async (event) => {
    const button = event.target.closest("button[data-post], button[data-delete]");
    if (!button) return;
    button.disabled = true;
    try {
      await act(button);
      await done();
    } catch (error) {
      complain(error);
    } finally {
      button.disabled = false;
    }
  });
}
