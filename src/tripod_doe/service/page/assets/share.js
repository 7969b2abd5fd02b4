// Links that open this run for reading and nothing else: made, copied and revoked.

import { root } from "./address.js";
import { ask, askJson, complain, post, say } from "./asking.js";
import { timeElement } from "./local_times.js";

const part = document.getElementById("share");
const place = `${root}/api/v1/runs/${part.dataset.run}/shares`;
const list = part.querySelector("ul"), made = part.querySelector("[data-made]");

async function show() {
  const links = await askJson(place);
  list.replaceChildren(...links.map((link) => {
    const item = document.createElement("li"), button = document.createElement("button");
    const end = timeElement(link.expires);
    item.append("Open until ", end, " ");
    button.type = "button";
    button.textContent = "Revoke";
    button.setAttribute("aria-label", `Revoke the link that is open until ${end.textContent}`);
    button.addEventListener("click", async () => {
      try {
        await ask(`${place}/${link.id}`, { method: "DELETE" });
        say("The link is revoked");
        made.hidden = true;
        await show();
      } catch (error) {
        complain(error);
      }
    });
    item.append(button);
    return item;
  }));
}

part.addEventListener("toggle", () => { if (part.open) show().catch(complain); });

part.querySelector("form").addEventListener("submit", async (event) => {
  event.preventDefault();
  try {
    const days = new FormData(event.target).get("days");
    const link = await (await post(`${place}?days=${encodeURIComponent(days)}`)).json();
    const field = made.querySelector("input");
    field.value = link.address;
    made.hidden = false;
    field.select();
    await show();
  } catch (error) {
    complain(error);
  }
});
