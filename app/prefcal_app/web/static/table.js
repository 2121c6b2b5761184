// Compare two experiments KPI by KPI in one table, in the order of the heads.

import { $, el, fill, keep, kept, symbol, table, verdict, withUnit } from "./dom.js";

const NAMES = { worst: "Worst maneuver", mean: "Mean of all maneuvers" };
let open = false;
let shown = null;
let usual = true;
let bare = false;

export function start() {
  open = kept("prefcal-compare") === "yes";
  $("compare-toggle").addEventListener("click", toggle);
}

export function toggle() {
  open = !open;
  keep("prefcal-compare", open ? "yes" : "no");
  draw();
}

export function take(question) {
  shown = question.comparison;
  usual = !question.notes; // a study knows what is usual
  bare = !question.panels.length; // there are no curves: the table is all there is to see
  draw();
}

function draw() {
  const some = Boolean(shown?.length);
  $("compare-toggle").disabled = !some;
  $("compare-toggle").setAttribute("aria-expanded", (open || bare) && some);
  $("compare").hidden = !((open || bare) && some);
  if ($("compare").hidden) return;
  const groups = [...new Set(shown.map(({ group }) => group))];
  if (groups.length > 1) {
    fill($("compare"), el("div", { class: "tables grouped" }, groups.map((group) =>
      compared(shown.filter((row) => row.group === group), NAMES[group] ?? group))));
    return;
  }
  const differing = shown.filter((row) => row.size > 0);
  const alike = shown.filter((row) => !(row.size > 0));
  const half = differing.length > 6 ? Math.ceil(differing.length / 2) : differing.length;
  fill($("compare"), differing.length ? el("div", { class: "tables" },
    [differing.slice(0, half), differing.slice(half)].filter((rows) => rows.length).map((rows) => compared(rows))) : el("p", {}, "No KPI differs."),
    alike.length && differing.length ? el("p", { class: "faint" }, "The same on both sides: ",
      alike.flatMap((row, k) => [k ? ", " : "", ...symbol(row.title), ` ${withUnit(row.left.text, row.unit)}`])) : null);
}

function compared(rows, group = "KPI") {
  const about = usual ? "The difference compared with the spread of all experiments so far" : "The difference compared with the larger value";
  const last = el("span", { title: about }, usual ? "vs usual" : "relative");
  const head = group === "KPI" ? group : el("span", { class: "group" }, group);
  return table([head, "Left", "Right", "right − left", last], rows.map(row), { kinds: ["", "number left", "number right", "number", "usual"] });
}

function row({ title, about, unit, objective, left, right, difference, better, size }) {
  const bar = el("span", { class: "size" }, el("span", { class: better ?? "" }));
  bar.firstChild.style.width = `${Math.max(100 * size, 2)}%`;
  return { title: about || null, cells: [[symbol(title), objective ? el("span", { class: "faint" }, ` ${objective}`) : null],
    value(left, unit, better === "left"), value(right, unit, better === "right"), difference || "–",
    [bar, el("span", { class: "hidden" }, `${Math.round(100 * size)} %`)]] };
}

function value({ text, met }, unit, better) {
  return el("span", { class: `${{ true: "met", false: "missed" }[met] ?? ""}${better ? " better" : ""}` }, withUnit(text, unit),
    verdict(met), better ? el("span", { class: "hidden" }, " (better)") : null);
}
