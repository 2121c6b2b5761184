// Before anything is drawn: the theme that was chosen last, else the system's.
"use strict";
(() => {
  let chosen = null;
  try {
    chosen = localStorage.getItem("prefcal-theme");
  } catch {
    // A browser that keeps nothing: the system's theme then.
  }
  const dark = matchMedia("(prefers-color-scheme: dark)").matches;
  document.documentElement.dataset.theme = chosen ?? (dark ? "dark" : "light");
})();
