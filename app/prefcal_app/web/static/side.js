// Show one experiment: title, KPIs, θ and marks, with space for its curves.

import { mark } from "./flow.js";
import { $, button, el, fill, symbol, verdict, withUnit } from "./dom.js";
import { toggle } from "./table.js";

const MARKS = { unsafe: { left: "Q", right: "E", words: "Unsafe or very bad", short: "Unsafe" },
  "good enough": { left: "A", right: "D", words: "Good enough", short: "Good" } };
const TITLES = { left: "Left", right: "Right" };

// Create the card once; a new question only changes its content, so the figures are kept.
function card(name) {
  const part = (id) => el("div", { class: id, id: `${name}-${id}` });
  fill($(name), el("header", {}, el("h2", { id: `${name}-title` }, TITLES[name]),
    el("p", { class: "which", id: `${name}-which` }), part("marks")),
  part("numbers"), part("thetas"), part("empty"),
  el("div", { class: "plot", id: `${name}-plot`, role: "img" }));
}

export function describe(name, question) {
  if (!$(`${name}-plot`)) card(name);
  const side = question[name];
  const words = which(side, question.others.length + 1);
  $(`${name}-which`).textContent = words;
  $(`${name}-which`).title = words;
  numbers(name, question);
  const theta = thetas(side);
  fill($(`${name}-thetas`), theta ? [theta] : []);
  marks(name, side);
}

// Show what belongs to the maneuver on the screen: its KPIs, and its curves in words.
export function told(name, question) {
  const { [name]: side, maneuver } = question;
  $(`${name}-empty`).textContent = side.empty ? "This run failed and left no record." : "";
  $(`${name}-plot`).setAttribute("aria-label", `${TITLES[name]}: ${side.stories.join(". ")}`);
  $(`${name}-here`)?.remove();
  if (!maneuver || !side.part) return;
  $(`${name}-numbers`).append(el("dl", { class: "kpis here", id: `${name}-here` },
    group(maneuver, side.part.interrupted ? side.part.ended : ""), headline(side.part.kpis, question).map(item)));
}

const group = (title, words = "") => el("div", {}, el("dt", { class: "group" }, title), el("dd", {}, words));

// Return the main KPIs of a side; of several maneuvers they are the worst.
export const summary = (side, question) => [side.part ? group("worst") : null, ...headline(side.kpis, question).map(item)];

function which(side, maneuvers) {
  const words = side.name ? [side.name] : [];
  if (side.number) words.push(`experiment ${side.number}`);
  if (side.role) words.push(side.role);
  if (side.interrupted) words.push(side.ended);
  if (side.runs > 1) words.push(`${side.runs} runs, the first bold`);
  if (maneuvers > 1) words.push(`${maneuvers} maneuvers`);
  return words.join(" · ");
}

// Show the KPIs that tell the two sides apart; the table has all of them.
function numbers(name, question) {
  const side = question[name], shown = summary(side, question);
  const all = button(`all ${side.kpis.length}`, toggle, { class: "link" });
  $(`${name}-numbers`).style.setProperty("--lines", Math.max(question.heads + 1, 5)); // a long title takes two
  fill($(`${name}-numbers`), el("dl", { class: "kpis" }, shown), side.kpis.length > question.heads ? all : null);
}

// Return the KPIs in the head of a side, in the order that both sides have: what the sentence names,
// then what tells them apart.
export const headline = (kpis, { headline: order, heads }) =>
  order.slice(0, heads).flatMap((title) => kpis.filter((kpi) => kpi.title === title));

export function item(kpi) {
  const told = [kpi.about, kpi.objective ? `objective: ${kpi.objective}` : ""].filter(Boolean).join(" · ");
  return el("div", { class: { true: "met", false: "missed" }[kpi.met], title: told || null },
    el("dt", {}, symbol(kpi.title)), el("dd", {}, withUnit(kpi.text, kpi.unit), verdict(kpi.met),
      kpi.objective ? el("span", { class: "faint" }, " ", symbol(kpi.objective)) : null));
}

export function thetas(side) {
  if (!side.theta.length) return null;
  return el("dl", { class: "theta" }, side.theta.map((knob) =>
    el("div", { class: knob.differs ? "differs" : "", title: knob.about || null }, el("dt", {}, symbol(knob.name)),
      el("dd", {}, withUnit(knob.text, knob.unit),
        knob.differs ? el("span", { class: "hidden" }, " (differs)") : null))));
}

export function marks(name, side) {
  const unsafe = Boolean(side.marks?.includes("unsafe"));
  $(name).classList.toggle("unsafe", unsafe || side.counts_as_unsafe);
  if (!side.marks) return; // a run without a study
  const buttons = Object.entries(MARKS).map(([kind, { words, short, [name]: key }]) =>
    el("button", { type: "button", class: `mark ${kind === "unsafe" ? "bad" : "good"}`,
      id: `${name}-${kind.replace(" ", "-")}`, "aria-pressed": String(side.marks.includes(kind)), disabled: kind === "good enough" && side.counts_as_unsafe,
      title: counted(side, kind) ? "It counts as unsafe because its run was interrupted, whether or not you mark it." : null,
      "aria-label": `${TITLES[name]}: ${counted(side, kind) ? "unsafe: interrupted" : words.toLowerCase()}`,
      on: { click: () => mark(name, kind) } }, el("span", { class: "long" }, counted(side, kind) ? "Unsafe: interrupted" : words),
    el("span", { class: "short" }, short), " ", el("kbd", {}, key)));
  const active = document.activeElement?.id;
  fill($(`${name}-marks`), buttons);
  if (active) buttons.find((button) => button.id === active)?.focus();
}

const counted = (side, kind) => kind === "unsafe" && side.counts_as_unsafe;
