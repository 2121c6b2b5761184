// Show the best experiment in numbers, for several views.

import { copied, el, symbol, withUnit } from "./dom.js";

const MOST = 9; // KPIs shown here; the report has all of them

// Show θ of the best experiment, and its KPIs unless they are shown elsewhere.
export function bestCard(best, title = "Best so far", numbers = true) {
  if (!best) return el("p", {}, "There are no experiments yet.");
  const copy = el("button", { type: "button", on: { click: (event) => copied(best.copy, event.target) } }, "Copy θ");
  const theta = el("dl", { class: "values" }, best.theta.map((knob) =>
    el("div", {}, el("dt", {}, symbol(knob.name)), el("dd", {}, withUnit(knob.text, knob.unit)))));
  return el("div", { class: "card best" },
    el("div", { class: "card-head" }, el("h3", {}, `${title}: experiment ${best.number}`),
      best.marks.map((mark) => el("span", { class: `chip ${mark.startsWith("unsafe") ? "bad" : "good"}` }, mark)), copy),
    theta, numbers ? kpiTable(best.kpis) : null);
}

function kpiTable(kpis) {
  if (!kpis.length) return null;
  const rows = kpis.slice(0, MOST).map((kpi) => el("tr", { class: { true: "met", false: "missed" }[kpi.met] ?? "" },
    el("th", { scope: "row" }, symbol(kpi.title)), el("td", { class: "number" }, withUnit(kpi.text, kpi.unit)),
    el("td", { class: "faint" }, kpi.objective), el("td", {}, { true: "✓ met", false: "✗ missed" }[kpi.met] ?? "")));
  const heads = ["KPI", "value", "objective", "verdict"];
  return el("div", { class: "scroll" }, el("table", { class: "kpi-table" }, el("thead", {}, el("tr", {},
    heads.map((text, k) => el("th", { scope: "col", class: k === 1 ? "number" : null }, text)))), el("tbody", {}, rows)));
}
