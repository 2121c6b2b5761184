// Show what was simulated unseen: a picture of it, and each point to look at or to ask for.

import { fetched, get } from "./api.js";
import { $, button, el, fill, symbol, table, values } from "./dom.js";
import { can, current, open } from "./flow.js";
import { draw, drawn, step } from "./map.js";
import { showAgain } from "./maneuvers.js";

const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
let data = null;
let which = null; // the axes, chosen by the person; null: those that matter most
let row = null; // the point that is described
let send = null;
let stops = []; // rows on the way from one other candidate over the result to the other
let looked = null; // the row whose curves are on show
let looking = false;
let wished = null; // the θ of the point to describe first, once it is known

// Show the first (0) or second (1) other candidate of the end beside the result.
export function showOther(k) {
  const other = current()?.over?.menu[k];
  if (other) showTheta(other.theta);
}

// Show a simulated θ beside the result.
export function showTheta(theta) {
  wished = String(theta);
  open("simulated");
}

export async function showSimulated(act) {
  send = act;
  const named = wished;
  wished = null;
  if (!$("map")) build();
  let found = null;
  try {
    found = await get("/api/simulated");
  } catch (error) {
    return fill($("map-told"), error.message);
  }
  if (!found) return fill($("map-told"), "The simulations are running: the picture comes with the next question.");
  const key = named ?? (row === null ? null : String(data.points[row].theta));
  data = found;
  const kept = data.points.findIndex(({ theta }) => String(theta) === key);
  row = kept >= 0 ? kept : asked() ?? data.best;
  which ??= [...data.chosen];
  $("map-parts").hidden = false;
  selects();
  ways();
  redraw();
  return named && kept >= 0 && row !== data.best ? look() : undefined;
}

// Return the row of the experiment in question that is not the best; null without a question.
const asked = () => Object.values(data.sides).find((at) => at !== null && at !== data.best) ?? null;

function build() {
  const on = { change: () => {
    which = [Number($("map-x").value), Number($("map-y").value)];
    redraw();
  } };
  const map = el("div", { id: "map", class: "map", tabindex: "0", role: "group", "aria-roledescription": "scatter plot",
    "aria-label": "Everything simulated. Arrow keys go from point to point.", on: { keydown: move } });
  fill($("view-simulated"), el("h2", { id: "simulated-title" }, "Simulated"), el("p", { id: "map-told", class: "faint" }, "Loading…"),
    el("div", { id: "map-parts", hidden: true },
      el("p", { class: "map-axes" }, el("label", {}, "Across ", el("select", { id: "map-x", on })), el("label", {}, "Up ", el("select", { id: "map-y", on }))),
      el("div", { class: "map-columns" }, el("div", { class: "card flat" }, map, el("p", { id: "map-legend", class: "marks-legend faint" })),
        el("section", { id: "point", class: "card", "aria-label": "The chosen point", "aria-live": "polite" })),
      el("div", { id: "ways", class: "card", hidden: true }), el("div", { id: "look", tabindex: "-1" })));
  new ResizeObserver(() => data && picture()).observe(map);
}

// Draw the slider from one other candidate over the result to the other: each stop was simulated.
function ways() {
  const [one = [], two = []] = data.ways, { menu = [] } = current()?.over ?? {};
  stops = [...one.slice(1).reverse(), data.best, ...two.slice(1)];
  const key = String([stops, menu.map(({ name }) => name)]);
  $("ways").hidden = !one.length;
  if (!one.length || $("ways").dataset.key === key) return; // it may be in use
  $("ways").dataset.key = key;
  const ends = menu.map(({ name }, k) => button([symbol(name), " ", el("kbd", {}, String(k + 1))], () => showOther(k)));
  fill($("ways"), el("label", { for: "way" }, "What lies between: each stop was simulated. To choose one is an answer."),
    el("input", { type: "range", id: "way", min: 0, max: stops.length - 1, on: { input: ({ target }) => choose(stops[target.value]) } }),
    el("p", { class: "ends" }, ends[0], ends[1] ?? el("span", {}, "the result")),
    el("p", { class: "actions" }, button([current().simulated.twin ? "Ask for it" : "Choose it", " ", el("kbd", {}, "C")], chooseIt, { id: "choose", class: "primary" }),
      el("output", { for: "way" })));
}

// Say where the slider is, and whether what it shows can be chosen.
function way() {
  if (!$("way")) return;
  const at = stops.indexOf(row), from = stops.indexOf(data.best), far = at < from ? from : stops.length - 1 - from;
  const words = at < 0 ? "another point" : at === from ? "the result"
    : `${Math.abs(at - from)} of ${far} to ${current().over?.menu[at < from ? 0 : 1].name}`;
  if (at >= 0) $("way").value = at;
  $("way").setAttribute("aria-valuetext", words);
  fill(document.querySelector("#ways output"), symbol(words));
  $("choose").disabled = looked !== row || data.points[row]?.number !== null;
}

// Explain the signs that are in the picture, and no others.
function legend() {
  const rows = drawn(data, which).map((at) => at.row), { points, best, sides: { left, right } } = data;
  const shown = (k) => points[k].number !== null;
  return [["●", "faint-dot", "simulated, never shown", (k) => !shown(k)], ["●", "ink", "shown, with its number", (k) => shown(k) && k !== best],
    ["★", "good", "the best so far", (k) => k === best], ["◇", "left", "left of the open question", (k) => k === left],
    ["◇", "right", "right of the open question", (k) => k === right]].filter(([, , , test]) => rows.some(test)).map(([sign, kind, words]) =>
    el("span", {}, el("span", { class: `sign ${kind}`, "aria-hidden": "true" }, sign), words));
}

function selects() {
  const option = (k, chosen) => el("option", { value: k, selected: k === chosen }, data.axes[k].title + (data.axes[k].unit ? ` [${data.axes[k].unit}]` : ""));
  ["map-x", "map-y"].forEach((id, i) => {
    const groups = [["KPIs", false], ["Knobs", true]].map(([label, knob]) => el("optgroup", { label },
      data.axes.map((axis, k) => (axis.knob === knob ? option(k, which[i]) : null))));
    fill($(id), groups);
  });
}

function redraw() {
  fill($("map-told"), told());
  fill($("map-legend"), legend());
  describe();
  picture();
}

const picture = () => $("map").isConnected && draw($("map"), data, which, row, choose);

// Say how many were simulated, and how many of these are not in the picture and why.
function told() {
  const { points } = data;
  const shown = points.filter(({ number }) => number !== null).length;
  const inside = new Set(drawn(data, which).map((at) => at.row));
  const count = (end) => points.filter((point, k) => point.end === end && !inside.has(k)).length;
  const parts = Object.entries({ failed: "failed", stopped: "stopped as unsafe or without any value", "": "without a value of both" })
    .filter(([end]) => count(end)).map(([end, words]) => `${count(end)} ${words}`);
  return [`${points.length} simulated, ${shown} shown. `, parts.length ? `Not drawn: ${parts.join(", ")}. ` : "",
    !current().simulated?.failure ? "" : symbol(`The last that failed: ${current().simulated.failure.replace(/\.?$/, ".")} `),
    "Click a point", el("span", { class: "by-key" }, ", or go from point to point with the arrow keys"), "."];
}

function choose(next) {
  if (next === row) return;
  [row, looked] = [next, null];
  if (!stops.includes(row) || row === data.best) fill($("look")); // while sliding, it stays until the next one is there
  describe();
  picture();
  if (stops.includes(row)) look();
}

function move(event) {
  const arrow = ARROWS[event.key];
  if (!arrow || event.ctrlKey || event.altKey || event.metaKey) return;
  event.preventDefault();
  choose(step($("map"), data, which, row, arrow));
}

function written(point, k) {
  const value = point.values[k];
  if (value === null) return data.axes[k].time && !point.end ? "never" : "–";
  const text = value && Math.abs(value) < 1e-3 ? value.toExponential(1).replace(".0", "") : String(Number(value.toPrecision(4)));
  return text.replaceAll("-", "−");
}

function name({ number }) {
  if (number === null) return "Simulated, never shown";
  return `Experiment ${number}${row === data.best ? ", the best so far" : ""}`;
}

function describe() {
  way();
  if (row === null) return fill($("point"), el("p", { class: "faint" }, "No point is chosen."));
  const point = data.points[row];
  const best = data.best === null || row === data.best ? null : data.points[data.best];
  const knobs = data.axes.filter(({ knob }) => knob);
  const theta = values(knobs.map((knob, k) => ({ name: knob.title, title: knob.about || null, unit: knob.unit, text: point.text[k] })));
  const rows = data.axes.flatMap((axis, k) => (axis.knob ? [] : [{ title: axis.about || null, cells: [
    [symbol(axis.title), axis.unit ? el("span", { class: "faint" }, ` [${axis.unit}]`) : null],
    written(point, k), ...(best ? [written(best, k)] : [])] }]));
  return fill($("point"), el("h3", {}, name(point)), point.end ? el("p", { class: "problem" },
    point.end === "failed" ? "This simulation failed." : "This run was stopped as unsafe, or it has no value of any KPI.") : null, theta, actions(point),
  table(["KPI", "value", ...(best ? ["best so far"] : [])], rows, { class: "kpi-table", kinds: ["", "number", "number faint"] }));
}

function actions(point) {
  const pending = Object.values(data.sides).includes(row) && row !== data.best;
  const tried = point.number !== null && !pending;
  const over = can("go_on");
  const full = !over && data.left_to_ask === 0;
  const why = row === data.best ? "It is the best so far." : tried ? "It was compared already."
    : pending ? "It is in the open question." : full ? "All experiments are compared: answer the last questions first."
      : over ? `This continues the study${data.left_to_ask ? "" : " with one more experiment"}.` : "It replaces the new experiment of the open question, which stays free to be asked for.";
  return [el("p", { class: "actions" },
    button("Look at it", look, { id: "look-at", disabled: row === data.best || point.end === "failed" }),
    button("Ask for it", askFor, { id: "ask-for", class: "primary", disabled: tried || pending || full })),
  el("p", { class: "faint" }, why)];
}

async function askFor(event) {
  event.target.disabled = true;
  // A study that is over goes on for it.
  const on = !can("go_on") || (await send("go_on", { more: data.left_to_ask > 0 ? 0 : 1 }));
  if (on && (await send("ask_for", { theta: data.points[row].theta }, "asked for"))) return open("now");
  return describe();
}

// Choose what is looked at instead of the result: an answer, without another question.
export async function chooseIt() {
  const { theta, number } = data?.points[row] ?? {};
  if (looked === null || looked !== row || number !== null || !can("choose")) return;
  looked = null; // once
  if (!(await send("choose", { theta, best: data.points[data.best].number - 1 }, "chosen"))) return;
  fill($("look"));
  open("now");
}

// Show the curves of the point beside the best so far; while they are fetched, it may become another one.
async function look() {
  if (looking) return;
  looking = true;
  let at, found;
  do {
    at = row;
    found = at === data.best ? null : await fetched($("look"), `/api/look?theta=${encodeURIComponent(data.points[at].theta.join(","))}`);
  } while (at !== row);
  looking = false;
  if (!found) return;
  const { number } = data.points[row], sliding = document.activeElement?.id === "way";
  const title = number === null ? "Simulated for a look: nothing is recorded" : `Experiment ${number} beside the best so far`;
  showAgain($("look"), title, found, { left: ["Best so far", `experiment ${found.question.left.number}`],
    right: ["This one", number === null ? "never shown" : `experiment ${number}`] });
  if (sliding) $("way").focus({ preventScroll: true });
  looked = row;
  way();
}
