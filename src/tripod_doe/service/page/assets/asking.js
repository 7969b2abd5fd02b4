// Requests to the server, and what it says when something is wrong.

export class Refused extends Error {
  constructor(status, problems) {
    super(problems.map((problem) => problem.message).join("\n"));
    this.status = status;
    this.problems = problems;
  }
}

export async function ask(address, options = {}) {
  let response;
  try {
    response = await fetch(address, { credentials: "same-origin", ...options });
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Refused(0, [{ message: "The server does not answer. Is tripod-doe serve still running?" }]);
  }
  if (response.ok) return response;
  let problems;
  try {
    problems = (await response.json()).errors;
  } catch {
    problems = null;
  }
  throw new Refused(response.status, problems || [{ message: `The server answered ${response.status}.` }]);
}

export async function askJson(address, options) {
  return (await ask(address, options)).json();
}

export function post(address, body, options = {}) {
  return ask(address, {
    ...options, method: "POST", headers: { "content-type": "application/json", ...options.headers },
    body: JSON.stringify(body ?? {}),
  });
}

export function say(text) {
  document.getElementById("said").textContent = text;
}

export function complain(error) {
  const place = document.getElementById("trouble");
  if (error.name === "AbortError") return;
  place.textContent = error.message;
  place.hidden = false;
  setTimeout(() => { place.hidden = true; }, 10000);
}

// The text of a file as it was written: UTF-8, UTF-16 by its mark, else the encoding of Western Windows.
export async function textOf(file) {
  const bytes = new Uint8Array(await file.arrayBuffer());
  const marked = { "255,254": "utf-16le", "254,255": "utf-16be" }[bytes.slice(0, 2).join()];
  if (marked) return new TextDecoder(marked).decode(bytes);
  try {
    return new TextDecoder("utf-8", { fatal: true }).decode(bytes);
  } catch {
    return new TextDecoder("windows-1252").decode(bytes);
  }
}
