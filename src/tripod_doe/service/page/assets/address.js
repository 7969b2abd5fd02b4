// The first part of every address of this page, without which its cookie is worth nothing.

const NAME = "tripod-doe-root";

export const root = document.documentElement.dataset.root;

try {
  if (root) localStorage.setItem(NAME, root);
} catch { /* storage is off: addresses without the first part then need the token again */ }

export function remembered() {
  try {
    return localStorage.getItem(NAME);
  } catch {
    return null;
  }
}
