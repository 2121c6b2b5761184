// Show the status: the best so far, what was tried and learned, and how consistent the answers are.

import { load } from "./api.js";
import { $, button, copying, counted, el, symbol, table, values, verdict, withUnit } from "./dom.js";
import { open } from "./flow.js";
import { GROUPS, named, slice, tried } from "./miniature.js";

const MOST = 9; // KPIs shown with the best experiment; the report has all of them

export async function showStatus(now, act) {
  const view = $("view-status");
  const chosen = document.activeElement?.id === "pace"; // a change redraws everything
  let shown = null;
  await load(view, el("h2", { id: "status-title" }, "Where are we"), "/api/status", (status) => {
    shown = status;
    return [el("div", { class: "columns" }, bestCard(status.best), answers(now, status, act)), outlook(status.outlook),
      el("h3", {}, "θ tried"), legend(status.tried.experiments),
      figures("tried", status.tried.knobs, (knob) => `${knob.name} of every experiment`), everyTheta(status.tried), ...learned(status)];
  });
  if (chosen) $("pace")?.focus();
  view.querySelectorAll("[data-plot=tried]").forEach((div, k) => tried(div, shown.tried.knobs[k], k, shown.tried.experiments));
  view.querySelectorAll("[data-plot=slice]").forEach((div, k) => slice(div, shown.slices[k]));
}

function learned({ slices, trust }) {
  const told = [el("h3", {}, "What was learned")];
  if (trust) told.push(el("p", { class: "faint" }, trust));
  if (slices) {
    told.push(el("p", { class: "faint" }, "The learned cost along each knob through the best θ, with every experiment at its learned cost. Lower is better; only the order matters."),
      figures("slice", slices.map((s) => s.knob), (knob) => `Learned cost along ${knob.name}`));
  } else if (!trust) told.push(el("p", {}, "Nothing has been learned yet. That needs an answer other than “can't tell”, and an agent that learns."));
  return told;
}

// Show θ of the best experiment, and its KPIs unless they are shown elsewhere.
export function bestCard(best, title = "Best so far", numbers = true) {
  if (!best) return el("p", {}, "There are no experiments yet.");
  return el("div", { class: "card best" },
    el("div", { class: "card-head" }, el("h3", {}, `${title}: experiment ${best.number}`),
      best.marks.map((mark) => el("span", { class: `chip ${mark.startsWith("unsafe") ? "bad" : "good"}` }, mark)), copying(best.copy, "Copy θ")),
    values(best.theta), numbers && best.kpis.length ? kpiTable(best.kpis) : null);
}

const kpiTable = (kpis) => table(["KPI", "value", "objective"], kpis.slice(0, MOST).map((kpi) =>
  [symbol(kpi.title), [withUnit(kpi.text, kpi.unit), verdict(kpi.met)], kpi.objective]), { class: "kpi-table", kinds: ["", "number", "faint"] });

// Show whether to continue and, if the best is at the end of a range, how to widen it.
function outlook(found) {
  if (!found) return null;
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
  const repeat = async () => {
    if (await act("repeat", {})) open("now");
  };
  return el("div", { class: "card" }, el("h3", {}, "Your answers"),
    el("p", {}, `${experiments} of ${counted(most, "experiment")}, ${counted(given, "comparison")}.`, status.simulated ? ` ${status.simulated.line}.` : ""),
    status.simulated?.failure ? el("p", { class: "faint" }, symbol(`The last that failed: ${status.simulated.failure}`)) : null,
    pace(status.questions, act),
    el("h3", {}, "How consistent are they?"), el("p", {}, text),
    el("p", {}, button(["Ask me an earlier question again ", el("kbd", {}, "P")], repeat, { disabled: !can })),
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

function everyTheta({ knobs, experiments }) {
  const rows = experiments.map((e) => ({ kind: e.best ? "best" : "",
    cells: [[e.number, e.best ? " (best)" : ""], ...e.text, e.ended, e.marks.join(", ")] }));
  const heads = ["experiment", ...knobs.map(named), "ended", "marks"];
  return el("details", {}, el("summary", {}, "All θ as a table"),
    table(heads, rows, { label: "All θ", kinds: ["", ...knobs.map(() => "number")] }));
}
