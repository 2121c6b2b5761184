// Curves: one figure a side, its panels stacked over one time axis; both sides share all axes.
/* global Plotly */

import { target, whole } from "./axes.js";
import { bounds, css } from "./bounds.js";
import { $, el, fill, symbol } from "./dom.js";

const MARGIN = { l: 46, r: 10, t: 4, b: 22 };
const HEAD = 20; // px above each panel, for its title
const LEAST = { apart: 96, overlaid: 76 }; // px of a panel with its title; overlaid, the words of both sides stand above
const COLORS = { left: "--left", right: "--right" };

export class Plots {
  overlaid = false;
  onzoom = () => {};
  #question = null;
  #unit = "";
  #x = [0, 1];
  #y = [];
  #view = null;
  #zoomed = false;
  #drawing = 0;

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

  // The lowest figure in which every panel can be read, in px.
  get least() {
    return (this.overlaid ? LEAST.overlaid : LEAST.apart) * this.panels.length;
  }

  get range() {
    return this.#view.x;
  }

  get end() {
    return this.#x[1];
  }

  height(i) {
    return this.#y[i][1] - this.#y[i][0];
  }

  // Axes that hold both sides, and what is drawn beside the curves.
  take(question, unit) {
    this.#question = question;
    this.#unit = unit;
    ({ x: this.#x, y: this.#y } = whole(question));
    this.#set({ x: this.#x, y: this.#y }, false);
  }

  #set(view, zoomed) {
    this.#view = view;
    this.#zoomed = zoomed;
    this.onzoom(zoomed);
  }

  reset() {
    this.#set({ x: this.#x, y: this.#y }, false);
    this.draw();
  }

  zoomToTarget() {
    if (!this.#question) return;
    if (this.#zoomed) return this.reset();
    this.#set(target(this.#question, { x: this.#x, y: this.#y }), true);
    this.draw();
  }

  draw() {
    if (!this.#question || typeof Plotly === "undefined") {
      if (this.#question) addEventListener("load", () => this.draw(), { once: true });
      return;
    }
    this.#drawing += 1;
    for (const name of this.shown) {
      const div = $(`${name}-plot`);
      if (!div || !div.clientWidth) continue;
      const fresh = !div.classList.contains("js-plotly-plot");
      const height = Math.max(div.clientHeight, this.least);
      Plotly.react(div, this.#traces(name), this.#layout(div.clientWidth, height),
        { displayModeBar: false, responsive: false, doubleClick: false, showTips: false });
      if (fresh) this.#listen(div);
      this.#heads(div, name, height);
    }
    this.#drawing -= 1;
  }

  #listen(div) {
    div.on("plotly_relayout", (change) => this.#relaid(change));
    div.on("plotly_doubleclick", () => this.reset());
  }

  #relaid(change) {
    if (this.#drawing) return;
    const view = { x: [...this.#view.x], y: this.#view.y.map((range) => [...range]) };
    let changed = false;
    for (const [key, value] of Object.entries(change)) {
      const found = /^(x|y)axis(\d*)\.range\[(\d)\]$/.exec(key);
      if (!found) continue;
      const range = found[1] === "x" ? view.x : view.y[Number(found[2] || 1) - 1];
      range[Number(found[3])] = value;
      changed = true;
    }
    if (!changed) return;
    this.#set(view, true);
    this.draw();
  }

  #traces(name) {
    const sides = name === "both" ? ["left", "right"] : [name];
    const traces = [];
    for (const side of sides) {
      const dash = name === "both" && side === "right" ? "6px,3px" : "solid";
      this.panels.forEach((panel, i) => {
        const axis = i ? `y${i + 1}` : "y";
        const shape = panel.shape === "step" ? "hv" : "linear";
        const line = { color: css(COLORS[side]), width: 2, shape, dash,
          simplify: false }; // plotly's shortcut shows kinks where the plant has none
        const common = { type: "scatter", mode: "lines", yaxis: axis, hoverinfo: "skip" };
        const reference = this.#question[side].references[i];
        if (reference) {
          traces.push({ ...common, x: reference.t, y: reference.y,
            line: { color: css("--muted"), width: 1.2, shape: "hv", dash: "3px,3px" } });
        }
        this.#question[side].curves[i].forEach((curve, run) => traces.push({ ...common,
          x: curve.t, y: curve.y, line: run ? { ...line, width: 1 } : line, opacity: run ? 0.45 : 1 }));
      });
    }
    return traces;
  }

  // Where panel i lies, in px from the top.
  place(i, height) {
    const each = (height - MARGIN.t - MARGIN.b) / this.panels.length;
    return { top: MARGIN.t + i * each + HEAD, bottom: MARGIN.t + (i + 1) * each - 4 };
  }

  #layout(width, height) {
    const inner = height - MARGIN.t - MARGIN.b;
    const grid = { gridcolor: css("--grid"), zeroline: false, linecolor: css("--grid"),
      tickfont: { color: css("--muted"), size: 11 }, ticklen: 0, automargin: false };
    const layout = {
      width, height, margin: { ...MARGIN, pad: 0 }, showlegend: false, hovermode: false,
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", dragmode: "zoom",
      font: { family: "system-ui, sans-serif" }, shapes: [],
      xaxis: { ...grid, range: [...this.#view.x], anchor: `y${this.panels.length > 1 ? this.panels.length : ""}`,
        ticksuffix: this.#unit ? ` ${this.#unit}` : "", showticksuffix: "last", nticks: 10 },
    };
    this.panels.forEach((panel, i) => {
      const { top, bottom } = this.place(i, height);
      const at = (px) => Math.min(Math.max(1 - (px - MARGIN.t) / inner, 0), 1);
      layout[i ? `yaxis${i + 1}` : "yaxis"] = { ...grid, range: [...this.#view.y[i]],
        domain: [at(bottom), at(top)], anchor: "x", nticks: 5 };
      layout.shapes.push(...bounds(panel, i ? `y${i + 1}` : "y"));
    });
    return layout;
  }

  // Titles and read-outs, and the line of the cursor, above the figure.
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
      const { top } = this.place(i, height);
      const head = el("p", { class: "head" }, el("span", {}, symbol(panel.title),
        panel.unit ? ` [${panel.unit}]` : "", this.#aims(panel)), el("output", {}));
      head.style.top = `${top - HEAD + 1}px`;
      return head;
    }));
    layer.style.height = `${height}px`;
    div.dataset.height = height;
    div.dispatchEvent(new CustomEvent("drawn", { bubbles: true }));
  }

  #aims(panel) {
    const words = [];
    if (panel.target !== null) words.push(`target ${panel.target}${panel.band ? ` ± ${panel.band}` : ""}`);
    if (panel.low !== null && panel.high !== null) words.push(`limits ${panel.low} to ${panel.high}`);
    else if (panel.high !== null) words.push(`limit ${panel.high}`);
    else if (panel.low !== null) words.push(`at least ${panel.low}`);
    return words.length ? ` · ${words.join(" · ")}` : "";
  }

  time(div, clientX) {
    const { left, width } = div.getBoundingClientRect();
    const share = (clientX - left - MARGIN.l) / (width - MARGIN.l - MARGIN.r);
    const [from, to] = this.range;
    return share < 0 || share > 1 ? null : from + share * (to - from);
  }

  // Where a value of panel i is, in px from the top; null where it is out of sight.
  level(div, i, value) {
    const { top, bottom } = this.place(i, Number(div.dataset.height));
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
