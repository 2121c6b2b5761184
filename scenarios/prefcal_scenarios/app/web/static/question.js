// Show two experiments: text above, curves below, and one cursor, zoom and clock for both.

import { act } from "./flow.js";
import { $, el, fill, withUnit } from "./dom.js";
import { Cursor } from "./cursor.js";
import { Plots } from "./plots.js";
import { Scenes } from "./scene.js";
import { describe, marks } from "./side.js";
import * as table from "./table.js";

const plots = new Plots((name) => $(`${name}-plot`));
const scenes = new Scenes((time) => cursor.put(time));
const cursor = new Cursor(plots, (time) => scenes.follow(time));
let overlaid = false;

export function start() {
  // On a screen too narrow for two sides, show both in one plot.
  overlaid = matchMedia("(max-width: 600px)").matches;
  try {
    const chosen = localStorage.getItem("prefcal-overlay");
    if (chosen) overlaid = chosen === "yes";
  } catch {
    // No local storage: nothing is remembered.
  }
  $("overlay").addEventListener("click", toggleOverlay);
  $("zoom").addEventListener("click", toggleZoom);
  plots.onzoom = (zoomed) => $("zoom").setAttribute("aria-pressed", zoomed);
  scenes.start();
  cursor.start($("pair"));
  table.start();
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", ({ matches }) => {
    if (themeChosen()) return;
    document.documentElement.dataset.theme = matches ? "dark" : "light";
    plots.draw();
  });
  $("theme").addEventListener("click", () => {
    const root = document.documentElement.dataset;
    root.theme = root.theme === "dark" ? "light" : "dark";
    try {
      localStorage.setItem("prefcal-theme", root.theme);
    } catch {
      // No local storage: the choice is not remembered.
    }
    plots.draw();
  });
  fill($("both"), el("p", { class: "legend" }, el("span", { class: "key left" }, "Left"),
    el("span", { class: "key right" }, "Right")),
  el("div", { class: "plot", id: "both-plot", role: "img", "aria-label": "Both experiments" }));
}

function themeChosen() {
  try {
    return localStorage.getItem("prefcal-theme") !== null;
  } catch {
    return false;
  }
}

// Show the text of a question; `fit` draws the curves once the layout is known.
export function show(now, same) {
  const { question } = now;
  for (const side of ["left", "right"]) {
    if (same) marks(side, question[side]);
    else describe(side, question);
  }
  if (same) return;
  table.take(question);
  plots.take(question, now.scenario.time_unit);
  cursor.reset();
  scenes.take(question);
  arrange();
}

function arrange() {
  $("overlay").setAttribute("aria-pressed", overlaid);
  $("pair").classList.toggle("overlaid", overlaid);
  $("both").hidden = !overlaid;
  plots.overlaid = overlaid;
  $("pair").style.setProperty("--least", `${plots.least}px`);
}

export function fit() {
  if (!plots.question) return;
  plots.draw();
  cursor.draw();
}

function toggleOverlay() {
  overlaid = !overlaid;
  try {
    localStorage.setItem("prefcal-overlay", overlaid ? "yes" : "no");
  } catch {
    // No local storage: the choice is not remembered.
  }
  arrange();
  fit();
}

export function toggleZoom() {
  plots.zoomToTarget();
  if (plots.question?.has_scene) cursor.enter(); // the scenes show the same time as the curves
}

export const toggleTable = () => table.toggle();
export const resetZoom = () => plots.reset();
export const moveCursor = (steps) => cursor.step(steps);
export const togglePlay = () => scenes.toggle();
export { toggleOverlay };

export function inWords(question) {
  const told = (name) => {
    const side = question[name];
    const met = side.kpis.filter((kpi) => kpi.met !== null);
    const words = met.map((kpi) =>
      `${kpi.title} ${withUnit(kpi.text, kpi.unit)}, objective ${kpi.met ? "met" : "missed"}`);
    return `${name}: ${words.slice(0, 3).join("; ") || side.ended}`;
  };
  return `${told("left")}. ${told("right")}.`;
}

export const repeat = () => act("repeat", {});
