// Show two experiments: text above, curves below, and one cursor and zoom for both.

import { act } from "./flow.js";
import { $, DARK, el, fill, keep, kept, symbol, withUnit } from "./dom.js";
import { Cursor } from "./cursor.js";
import { Maneuvers } from "./maneuvers.js";
import { Plots, SMALL } from "./plots.js";
import { describe, headline, marks, told } from "./side.js";
import * as table from "./table.js";

const plots = new Plots((name) => $(`${name}-plot`));
const cursor = new Cursor(plots);
let overlaid = false;
let maneuvers = null;
let unit = "";
let headed = ""; // how many KPIs the heads of both sides show, and titles in their order

export function start() {
  $("view-question").append(
    el("section", { id: "compare", class: "compare", "aria-label": "All KPIs of both sides", tabindex: "0", hidden: true }),
    el("div", { id: "maneuvers", class: "maneuvers", role: "group", "aria-label": "Maneuvers", hidden: true }),
    el("div", { id: "pair", class: "pair" }, ["left", "right"].map((id) => el("section", { id, class: "side", "aria-labelledby": `${id}-title` })),
      el("section", { id: "both", class: "side", "aria-label": "Both experiments in one plot", hidden: true })));
  // On a screen too narrow for two sides, show both in one plot.
  overlaid = matchMedia("(max-width: 600px)").matches;
  const chosen = kept("prefcal-overlay");
  if (chosen) overlaid = chosen === "yes";
  $("overlay").addEventListener("click", toggleOverlay);
  $("zoom").addEventListener("click", toggleZoom);
  plots.remembers = true;
  SMALL.addEventListener("change", () => {
    arrange();
    fit();
  });
  plots.onzoom = (zoomed) => $("zoom").setAttribute("aria-pressed", zoomed);
  cursor.start($("pair"));
  table.start();
  maneuvers = new Maneuvers($("maneuvers"), showPart, jumpTo);
  DARK.addEventListener("change", () => {
    plots.draw();
    maneuvers.draw();
  });
  fill($("both"), el("p", { class: "legend" }, el("span", { class: "key left", id: "key-left" }, "Left"),
    el("span", { class: "key right", id: "key-right" }, "Right")),
  el("div", { class: "plot", id: "both-plot", role: "img", "aria-label": "Both experiments" }));
}

// Show the text of a question; `fit` draws the curves once the layout is known.
export function show(now, same) {
  const { question } = now;
  const { headline: titles, heads } = question;
  const before = headed;
  headed = [heads, ...titles].join();
  const stays = same && headed === before; // the sentence may come later, and the heads follow it
  if (same && !stays) maneuvers.head(titles, heads);
  for (const side of ["left", "right"]) {
    if (stays) marks(side, question[side]);
    else describe(side, question);
    if (same && !stays) told(side, maneuvers.part);
  }
  if (!stays) table.take(question);
  if (same) return;
  unit = now.scenario.time_unit;
  maneuvers.take(question);
}

// Show one maneuver, or the whole experiment if it has no others.
function showPart(part) {
  for (const side of ["left", "right"]) {
    told(side, part);
    $(`key-${side}`).hidden = part[side].empty; // nothing of it is drawn
  }
  plots.take(part, unit);
  cursor.reset();
  arrange();
  if (!$("view-question").hidden) fit();
}

function arrange() {
  $("overlay").setAttribute("aria-pressed", overlaid);
  $("pair").classList.toggle("overlaid", overlaid);
  $("both").hidden = !overlaid;
  plots.overlaid = overlaid;
  $("pair").style.setProperty("--least", `${plots.least}px`);
}

export function fit() {
  $("pair").classList.toggle("bare", !plots.panels.length);
  if (!plots.panels.length) return;
  plots.draw();
  cursor.draw();
}

function toggleOverlay() {
  overlaid = !overlaid;
  keep("prefcal-overlay", overlaid ? "yes" : "no");
  arrange();
  fit();
}

function jumpTo(time) {
  plots.reveal(time);
  cursor.put(time);
}

export const jump = () => maneuvers.jump();
export const showManeuver = (k) => maneuvers.choose(k);
export const toggleTable = () => table.toggle();
export const toggleZoom = () => plots.zoomToTarget();
export const resetZoom = () => plots.reset();
export const moveCursor = (steps) => cursor.step(steps);
export { toggleOverlay };

export function inWords(question) {
  const words = (name) => {
    const side = question[name];
    const verdict = { true: ", objective met", false: ", objective missed" };
    const kpis = headline(side.kpis, question).map((kpi) =>
      `${kpi.title} ${withUnit(kpi.text, kpi.unit)}${verdict[kpi.met] ?? ""}`);
    return `${name}: ${kpis.join("; ") || side.ended}`;
  };
  return `${words("left")}. ${words("right")}.`;
}

export const repeat = () => act("repeat", {});

let declined = false; // the person goes on: the same offer is not made again

export function startOffer() {
  $("offer-finish").addEventListener("click", () => act("finish", {}));
  $("offer-go-on").addEventListener("click", () => {
    declined = true;
    $("offer").hidden = true;
    dispatchEvent(new Event("resize")); // the curves fill the remaining space
    $("verdict-left").focus();
  });
}

// Show why the open question is asked, and offer to stop where that is worth considering.
export function offer({ blind, good_enough: good, question, screening }) {
  const words = [];
  if (good) words.push(`You marked ${good.number ? `experiment ${good.number}, the` : "the"} best so far, as good enough.`);
  const unlikely = declined ? "" : screening?.offer ?? "";
  if (unlikely) words.push(unlikely);
  $("offer").hidden = !words.length;
  fill($("offer-text"), symbol(words.join(" ")));
  $("offer-go-on").hidden = !unlikely;
  // Its place is kept while the reason is worked out, so that nothing moves when it comes.
  $("why").hidden = !screening || blind || question.repeat;
  fill($("why"), symbol(screening?.why || "\u00a0"));
}
