// Where are we: the best so far, what was tried, what was learned, and how sure the answers are.

import { get } from "./api.js";
import { bestCard } from "./best.js";
import { $, el, fill } from "./dom.js";
import { open } from "./main.js";
import { slice, tried } from "./miniature.js";

export async function showStatus(now, act) {
  const view = $("view-status");
  const title = el("h2", { id: "status-title" }, "Where are we");
  if (!view.firstChild) fill(view, title, el("p", {}, "Loading…"));
  let status;
  try {
    status = await get("/api/status");
  } catch (error) {
    return fill(view, title, el("p", {}, error.message));
  }
  const { answered, comparisons, experiments, n_max: most } = now.progress;
  const verdicts = Object.entries(status.verdicts).map(([words, count]) => `${words} ${count}`).join(" · ");
  fill(view, title,
    el("p", {}, `${experiments} of ${most} experiments, ${answered} of ${comparisons} comparisons: ${verdicts}.`),
    bestCard(status.best), consistency(status.consistency, act),
    el("h3", {}, "θ tried"), el("p", { class: "faint" }, "Star: the best so far. Rings: were the best for a while. Crosses: marked unsafe."),
    plots("tried", status.tried.knobs, (knob) => `${knob.name} of every experiment`),
    el("h3", {}, "What was learned"),
    status.slices ? [el("p", { class: "faint" }, "The learned cost along each knob through the best θ (dotted). Lower is better; only the order has a meaning."),
      plots("slice", status.slices.map((s) => s.knob), (knob) => `Learned cost along ${knob.name}`)]
      : el("p", {}, "Nothing is learned yet: that takes an answer other than “can't tell”, and an agent that learns."),
    table(status.tried));
  view.querySelectorAll("[data-plot=tried]").forEach((div, k) => tried(div, status.tried.knobs[k], k, status.tried.experiments));
  view.querySelectorAll("[data-plot=slice]").forEach((div, k) => slice(div, status.slices[k]));
  return undefined;
}

const plots = (kind, knobs, words) => el("div", { class: "grid" }, knobs.map((knob) =>
  el("div", { class: "figure", role: "img", "aria-label": words(knob), data: { plot: kind } })));

function consistency({ text, can_repeat: can }, act) {
  const again = el("button", { type: "button", disabled: !can, on: { click: async () => {
    if (await act("repeat", {})) open("now");
  } } }, "Ask me an earlier question again ", el("kbd", {}, "R"));
  return el("div", {}, el("h3", {}, "How consistent are the answers?"), el("p", {}, text), el("p", {}, again,
    el("span", { class: "faint" }, " It teaches nothing: it only shows how sure you are.")));
}

function table({ knobs, experiments }) {
  const heads = ["experiment", ...knobs.map((k) => (k.unit && k.unit !== "-" ? `${k.name} [${k.unit}]` : k.name)), "ended", "marks"];
  const rows = experiments.map((e) => el("tr", { class: e.best ? "best" : "" }, el("th", { scope: "row" }, e.number, e.best ? " (best)" : ""),
    e.text.map((text) => el("td", { class: "number" }, text)), el("td", {}, e.ended), el("td", {}, e.marks.join(", "))));
  return el("details", {}, el("summary", {}, "All θ as a table"),
    el("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "All θ" }, el("table", {},
      el("thead", {}, el("tr", {}, heads.map((text) => el("th", { scope: "col" }, text)))), el("tbody", {}, rows))));
}
