// Where are we: the best so far, what was tried, what was learned, and how sure the answers are.

import { get } from "./api.js";
import { bestCard } from "./best.js";
import { $, el, fill, symbol } from "./dom.js";
import { open } from "./flow.js";
import { named, slice, tried } from "./miniature.js";

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
  const chosen = document.activeElement?.id === "pace"; // changing it draws all anew
  fill(view, title, el("div", { class: "columns" }, bestCard(status.best), answers(now, status, act)),
    cares(status.minded),
    status.advice ? [el("h3", {}, "What would ten more experiments gain?"), el("p", {}, status.advice)] : [],
    el("h3", {}, "θ tried"), legend(),
    figures("tried", status.tried.knobs, (knob) => `${knob.name} of every experiment`),
    table(status.tried),
    el("h3", {}, "What was learned"),
    status.slices ? [el("p", { class: "faint" }, "The learned cost along each knob through the best θ, and the experiments at their own learned cost. Lower is better; only the order has a meaning."),
      figures("slice", status.slices.map((s) => s.knob), (knob) => `Learned cost along ${knob.name}`)]
      : el("p", {}, "Nothing is learned yet: that takes an answer other than “can't tell”, and an agent that learns."));
  if (chosen) $("pace")?.focus();
  view.querySelectorAll("[data-plot=tried]").forEach((div, k) => tried(div, status.tried.knobs[k], k, status.tried.experiments));
  view.querySelectorAll("[data-plot=slice]").forEach((div, k) => slice(div, status.slices[k]));
  return undefined;
}

const legend = () => el("p", { class: "marks-legend faint" }, [["★", "best", "the best so far"], ["○", "was", "was the best for a while"],
  ["●", "other", "another experiment"], ["✕", "bad", "unsafe: marked, or its run was interrupted"]].map(([sign, kind, words]) =>
  el("span", {}, el("span", { class: `sign ${kind}`, "aria-hidden": "true" }, sign), words)));

const figures = (kind, knobs, words) => el("div", { class: "grid" }, knobs.map((knob) =>
  el("div", { class: "figure", role: "img", "aria-label": words(knob), data: { plot: kind } })));

// The answers: how many of each kind, and whether they agree.
function answers(now, status, act) {
  const { verdicts, consistency: { text, can_repeat: can } } = status;
  const { answered, comparisons, experiments, n_max: most } = now.progress;
  const again = el("button", { type: "button", disabled: !can, on: { click: async () => {
    if (await act("repeat", {})) open("now");
  } } }, "Ask me an earlier question again ", el("kbd", {}, "R"));
  const total = Math.max(Object.values(verdicts).reduce((a, b) => a + b, 0), 1);
  const bars = Object.entries(verdicts).map(([words, count]) => {
    const bar = el("span", { class: "share" }, el("span", {}));
    bar.firstChild.style.width = `${(100 * count) / total}%`;
    return el("tr", {}, el("th", { scope: "row" }, words), el("td", { class: "number" }, count), el("td", { "aria-hidden": "true" }, bar));
  });
  return el("div", { class: "card" }, el("h3", {}, "Your answers"),
    el("p", {}, `${answered} of ${comparisons} comparisons, ${experiments} of ${most} experiments.`),
    el("table", { class: "shares" }, el("tbody", {}, bars)), pace(status.questions, act),
    el("h3", {}, "How consistent are they?"), el("p", {}, text), el("p", {}, again),
    el("p", { class: "faint" }, "It teaches nothing: it only shows how sure you are."));
}

// How many comparisons an experiment may take, from now on.
function pace(most, act) {
  if (most === null) return null;
  const choices = [...new Set([1, 2, 3, 4, 6, 12, most])].sort((a, b) => a - b);
  const select = el("select", { id: "pace", on: { change: () => act("pace", { questions: Number(select.value) }) } },
    choices.map((n) => el("option", { value: n, selected: n === most }, n)));
  return el("p", { class: "pace" }, el("label", { for: "pace" }, "Comparisons for each experiment, at most "), select,
    el("span", { class: "faint" }, most === 1 ? " More of them, with experiments that have run, are worth it where a run is dear."
      : " Those after the first need no new run."));
}

// What the person seems to care about: shares as bars, and in words for whoever does not see them.
function cares(minded) {
  const title = el("h3", {}, "What counts for you");
  if (!minded) return el("div", { class: "card" }, title, el("p", { class: "faint" }, "Nothing can be said yet: that takes answers about experiments that differ in their indicators."));
  const rows = minded.bars.map(({ title: words, text, width, rest }) => {
    const bar = el("span", { class: rest ? "share rest" : "share" }, el("span", {}));
    bar.firstChild.style.width = `${100 * width}%`;
    return el("tr", {}, el("th", { scope: "row" }, symbol(words)), el("td", { class: "number" }, text), el("td", { "aria-hidden": "true" }, bar));
  });
  return el("div", { class: "card cares" }, title, el("p", { class: "finding" }, symbol(minded.sentence)),
    rows.length ? el("table", { class: "shares", "aria-label": "Shares of the weights" }, el("tbody", {}, rows)) : null,
    el("p", { class: "faint" }, minded.trust, rows.length ? [" It is learned from your answers alone. As a Python function: ", el("code", {}, "prefcal studies index")] : null));
}

function table({ knobs, experiments }) {
  const heads = ["experiment", ...knobs.map(named), "ended", "marks"];
  const rows = experiments.map((e) => el("tr", { class: e.best ? "best" : "" }, el("th", { scope: "row" }, e.number, e.best ? " (best)" : ""),
    e.text.map((text) => el("td", { class: "number" }, text)), el("td", {}, e.ended), el("td", {}, e.marks.join(", "))));
  return el("details", {}, el("summary", {}, "All θ as a table"),
    el("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "All θ" }, el("table", {},
      el("thead", {}, el("tr", {}, heads.map((text, k) => el("th", { scope: "col", class: k && k <= knobs.length ? "number" : null }, text)))), el("tbody", {}, rows))));
}
