// The end: what came out, where the report is, and how to go on all the same.

import { bestCard, pictures } from "./best.js";
import { $, ask, copied, el, fill } from "./dom.js";

const REASONS = {
  "all compared": "All experiments are compared", "good enough": "The best is good enough",
  stopped: "You have finished the study",
};

export function showOver(now, act) {
  const { over, progress } = now;
  const button = (words, run, kind = "") => el("button", { type: "button", class: kind, on: { click: run } }, words);
  const command = el("code", {}, over.command);
  const actions = [
    button("Close prefcal", close, "primary"),
    over.reason === "all compared" ? null : button("Go on comparing", () => act("go_on", { more: 0 })),
    button("10 more experiments", () => act("go_on", { more: 10 })),
    now.can_undo ? button("Undo last answer", () => act("undo", { version: now.version }, "last answer taken back")) : null,
  ];
  fill($("view-over"), el("div", { class: "hero" },
    el("span", { class: "done", "aria-hidden": "true" }, "✓"),
    el("div", {}, el("h2", { id: "over-title" }, `${REASONS[over.reason] ?? over.reason}.`),
      el("p", { class: "faint" }, `${progress.experiments} experiments, ${progress.answered} comparisons. Everything is saved.`)),
    el("p", { class: "actions" }, actions)), bestCard(over.best, "The result"),
  el("h3", {}, "Report"), pictures(over.report),
  el("h3", {}, "The study again"), el("p", { class: "command" }, command,
    button("Copy", (event) => copied(over.command, event.target)), el("span", { class: "faint" }, "repeats it from the start")),
  el("p", { class: "command" }, el("code", {}, now.study.again),
    button("Copy", (event) => copied(now.study.again, event.target)), el("span", { class: "faint" }, "opens this one again")));

  async function close() {
    if (await act("close", {})) {
      ask("Closed", el("p", {}, "Everything is saved. You may close this tab."), []);
    }
  }
}
