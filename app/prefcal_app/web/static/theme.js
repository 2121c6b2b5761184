// Set the theme before anything is drawn: the one chosen last, or else the system's.
"use strict";
(() => {
  let chosen = null;
  try {
    chosen = localStorage.getItem("prefcal-theme");
  } catch {
    // No local storage: use the system's theme.
  }
  const dark = matchMedia("(prefers-color-scheme: dark)").matches;
  document.documentElement.dataset.theme = chosen ?? (dark ? "dark" : "light");
})();
