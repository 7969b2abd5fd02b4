// The largest difference between two runs as a picture: the explorer's view of B, from which A is subtracted.

import { root } from "./address.js";
import { askJson } from "./asking.js";
import { makeFrame } from "./frame.js";
import { whenThemeChanges } from "./theme.js";

const place = document.getElementById("figure"), note = document.getElementById("figure-note");
const { run, query } = place.dataset;
const frame = makeFrame(place, {
  chosen: (number) => location.assign(`${root}/runs/${run}?${query}&point=${number}`),
  hovered: () => {}, describe: (text) => { note.textContent = text; },
});

whenThemeChanges(() => { if (frame.figure) frame.draw(frame.figure); });
try {
  await frame.draw(await askJson(`${root}/api/v1/runs/${run}/figure?${query}`));
} catch (error) {  // no axes in common
  place.hidden = true;
  note.textContent = `No picture: ${error.message}`;
}
