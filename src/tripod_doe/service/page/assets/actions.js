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
    const final = "final" in button.dataset;
    if (final && !await sure(`Remove ${button.dataset.name} with all its results? This cannot be undone.`)) return;
    await ask(button.dataset.delete, { method: "DELETE" });
    if (final) {
      say(`${button.dataset.name} is removed`);
      return;
    }
    sessionStorage.setItem("binned", JSON.stringify({ name: button.dataset.name, address: button.dataset.delete }));
    if (location.pathname !== `${root}/`) location.assign(`${root}/`);
    else offerUndo();
    return;
  }
  await post(button.dataset.post);
}

export function offerUndo() {
  const binned = JSON.parse(sessionStorage.getItem("binned") || "null"), place = document.getElementById("undo");
  sessionStorage.removeItem("binned");
  if (!binned) return;
  place.querySelector("span").textContent = `${binned.name} is in the bin.`;
  const button = document.getElementById("undo-button");
  button.dataset.post = `${binned.address}/restore`;
  place.hidden = false;
}

export function takeActions(done) {
  offerUndo();
  document.addEventListener("click", async (event) => {
    const button = event.target.closest("button[data-post], button[data-delete]");
    if (!button) return;
    button.disabled = true;
    try {
      await act(button);
      if (button.id === "undo-button") document.getElementById("undo").hidden = true;
      await done();
    } catch (error) {
      complain(error);
    } finally {
      button.disabled = false;
    }
  });
}
