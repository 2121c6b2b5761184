// The two experiments: words above, curves below, one cursor, one zoom and one clock for both.

import { act, current, mark } from "./flow.js";
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
  $("pair").classList.toggle("overlaid", overlaid);
  $("both").hidden = !overlaid;
  plots.overlaid = overlaid;
  $("pair").style.setProperty("--least", `${plots.least}px`);
  requestAnimationFrame(() => {
    plots.draw();
    scenes.draw();
    cursor.draw();
  });
}

export function fit() {
  const question = current()?.question;
  if (!question) return;
  for (const side of ["left", "right"]) numbers(side, question[side]);
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

export function toggleZoom() {
  plots.zoomToTarget();
  if (current()?.question?.has_scene) cursor.enter(); // the scenes show what the curves show
}

export const resetZoom = () => plots.reset();
export const moveCursor = (steps) => cursor.step(steps);
export const togglePlay = () => scenes.toggle();
export { toggleOverlay };

// One side in words: title, KPIs, θ, marks; and the places of scene and curves.
function describe(name, question) {
  const side = question[name];
  const title = { left: "Left", right: "Right" }[name];
  const parts = [
    el("header", {}, el("h2", { id: `${name}-title` }, title), el("p", { class: "which", title: which(side) || null }, which(side)),
      el("div", { class: "marks", id: `${name}-marks` })),
    el("div", { id: `${name}-numbers` }), thetas(side),
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
  numbers(name, side);
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
  if (side.runs > 1) words.push(`${side.runs} runs, the first bold`);
  return words.join(" · ");
}

// The KPIs with an objective (else the first three), on two lines (four narrow ones) at most; the rest one click away.
function numbers(name, side) {
  const main = side.kpis.filter((kpi) => kpi.met !== null);
  const first = main.length ? main : side.kpis.slice(0, 3);
  const rest = side.kpis.filter((kpi) => !first.includes(kpi));
  const shown = el("dl", { class: "kpis" }, first.map(item));
  const more = el("dl", { class: "kpis" }, rest.map(item));
  const count = el("summary", {});
  const details = el("details", { open: $(`${name}-numbers`)?.querySelector("details")?.open }, count, more);
  const block = el("div", { class: "numbers", id: `${name}-numbers` }, shown, details);
  $(`${name}-numbers`).replaceWith(block);
  if (details.open) block.classList.add("all");
  details.addEventListener("toggle", () => block.classList.toggle("all", details.open));
  const tell = () => {
    details.hidden = !more.childElementCount;
    count.textContent = `${more.childElementCount} more`;
  };
  tell();
  const line = 1.75 * parseFloat(getComputedStyle(block).fontSize);
  const lines = block.clientWidth < 420 ? 4 : 2;
  while (!details.open && block.offsetHeight > lines * line && shown.childElementCount > 1) {
    more.prepend(shown.lastElementChild);
    tell();
  }
}

export function item(kpi) {
  const verdict = { true: "met", false: "missed" }[kpi.met] ?? "";
  const sign = { met: " ✓", missed: " ✗" }[verdict] ?? "";
  return el("div", { class: verdict, title: kpi.objective ? `objective: ${kpi.objective}` : null },
    el("dt", {}, symbol(kpi.title)), el("dd", {}, withUnit(kpi.text, kpi.unit),
      sign ? el("span", { "aria-hidden": "true" }, sign) : null,
      verdict ? el("span", { class: "hidden" }, ` (objective ${verdict})`) : null));
}

export function thetas(side) {
  if (!side.theta.length) return null;
  return el("dl", { class: "theta" }, side.theta.map((knob) =>
    el("div", { class: knob.differs ? "differs" : "" }, el("dt", {}, symbol(knob.name)),
      el("dd", {}, withUnit(knob.text, knob.unit),
        knob.differs ? el("span", { class: "hidden" }, " (differs)") : null))));
}

function marks(name, side) {
  const unsafe = side.marks.includes("unsafe");
  $(name).classList.toggle("unsafe", unsafe || side.counts_as_unsafe);
  const buttons = Object.entries(MARKS).map(([kind, { words, [name]: key }]) =>
    el("button", { type: "button", class: `mark ${kind === "unsafe" ? "bad" : "good"}`,
      id: `${name}-${kind.replace(" ", "-")}`, "aria-pressed": String(side.marks.includes(kind)),
      title: counted(side, kind) ? "It counts as unsafe because its run was interrupted, whether you mark it or not." : null,
      on: { click: () => mark(name, kind) } }, `${counted(side, kind) ? "Unsafe: interrupted" : words} `, el("kbd", {}, key)));
  const active = document.activeElement?.id;
  fill($(`${name}-marks`), buttons);
  if (active) buttons.find((button) => button.id === active)?.focus();
}

const counted = (side, kind) => kind === "unsafe" && side.counts_as_unsafe;

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
