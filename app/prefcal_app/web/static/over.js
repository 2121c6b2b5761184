// Show the end: what was gained, where the report is, and what to do next.

import { $, ask, button, copying, el, fill, shownTable, symbol, values } from "./dom.js";
import { can, open } from "./flow.js";
import { showNext } from "./history.js";
import { showOther, showTheta } from "./simulated.js";
import { bestCard } from "./status.js";
import { trial } from "./trial.js";
import { verification } from "./verify.js";

const REASONS = {
  "all compared": "All experiments have been compared", "good enough": "The best is good enough",
  stopped: "You finished the study",
};

const link = (words, properties) => el("a", { class: "button", ...properties }, words);

export function showOver(now, act) {
  const { over, progress } = now;
  const { report } = over;
  const typing = document.activeElement?.id === "more"; // when the report comes
  fill($("view-over"), el("div", { class: "hero" },
    el("span", { class: "done", "aria-hidden": "true" }, "✓"),
    el("div", {}, el("h2", { id: "over-title" }, `${REASONS[over.reason] ?? over.words.replace(/^./, (letter) => letter.toUpperCase())}.`),
      el("p", { class: "faint" }, `${progress.experiments} experiments, ${progress.given} comparisons.`)),
    el("p", { class: "actions" },
      report ? link("Open the report", { class: "button primary", href: report.link, target: "_blank", rel: "noopener" })
        : el("span", { class: "faint" }, "The report is being written…"),
      report ? link("Acceptance sheet", { href: report.acceptance, target: "_blank", rel: "noopener" }) : null,
      over.next.download ? link("Download best.json", { href: over.next.download, download: "best.json" }) : null)),
  gained(over.gain), bestCard(over.best, "The result", !over.gain || over.gain.same), steps(now, act),
  report ? el("p", { class: "command" }, el("code", {}, report.place), copying(report.place)) : null);
  if (typing) $("more").focus();
}

// Show all KPIs before and after, the largest change first.
function gained(gain) {
  if (!gain || !gain.table.rows.length) return null;
  return el("div", { class: "card gain" }, el("h3", {}, gain.same ? "What was gained" : gain.title),
    gain.same ? el("p", {}, gain.none) : shownTable(gain.table),
    gain.before.length ? [el("h3", {}, "The way back"), el("p", { class: "faint" }, gain.back), values(gain.before)] : null);
}

// Show what to do next: continue, use the controller, widen a range, or close.
function steps(now, act) {
  const { over, study, progress } = now;
  const more = $("more") ?? el("input", { type: "number", id: "more", min: "1", max: "1000", value: "10", "aria-label": "More experiments" });
  const on = () => act("go_on", { more: Math.max(1, Math.min(1000, Math.round(Number(more.value)) || 10)) });
  const item = (title, ...parts) => el("li", {}, el("h4", {}, title), ...parts);
  const { outlook } = over.next;
  return el("section", { class: "card steps" }, el("h3", {}, "What next?"), el("ul", {},
    item("Compare more", el("p", { class: "actions" }, more, button("more experiments", on),
      progress.answered >= progress.questions ? null : button("Keep comparing", () => act("go_on", { more: 0 })),
      can("undo") ? button("Undo last answer", () => act("undo", { version: now.version }, "last answer undone")) : null)),
    over.next.python || over.next.forms ? item("Use the controller",
      over.next.forms ? el("details", {}, el("summary", {}, "The PID for your control system: ISA, parallel and series form"), el("p", { class: "faint" }, symbol(over.next.forms.caption)), shownTable(over.next.forms)) : null,
      over.next.export.map((each) => command(each.command, `writes it in ${each.what}`)),
      over.next.python ? command(over.next.python, "builds it in Python") : null) : null,
    outlook ? item("Continue or stop?", outlook.sentences.map((words) => el("p", {}, symbol(words))),
      outlook.command ? command(outlook.command, "widens the range") : null, // the last sentence ends with "for example with:"
      over.decisive || over.smaller ? el("p", { class: "actions" }, over.decisive ? button("Look at that answer again", again) : null,
        over.smaller ? button("Look at the smaller change", () => showTheta(over.smaller)) : null) : null) : null,
    over.menu.length ? item("Or do you prefer one of these?", el("p", {}, "People who answer like you might. Look at one beside the result, and at what lies between them."),
      el("p", { class: "actions" }, over.menu.map(({ name }, k) => [button(name, () => showOther(k), { class: "other" }), el("kbd", {}, String(k + 1))]))) : null,
    over.trial ? item("Try it on the plant", trial(over.trial)) : null,
    over.next.verifies ? item("Will it hold on the plant?", verification()) : null,
    item("Come back", command(study.again, "opens this study again"), command(over.command, "repeats it from the start")),
    item("Done", el("p", { class: "actions" }, button("Close prefcal", close), el("span", { class: "faint" }, "ends the command in the terminal")))));

  function again() {
    showNext(over.decisive);
    open("history");
  }

  async function close() {
    if (await act("close", {})) {
      ask("Closed", el("p", {}, "You can close this tab."), []);
    }
  }
}

const command = (text, what) => el("p", { class: "command" }, el("code", {}, text), copying(text), el("span", { class: "faint" }, what));
