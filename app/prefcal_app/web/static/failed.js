// Show an experiment that could not run, or a study file that could not be written.

import { $, el, fill, symbol, withUnit } from "./dom.js";

export function showFailed(now, act) {
  const { pending, problem } = now;
  const title = pending ? `Experiment ${pending.number} ${now.live ? "was not completed" : "did not run"}` : "That did not work";
  const button = (words, run, kind = "") => el("button", { type: "button", class: kind, on: { click: run } }, words);
  fill($("view-failed"), el("h2", { id: "failed-title" }, title),
    el("p", { class: "problem" }, problem),
    pending ? el("dl", { class: "values" }, pending.theta.map((knob) => el("div", {},
      el("dt", {}, symbol(knob.name)), el("dd", {}, withUnit(knob.text, knob.unit))))) : null,
    el("p", {}, "Each answer was saved when you gave it."),
    el("p", { class: "actions" },
      button("Try again", () => act("retry", {}), "primary"),
      pending ? button("Count it as failed", () => act("fail", { index: pending.index, reason: problem ?? "" })) : null));
}
