// Show one time cursor in all panels of both sides, with the value of each curve.

import { fill, symbol } from "./dom.js";

// Format to four digits; values that are tiny compared with the axis become 0.
const digits = (value, span) =>
  (Math.abs(value) < 1e-6 * span ? 0 : Number(value.toPrecision(4))).toString().replace("-", "−");

// Return the value of a curve at `time`: held from the last point, or linear between two.
function at({ t, y }, time, held) {
  if (time < t[0] || time > t[t.length - 1]) return null;
  let low = 0, high = t.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (t[middle] <= time) low = middle;
    else high = middle - 1;
  }
  if (held || low === t.length - 1 || y[low] === null || y[low + 1] === null) return y[low];
  return y[low] + ((time - t[low]) / (t[low + 1] - t[low])) * (y[low + 1] - y[low]);
}

export class Cursor {
  #plots;
  #time = null;

  constructor(plots) {
    this.#plots = plots;
  }

  // Follow the pointer over the figures inside `pair`.
  start(pair) {
    pair.addEventListener("mousemove", (event) => {
      const div = event.target.closest?.(".plot");
      const time = div ? this.#plots.time(div, event.clientX) : null;
      if (time !== null) this.put(time);
    });
    pair.addEventListener("drawn", () => this.draw());
  }

  reset() {
    this.#time = null;
  }

  put(time) {
    this.#time = time;
    this.draw();
  }

  // Move by keyboard: each step is a hundredth of the visible range.
  step(steps) {
    const [from, to] = this.#plots.range;
    const start = this.#time ?? from;
    this.put(Math.min(Math.max(start + (steps * (to - from)) / 100, from), to));
  }

  draw() {
    for (const name of this.#plots.shown) {
      const div = this.#plots.cell(name);
      const line = div?.querySelector(".cursor");
      if (!line) continue;
      const pixel = this.#time === null ? null : this.#plots.pixel(div, this.#time);
      line.hidden = pixel === null;
      if (pixel !== null) line.style.left = `${pixel}px`;
      div.querySelectorAll("output").forEach((output, i) => this.#read(output, name, i));
      div.querySelectorAll(".dot").forEach((dot) => this.#mark(dot, div, pixel));
    }
  }

  #mark(dot, div, pixel) {
    const { side, panel } = dot.dataset;
    const value = pixel === null ? null : this.#value(side, Number(panel));
    const level = value === null ? null : this.#plots.level(div, Number(panel), value);
    dot.hidden = level === null;
    if (level === null) return;
    dot.style.left = `${pixel}px`;
    dot.style.top = `${level}px`;
  }

  #value(side, i) {
    const { question, panels } = this.#plots;
    const curve = question[side].curves[i][0];
    return curve ? at(curve, this.#time, panels[i].shape === "step") : null;
  }

  #read(output, name, i) {
    const { panels, unit } = this.#plots;
    const sides = name === "both" ? ["left", "right"] : [name];
    const texts = this.#time === null ? [] : sides.map((side) => {
      const value = this.#value(side, i);
      return value === null ? "–" : digits(value, this.#plots.height(i));
    });
    if (!texts.length) return fill(output);
    fill(output, symbol(panels[i].symbol), ` = ${texts.join(" | ")} @ ${digits(this.#time, this.#plots.end)} ${unit}`);
  }
}
