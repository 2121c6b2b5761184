// The two experiments: words above, curves below, one cursor, one zoom and one clock for both.

import { act, current, mark } from "./main.js";
import { $, el, fill, symbol, withUnit } from "./dom.js";
import { Cursor } from "./cursor.js";
import { Plots } from "./plots.js";
import { Scenes } from "./scene.js";

const plots = new Plots();
const scenes = new Scenes((time) => cursor.put(time));
const cursor = new Cursor(plots, (time) => scenes.follow(time));
let overlaid = false;

const MARKS = { unsafe: { left: "Q", right: "E", words: "Unsafe, very bad" },
  "good enough": { left: "A", right: "D", words: "Good enough" } };

export function start() {
  try {
    overlaid = localStorage.getItem("prefcal-overlay") === "yes";
  } catch {
    // Nothing is remembered then.
  }
  $("overlay").addEventListener("click", toggleOverlay);
  $("zoom").addEventListener("click", toggleZoom);
  $("overlay").setAttribute("aria-pressed", overlaid);
  plots.onzoom = (zoomed) => $("zoom").setAttribute("aria-pressed", zoomed);
  scenes.start();
  cursor.start();
  addEventListener("resize", fit);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => plots.draw());
  $("theme").addEventListener("click", () => {
    const root = document.documentElement.dataset;
    root.theme = root.theme === "dark" ? "light" : "dark";
    try {
      localStorage.setItem("prefcal-theme", root.theme);
    } catch {
      // For this time only.
    }
    plots.draw();
    scenes.draw();
  });
}

export function show(now, same) {
  const { question } = now;
  for (const side of ["left", "right"]) {
    if (same) marks(side, question[side]);
    else describe(side, question);
  }
  $("offer").hidden = !now.good_enough;
  if (now.good_enough) {
    const which = now.good_enough.number ? `Experiment ${now.good_enough.number}, the` : "The";
    $("offer-text").textContent = `${which} best so far, is good enough, you said.`;
  }
  if (same) return;
  plots.take(question, now.scenario.time_unit);
  cursor.reset();
  scenes.take(question);
  layout();
}

function layout() {
  const scenic = current()?.question?.has_scene ?? false;
  $("pair").classList.toggle("overlaid", overlaid);
  $("pair").classList.toggle("scenic", scenic);
  $("both").hidden = !overlaid;
  plots.overlaid = overlaid;
  requestAnimationFrame(() => {
    plots.draw();
    scenes.draw();
    cursor.draw();
  });
}

export function fit() {
  if (current()?.phase !== "question") return;
  plots.draw();
  scenes.draw();
  cursor.draw();
}

function toggleOverlay() {
  overlaid = !overlaid;
  $("overlay").setAttribute("aria-pressed", overlaid);
  try {
    localStorage.setItem("prefcal-overlay", overlaid ? "yes" : "no");
  } catch {
    // For this time only.
  }
  layout();
}

export const toggleZoom = () => plots.zoomToTarget();
export const resetZoom = () => plots.reset();
export const moveCursor = (steps) => cursor.step(steps);
export const togglePlay = () => scenes.toggle();
export { toggleOverlay };

// One side in words: title, KPIs, θ, marks; and the places of scene and curves.
function describe(name, question) {
  const side = question[name];
  const title = { left: "Left", right: "Right" }[name];
  const parts = [
    el("header", {}, el("h2", { id: `${name}-title` }, title), el("p", { class: "which" }, which(side)),
      el("div", { class: "marks", id: `${name}-marks` })),
    kpis(side), thetas(side),
  ];
  if (question.has_scene) {
    parts.push(el("canvas", { class: "scene", id: `${name}-scene`, role: "img",
      "aria-label": `Road seen from above, ${title.toLowerCase()} experiment` }));
  }
  if (side.empty) parts.push(el("p", { class: "empty" }, "This run failed and left no record."));
  const story = side.stories.join(". ");
  parts.push(el("div", { class: "plot", id: `${name}-plot`, role: "img",
    "aria-label": `${title}: ${story}` }));
  fill($(name), parts);
  marks(name, side);
  if (!$("both").firstChild) {
    fill($("both"), el("p", { class: "legend" }, el("span", { class: "key left" }, "Left"),
      el("span", { class: "key right" }, "Right")),
    el("div", { class: "plot", id: "both-plot", role: "img", "aria-label": "Both experiments" }));
  }
}

function which(side) {
  const words = [];
  if (side.number) words.push(`experiment ${side.number}`, side.role);
  if (side.interrupted) words.push(side.ended);
  if (side.runs > 1) words.push(`${side.runs} runs, the first one bold`);
  return words.join(" · ");
}

function kpis(side) {
  const list = el("dl", { class: "kpis" });
  const main = side.kpis.filter((kpi) => kpi.met !== null);
  const first = main.length ? main : side.kpis.slice(0, 3);
  for (const kpi of first) list.append(item(kpi));
  const rest = side.kpis.filter((kpi) => !first.includes(kpi));
  if (!rest.length) return list;
  const more = el("dl", { class: "kpis" }, rest.map(item));
  return el("div", { class: "numbers" }, list,
    el("details", {}, el("summary", {}, `${rest.length} more`), more));
}

function item(kpi) {
  const verdict = { true: "met", false: "missed" }[kpi.met] ?? "";
  const sign = { met: " ✓", missed: " ✗" }[verdict] ?? "";
  return el("div", { class: verdict, title: kpi.objective ? `objective: ${kpi.objective}` : null },
    el("dt", {}, symbol(kpi.title)), el("dd", {}, withUnit(kpi.text, kpi.unit),
      sign ? el("span", { "aria-hidden": "true" }, sign) : null,
      verdict ? el("span", { class: "hidden" }, ` (objective ${verdict})`) : null));
}

function thetas(side) {
  if (!side.theta.length) return null;
  return el("dl", { class: "theta" }, side.theta.map((knob) =>
    el("div", { class: knob.differs ? "differs" : "" }, el("dt", {}, symbol(knob.name)),
      el("dd", {}, withUnit(knob.text, knob.unit),
        knob.differs ? el("span", { class: "hidden" }, " (differs)") : null))));
}

function marks(name, side) {
  const unsafe = side.marks.includes("unsafe");
  $(name).classList.toggle("unsafe", unsafe);
  const buttons = Object.entries(MARKS).map(([kind, { words, [name]: key }]) =>
    el("button", { type: "button", class: `mark ${kind === "unsafe" ? "bad" : "good"}`,
      id: `${name}-${kind.replace(" ", "-")}`, "aria-pressed": String(side.marks.includes(kind)),
      on: { click: () => mark(name, kind) } }, `${words} `, el("kbd", {}, key)));
  const active = document.activeElement?.id;
  fill($(`${name}-marks`), buttons);
  if (active) buttons.find((button) => button.id === active)?.focus();
}

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
