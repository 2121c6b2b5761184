// The best experiment in numbers, as several views show it.

import { copied, el, symbol, withUnit } from "./dom.js";

export function bestCard(best) {
  if (!best) return el("p", {}, "There is no experiment yet.");
  const copy = el("button", { type: "button", on: { click: (event) => copied(best.copy, event.target) } }, "Copy θ");
  const theta = el("dl", { class: "values" }, best.theta.map((knob) =>
    el("div", {}, el("dt", {}, symbol(knob.name)), el("dd", {}, withUnit(knob.text, knob.unit)))));
  return el("div", { class: "card" }, el("h3", {}, `Best so far: experiment ${best.number}`),
    best.marks.length ? el("p", {}, `Marked ${best.marks.join(", ")}.`) : null, theta, kpiTable(best.kpis), copy);
}

function kpiTable(kpis) {
  if (!kpis.length) return null;
  const rows = kpis.slice(0, 9).map((kpi) => el("tr", { class: { true: "met", false: "missed" }[kpi.met] ?? "" },
    el("th", { scope: "row" }, symbol(kpi.title)), el("td", { class: "number" }, withUnit(kpi.text, kpi.unit)),
    el("td", {}, kpi.objective), el("td", {}, { true: "✓ met", false: "✗ missed" }[kpi.met] ?? "")));
  return el("div", { class: "scroll" }, el("table", {}, el("thead", {}, el("tr", {},
    ["", "value", "objective", ""].map((text) => el("th", { scope: "col" }, text)))), el("tbody", {}, rows)));
}

export function pictures(report) {
  if (!report) return el("p", {}, "The report is being written…");
  return el("div", {}, el("p", {}, "Report: ", el("code", {}, report.place)),
    el("div", { class: "pictures" }, report.pictures.map((source) => el("img", { src: source, loading: "lazy",
      alt: source.split("/").pop().replace(/\.\w+$/, "").replaceAll("_", " ") }))));
}
