// Changes of runs as they happen; bursts are taken together, and a connection that breaks is made again.

const PAUSE = 250;  // ms between two updates

export function watch(address, changed) {
  const source = new EventSource(address);
  let waiting = null, last = 0;
  source.addEventListener("message", take);
  source.addEventListener("deleted", take);
  function take() {
    if (waiting !== null) return;
    waiting = setTimeout(() => { waiting = null; last = Date.now(); changed(); }, Math.max(0, PAUSE - (Date.now() - last)));
  }
  return source;
}
