// Show the status: the best so far, what was tried and learned, and how consistent the answers are.

import { get } from "./api.js";
import { bestCard } from "./best.js";
import { $, el, fill, symbol } from "./dom.js";
import { open } from "./flow.js";
import { GROUPS, named, slice, tried } from "./miniature.js";

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
  const chosen = document.activeElement?.id === "pace"; // a change redraws everything
  fill(view, title, el("div", { class: "columns" }, bestCard(status.best), answers(now, status, act)),
    outlook(status.outlook),
    el("h3", {}, "θ tried"), legend(status.tried.experiments),
    figures("tried", status.tried.knobs, (knob) => `${knob.name} of every experiment`),
    table(status.tried),
    el("h3", {}, "What was learned"),
    status.trust ? el("p", { class: "faint" }, status.trust, " To get that sum as a Python function: ", el("code", {}, "prefcal studies index")) : null,
    status.slices ? [el("p", { class: "faint" }, "The learned cost along each knob through the best θ, with every experiment at its learned cost. Lower is better; only the order matters."),
      figures("slice", status.slices.map((s) => s.knob), (knob) => `Learned cost along ${knob.name}`)]
      : status.trust ? null : el("p", {}, "Nothing has been learned yet. That needs an answer other than “can't tell”, and an agent that learns."));
  if (chosen) $("pace")?.focus();
  view.querySelectorAll("[data-plot=tried]").forEach((div, k) => tried(div, status.tried.knobs[k], k, status.tried.experiments));
  view.querySelectorAll("[data-plot=slice]").forEach((div, k) => slice(div, status.slices[k]));
  return undefined;
}

// Show whether to continue and, if the best is at the end of a range, how to widen it.
function outlook(found) {
  if (!found) return [];
  return el("div", { class: "card" }, el("h3", {}, "Continue or stop?"),
    found.sentences.map((words) => el("p", {}, symbol(words))),
    found.command ? el("p", {}, el("code", {}, found.command)) : null);
}

// Explain the signs that are in the pictures, and no others.
const legend = (experiments) => el("p", { class: "marks-legend faint" }, GROUPS.filter(({ test }) => experiments.some(test))
  .map(({ sign, kind, words }) => el("span", {}, el("span", { class: `sign ${kind}`, "aria-hidden": "true" }, sign), words)));

const figures = (kind, knobs, words) => el("div", { class: "grid" }, knobs.map((knob) =>
  el("div", { class: "figure", role: "img", "aria-label": words(knob), data: { plot: kind } })));

// Show how many answers there are, and whether they agree.
function answers(now, status, act) {
  const { text, can_repeat: can } = status.consistency;
  const { given, experiments, n_max: most } = now.progress;
  const again = el("button", { type: "button", disabled: !can, on: { click: async () => {
    if (await act("repeat", {})) open("now");
  } } }, "Ask me an earlier question again ", el("kbd", {}, "P"));
  return el("div", { class: "card" }, el("h3", {}, "Your answers"),
    el("p", {}, `${experiments} of ${most} experiments, ${given} ${given === 1 ? "comparison" : "comparisons"}.`, status.simulated ? ` ${status.simulated.line}.` : ""),
    pace(status.questions, act),
    el("h3", {}, "How consistent are they?"), el("p", {}, text), el("p", {}, again),
    el("p", { class: "faint" }, "Nothing is learned from it: it only shows how consistent you are."));
}

// Let the person choose the maximum number of comparisons for each experiment.
function pace(most, act) {
  if (most === null) return null;
  const choices = [...new Set([1, 2, 3, 4, 6, 12, most])].sort((a, b) => a - b);
  const select = el("select", { id: "pace", on: { change: () => act("pace", { questions: Number(select.value) }) } },
    choices.map((n) => el("option", { value: n, selected: n === most }, n)));
  return el("p", { class: "pace" }, el("label", { for: "pace" }, "Comparisons for each experiment, at most "), select,
    el("span", { class: "faint" }, most === 1 ? " Allow more if experiments are expensive: follow-up comparisons need no new run."
      : " Those after the first need no new run."));
}

function table({ knobs, experiments }) {
  const heads = ["experiment", ...knobs.map(named), "ended", "marks"];
  const rows = experiments.map((e) => el("tr", { class: e.best ? "best" : "" }, el("th", { scope: "row" }, e.number, e.best ? " (best)" : ""),
    e.text.map((text) => el("td", { class: "number" }, text)), el("td", {}, e.ended), el("td", {}, e.marks.join(", "))));
  return el("details", {}, el("summary", {}, "All θ as a table"),
    el("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "All θ" }, el("table", {},
      el("thead", {}, el("tr", {}, heads.map((text, k) => el("th", { scope: "col", class: k && k <= knobs.length ? "number" : null }, text)))), el("tbody", {}, rows))));
}
