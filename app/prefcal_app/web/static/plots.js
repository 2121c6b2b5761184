// Draw the curves: one figure per side. Both sides share all axes: the study's, unless zoomed.
/* global Plotly */

import { DARK, el, fill, symbol } from "./dom.js";
import { HEAD, MARGIN, aims, layout, place, traces } from "./figure.js";
import { EVENTS, TARGET, WHOLE, applies, dragged, following, recalled, remember, view } from "./zoom.js";

const LEAST = { apart: 88, overlaid: 76, small: 120 }; // minimum px of a panel with its title
// On a small screen the page scrolls instead: a panel stays large enough to be read.
export const SMALL = matchMedia("(max-width: 600px), (max-height: 520px)");
const CONFIG = { displayModeBar: false, responsive: false, doubleClick: false, showTips: false };

export class Plots {
  overlaid = false;
  remembers = false; // whether what is chosen here also holds for the next question
  onzoom = () => {};
  #cell;
  #question = null;
  #unit = "";
  #all = null;
  #view = null;
  #zoom = EVENTS;
  #drawing = 0;
  #drawn = new Map(); // by figure: what it showed last, as JSON
  #watch = new ResizeObserver(() => this.draw());

  // `cell(name)` returns the element of the figure "left", "right" or "both", or null.
  constructor(cell) {
    this.#cell = cell;
  }

  get panels() {
    return this.#question?.panels ?? [];
  }

  get question() {
    return this.#question;
  }

  get unit() {
    return this.#unit;
  }

  get shown() {
    return this.overlaid ? ["both"] : ["left", "right"];
  }

  // Return the minimum height of a figure with readable panels, in px.
  get least() {
    return LEAST[SMALL.matches ? "small" : this.overlaid ? "overlaid" : "apart"] * this.panels.length + MARGIN.b - 16;
  }

  get range() {
    return this.#view.x;
  }

  get end() {
    return this.#all.x[1];
  }

  cell(name) {
    return this.#cell(name);
  }

  height(i) {
    return this.#all.y[i][1] - this.#all.y[i][0];
  }

  take(question, unit) {
    this.#question = question;
    this.#unit = unit;
    this.#all = question.axes;
    this.#drawn.clear();
    this.#set(recalled());
  }

  #set(zoom) {
    this.#zoom = zoom;
    this.#view = view(zoom, this.#question, this.#all);
    this.onzoom(applies(zoom, this.#question));
  }

  #choose(zoom) {
    this.#set(zoom);
    if (this.remembers) remember(zoom);
    this.draw();
  }

  // Show the next part of the time in which things happen, or the whole time; again: the first part.
  reset() {
    if (this.#question) this.#choose(following(this.#zoom, this.#question));
  }

  zoomToTarget() {
    if (this.#question) this.#choose(applies(this.#zoom, this.#question) ? EVENTS : TARGET);
  }

  // Show all of the time if `time` is outside the present part.
  reveal(time) {
    const [from, to] = this.range;
    if (time >= from && time <= to) return;
    this.#set(WHOLE);
    this.draw();
  }

  // Draw the figures whose curves, axes, colors or size changed.
  draw() {
    if (!this.#question) return;
    if (typeof Plotly === "undefined") {
      addEventListener("load", () => this.draw(), { once: true });
      return;
    }
    for (const name of this.shown) {
      const div = this.#cell(name);
      if (!div) continue;
      this.#watch.observe(div);
      const size = { width: div.clientWidth, height: Math.max(div.clientHeight, this.least) };
      const now = JSON.stringify([size, this.#view, DARK.matches, this.#question.id]);
      if (!size.width || this.#drawn.get(name) === now) continue;
      this.#drawn.set(name, now);
      this.#put(div, name, size);
    }
  }

  #put(div, name, size) {
    const made = { data: traces(this.#question, name), layout: layout(this.#question, name, this.#view, this.#unit, size) };
    const look = ({ yaxis, line, opacity }) => [yaxis, line, opacity];
    const frame = JSON.stringify([made.layout, made.data.map(look)]);
    const fresh = !div.classList.contains("js-plotly-plot");
    this.#drawing += 1;
    if (!fresh && frames.get(div) === frame) renew(div, made.data);
    else Plotly.react(div, made.data, made.layout, CONFIG);
    frames.set(div, frame);
    if (fresh) this.#listen(div);
    this.#heads(div, name, size.height);
    this.#drawing -= 1;
  }

  #listen(div) {
    div.on("plotly_relayout", (change) => this.#relaid(change));
    div.on("plotly_doubleclick", () => this.reset());
  }

  #relaid(change) {
    if (this.#drawing) return;
    const seen = { x: [...this.#view.x], y: this.#view.y.map((range) => [...range]) };
    let changed = false;
    for (const [key, value] of Object.entries(change)) {
      const found = /^(x|y)axis(\d*)\.range\[(\d)\]$/.exec(key);
      if (!found) continue;
      const range = found[1] === "x" ? seen.x : seen.y[Number(found[2] || 1) - 1];
      range[Number(found[3])] = value;
      changed = true;
    }
    if (!changed) return;
    for (const name of this.shown) frames.delete(this.#cell(name)); // plotly moved its axes itself
    this.#choose(dragged(this.#question, seen));
  }

  // Put titles, readouts and the cursor line above the figure.
  #heads(div, name, height) {
    let layer = div.querySelector(".over-plot");
    if (!layer) {
      layer = el("div", { class: "over-plot", "aria-hidden": "true" });
      div.append(layer);
    }
    const sides = name === "both" ? ["left", "right"] : [name];
    const dots = this.panels.flatMap((_, i) => sides.map((side) =>
      el("i", { class: `dot ${side}`, data: { side, panel: i }, hidden: true })));
    fill(layer, el("div", { class: "cursor", hidden: true }), dots, this.panels.map((panel, i) => {
      const { top, bottom } = place(i, this.panels.length, height);
      const drawn = { sides: sides.map((side) => this.#question[side]), range: this.#view.y[i], height: bottom - top };
      const head = el("p", { class: "head" }, el("span", {}, symbol(panel.title),
        panel.unit ? ` [${panel.unit}]` : "", aims(panel, i, drawn)), el("output", {}));
      head.style.top = `${top - HEAD + 1}px`;
      return head;
    }));
    // A title that is too long is drawn smaller: its end says the limits.
    for (const { firstChild: title } of layer.querySelectorAll(".head")) {
      const share = (title.clientWidth - 2) / title.scrollWidth; // letters do not shrink evenly: 2 px to spare
      if (title.scrollWidth > title.clientWidth) title.style.fontSize = `max(9px, ${100 * share}%)`;
    }
    layer.style.height = `${height}px`;
    div.dataset.height = height;
    div.dispatchEvent(new CustomEvent("drawn", { bubbles: true }));
  }

  time(div, clientX) {
    const { left, width } = div.getBoundingClientRect();
    const share = (clientX - left - MARGIN.l) / (width - MARGIN.l - MARGIN.r);
    const [from, to] = this.range;
    return share < 0 || share > 1 ? null : from + share * (to - from);
  }

  // Return the position of a value in panel i, in px from the top; null if it is not visible.
  level(div, i, value) {
    const { top, bottom } = place(i, this.panels.length, Number(div.dataset.height));
    const [low, high] = this.#view.y[i];
    const share = (value - low) / (high - low);
    return share < 0 || share > 1 ? null : bottom - share * (bottom - top);
  }

  pixel(div, time) {
    const [from, to] = this.range;
    const share = (time - from) / (to - from);
    return share < 0 || share > 1 ? null : MARGIN.l + share * (div.clientWidth - MARGIN.l - MARGIN.r);
  }
}

const frames = new WeakMap(); // by figure: axes and styles it was drawn with

// Replace only the curves on unchanged axes, which takes a tenth of the time of a full drawing.
function renew(div, data) {
  Plotly.animate(div, { data: data.map(({ x, y }) => ({ x, y })), traces: data.map((_, k) => k) },
    { mode: "immediate", transition: { duration: 0 }, frame: { duration: 0, redraw: false } });
}
