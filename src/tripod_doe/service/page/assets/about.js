// What people write about a run: its name, owner, tags and note.

import { root } from "./address.js";
import { ask, complain } from "./asking.js";

const form = document.getElementById("about");
form.addEventListener("submit", async (event) => {
  event.preventDefault();
  const values = Object.fromEntries(new FormData(form));
  values.tags = values.tags.split(",").map((tag) => tag.trim()).filter(Boolean);
  try {
    await ask(`${root}/api/v1/runs/${form.dataset.run}`, {
      method: "PATCH", headers: { "content-type": "application/json" }, body: JSON.stringify(values),
    });
    location.reload();
  } catch (error) {
    complain(error);
  }
});
