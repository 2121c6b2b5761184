// Show the maneuvers of two experiments: both curves of each at a glance, and a tab for each.

import { Cursor } from "./cursor.js";
import { button, css, el, fill, say, svg } from "./dom.js";
import { Plots } from "./plots.js";
import { summary, thetas } from "./side.js";

const WIDE = 200, HIGH = 48; // units of a small picture, stretched to its tab

// Return a question for each maneuver, with its own panels, axes and curves.
export const parts = (question) => [question, ...question.others.map((part) => ({ ...question, ...part,
  left: { ...question.left, ...part.left }, right: { ...question.right, ...part.right } }))];

export class Maneuvers {
  #box;
  #shown;
  #jump;
  #parts = [];
  #chosen = 0;
  #jumped = -1;

  // `shown(part)` draws a maneuver; it is called once a question is taken or a tab is chosen.
  // `jumped(time)` moves the cursor.
  constructor(box, shown, jumped) {
    this.#box = box;
    this.#shown = shown;
    this.#jump = jumped;
  }

  get part() {
    return this.#parts[this.#chosen];
  }

  // Take a question, and stay with the maneuver that was looked at last.
  take(question) {
    const name = this.part?.maneuver;
    this.#parts = parts(question);
    this.#jumped = -1;
    this.#choose(Math.max(this.#parts.findIndex((part) => part.maneuver === name), 0));
  }

  // The sentence above came later than the question, and its KPIs come first.
  head(headline, heads) {
    this.#parts = this.#parts.map((part) => ({ ...part, headline, heads }));
  }

  choose(k) {
    if (k === this.#chosen || !this.#parts[k]) return;
    this.#jumped = -1;
    this.#choose(k);
    say(`${this.part.maneuver}, maneuver ${k + 1} of ${this.#parts.length}`);
  }

  #choose(k) {
    this.#chosen = k;
    this.draw();
    this.#shown(this.part);
  }

  // Go to where the two sides differ most; again: to the next maneuver by largest difference.
  jump() {
    const order = this.#parts.filter((part) => part.differ).sort((a, b) => b.differ.size - a.differ.size);
    if (!order.length) return say("The curves do not differ.");
    this.#jumped = (this.#jumped + 1) % order.length;
    const part = order[this.#jumped], k = this.#parts.indexOf(part);
    if (k !== this.#chosen) this.#choose(k);
    const { t, panel, size } = part.differ;
    this.#jump(t);
    return say(`Largest difference${part.maneuver ? ` in ${part.maneuver}` : ""}: ${part.panels[panel].title}, ${Math.round(100 * size)} % of its axis, at ${t}`);
  }

  // Draw the tabs; their colors follow the theme.
  draw() {
    const several = Boolean(this.#parts[0]?.maneuver);
    this.#box.hidden = !several;
    if (!several) return fill(this.#box);
    const focused = [...this.#box.children].indexOf(document.activeElement);
    const most = Math.max(...this.#parts.map(({ differ }) => differ?.size ?? 0));
    fill(this.#box, this.#parts.map((part, k) => tab(part, k, k === this.#chosen, most, () => this.choose(k))),
      button(["Largest difference ", el("kbd", {}, "J")], () => this.jump(),
        { class: "jump", title: "Go to where the two sides differ most; again: in the next maneuver" }));
    return this.#box.children[focused]?.focus();
  }
}

function tab(part, k, chosen, most, choose) {
  const ended = ["left", "right"].filter((side) => part[side].part?.interrupted)
    .map((side) => el("span", { class: "bad" }, `${side} ${part[side].part.ended}`));
  const differs = part.differ?.size ? `differ by ${Math.round(100 * part.differ.size)} %` : "no difference";
  return button([el("span", { class: "name" }, part.maneuver, k < 9 ? el("kbd", { "aria-hidden": "true" }, String(k + 1)) : null),
    picture(part), el("span", { class: "faint" }, ended.length ? ended : differs)], choose,
  { class: part.differ?.size === most ? "tab most" : "tab", "aria-pressed": String(chosen),
    title: `Show the maneuver ${part.maneuver}. The sides ${part.differ?.size ? `${differs} of the axis` : "do not differ"}.` });
}

// Draw the first panel of a maneuver with both sides, and where they differ most.
function picture({ panels, axes, left, right, differ }) {
  const [from, to] = axes.x, [low, high] = axes.y[0];
  const x = (t) => (WIDE * (t - from)) / (to - from), y = (v) => HIGH * (1 - (v - low) / (high - low));
  const made = svg("svg", { viewBox: `0 0 ${WIDE} ${HIGH}`, preserveAspectRatio: "none", "aria-hidden": "true" });
  const line = (d, color, more = {}) => made.append(svg("path", { d, stroke: css(color), "stroke-width": 1, ...more }));
  if (panels[0].target !== null) line(`M0 ${y(panels[0].target)}H${WIDE}`, "--good", { "stroke-dasharray": "1 3" });
  if (differ) line(`M${x(differ.t)} 0V${HIGH}`, "--muted", { "stroke-dasharray": "3 3" });
  for (const side of [left, right]) {
    const [reference] = side.references;
    if (reference) line(path(reference, x, y, true), "--good", { "stroke-dasharray": "1 3" });
  }
  for (const [name, side] of [["left", left], ["right", right]]) {
    for (const curve of side.curves[0]) line(path(curve, x, y, panels[0].shape === "step"), `--${name}`, { "stroke-width": 1.7 });
  }
  return made;
}

function path({ t, y: values }, x, y, held) {
  let drawn = "", pen = "M";
  values.forEach((value, k) => {
    if (value === null) pen = "M"; // a gap in the curve
    else {
      drawn += held && pen === "L" ? `H${x(t[k]).toFixed(1)}V${y(value).toFixed(1)}` : `${pen}${x(t[k]).toFixed(1)} ${y(value).toFixed(1)}`;
      pen = "L";
    }
  });
  return drawn;
}

// Show two experiments again below `place`: same axes and cursor, and tabs for maneuvers. `heads`
// holds title, words and chip of each side.
export function showAgain(place, title, { question, time_unit: unit }, heads, comment = "") {
  const close = button("Close", () => fill(place));
  fill(place, el("div", { class: "card-head" }, el("h3", {}, title),
    comment ? el("span", { class: "faint" }, `“${comment}”`) : null, close),
  el("div", { class: "pair small" }, ["left", "right"].map((name) => again(name, question, heads[name]))));
  figures(place, question, unit);
  place.scrollIntoView({ block: "nearest" });
  place.focus({ preventScroll: true });
  say(title);
}

function again(name, question, [title, which, chip]) {
  const shown = question[name];
  return el("section", { class: `side ${name}`, "aria-label": title },
    el("header", {}, el("h4", {}, title), el("p", { class: "which" }, which),
      chip ? el("span", { class: "chip good" }, chip) : null),
    el("dl", { class: "kpis" }, summary(shown, question)), thetas(shown),
    el("div", { class: "plot", role: "img", "aria-label": shown.stories.join(". "), data: { side: name } }));
}

function figures(place, question, unit) {
  const pair = place.querySelector(".pair");
  const plots = new Plots((name) => pair.querySelector(`[data-side=${name}]`));
  const cursor = new Cursor(plots);
  const box = el("div", { class: "maneuvers", role: "group", "aria-label": "Maneuvers" });
  pair.before(box);
  cursor.start(pair);
  new Maneuvers(box, (part) => {
    plots.take(part, unit);
    cursor.reset();
    pair.style.setProperty("--least", `${1.25 * plots.least}px`);
    for (const name of ["left", "right"]) plots.cell(name).setAttribute("aria-label", part[name].stories.join(". "));
    plots.draw();
  }, (time) => cursor.put(time)).take(question);
}
