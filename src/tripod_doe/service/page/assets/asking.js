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
