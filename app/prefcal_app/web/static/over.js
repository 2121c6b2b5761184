// Show the end: what you got, why this one, whether it holds, and what to do next.

import { $, DARK, ask, button, copying, counted, el, fill, folded, shownTable, symbol, values } from "./dom.js";
import { can, open, state } from "./flow.js";
import { showNext } from "./history.js";
import { showOther, showTheta } from "./simulated.js";
import { bestCard } from "./status.js";
import { Plots, SMALL } from "./plots.js";
import { trial } from "./trial.js";
import { verification, writing } from "./verify.js";

const REASONS = {
  "all compared": "All questions are answered", "good enough": "The best is good enough",
  stopped: "You finished the study",
};

const link = (words, properties) => el("a", { class: "button", ...properties }, words);

export function showOver(now, act) {
  const { over, progress } = now;
  const reason = `${REASONS[over.reason] ?? over.words.replace(/^./, (letter) => letter.toUpperCase())}.`;
  const typing = document.activeElement?.id === "more"; // when the report comes
  fill($("view-over"), el("div", { class: "hero" },
    el("div", {}, el("h2", { id: "over-title" }, symbol(over.gain?.headline || reason)),
      el("p", { class: "faint" }, symbol(`${over.gain?.headline ? `${reason} ` : ""}${counted(progress.experiments, "experiment")}, ${counted(progress.given, "comparison")}.`)))),
  el("div", { class: "columns" }, el("div", {}, bestCard(over.best, "The result", !over.gain || over.gain.same), gained(over)),
    el("div", {}, holds(over), steps(now, act), reasons(over))));
  if (typing) $("more").focus();
}

const sentences = (all) => all.map((words) => el("p", {}, symbol(words)));

const figure = el("div", { class: "plot", role: "img" });
const plots = new Plots(() => figure);
plots.overlaid = true;
DARK.addEventListener("change", () => plots.draw());
SMALL.addEventListener("change", () => { // as where a phone is turned
  if (figure.isConnected) size();
  plots.draw();
});
const size = () => (figure.style.height = `${(SMALL.matches ? 1 : 1.25) * plots.least}px`);

// Show the curves of the result over those before; they are drawn once there is room for them.
function picture({ curves, table: { columns } }) {
  if (!curves) return null;
  const [before, best] = columns.slice(1).map(({ name }) => name);
  plots.take(curves, curves.time_unit);
  figure.setAttribute("aria-label", `${best}: ${curves.left.stories.join(". ")}. ${before}: ${curves.right.stories.join(". ")}.`);
  size();
  plots.draw();
  return [el("p", { class: "legend" }, el("span", { class: "key right" }, before), el("span", { class: "key left" }, best),
    curves.maneuver ? el("span", { class: "faint" }, curves.maneuver) : null), figure];
}

// Show before and after of the KPIs that gained most and of what that cost, and what is missed.
function gained({ gain, missed }) {
  if (!gain || !gain.table.rows.length) return null;
  const { columns, rows } = gain.table, most = rows.slice(0, gain.first), least = rows.slice(gain.first);
  return el("div", { class: "card gain" }, el("h3", {}, "What you got"),
    gain.same ? el("p", {}, gain.none) : [picture(gain), shownTable({ label: "Most gained, and its cost", columns, rows: most }),
      least.length ? folded("gain-all", counted(least.length, "more KPI"), shownTable({ label: "More KPIs", columns, rows: least })) : null],
    missed ? el("p", {}, missed) : null, gain.noise ? el("p", { class: "faint" }, symbol(gain.noise)) : null,
    gain.before.length ? folded("gain-back", "The way back", el("p", { class: "faint" }, gain.back), values(gain.before)) : null);
}

function reasons({ why, decisive }) {
  if (!why.length) return null;
  const again = () => {
    showNext(decisive);
    open("history");
  };
  return el("section", { class: "card" }, el("h3", {}, "Why this one"), sentences(why),
    decisive ? el("p", { class: "actions" }, button("Look at that answer again", again)) : null);
}

const holds = ({ held: [first, ...more], next }) => (!first && !next.verifies && !next.margins ? null
  : el("section", { class: "card" }, el("h3", {}, "Does it hold?"), sentences([first, next.margins].filter(Boolean)), next.verifies ? verification() : null,
    more.length ? folded("robust", "What the robust study varied, and what that costs", sentences(more)) : null));

// Show what to do next: report and controller first, then whether and how to go on, and all else folded.
function steps(now, act) {
  const { over, study } = now;
  const { report, next } = over;
  return el("section", { class: "card steps" }, el("h3", {}, "What next?"),
    el("p", { class: "actions" },
      report ? link("Open the report", { class: "button primary", href: report.link, target: "_blank", rel: "noopener" })
        : el("span", { class: "faint", id: "writing", role: "status" }, writing()),
      report ? link("Acceptance sheet", { href: report.acceptance, target: "_blank", rel: "noopener" }) : null,
      next.download ? link("Download best.json", { href: next.download, download: "best.json" }) : null,
      button("Close prefcal", () => close(act), { title: "Ends the command in the terminal" })),
    next.python || next.forms ? folded("use", "Put it on your control system",
      next.forms ? [el("h4", {}, "The PID in ISA, parallel and series form"), el("p", { class: "faint" }, symbol(next.forms.caption)), shownTable(next.forms)] : null,
      next.export.map((each) => command(each.command, `writes it in ${each.what}`)),
      next.python ? command(next.python, "builds it in Python") : null) : null,
    over.trial ? [el("h4", {}, "Try it on the plant"), trial(over.trial)] : null,
    over.menu.length ? [el("h4", {}, "Or do you prefer one of these?"), el("p", { class: "faint" }, "People who answer like you might. Look at one beside the result, and at what lies between them."),
      el("p", { class: "actions" }, over.menu.map(({ name }, k) => button([symbol(name), " ", el("kbd", { "aria-hidden": "true" }, k + 1)], () => showOther(k), { class: "other" })))] : null,
    el("h4", {}, "Compare more?"), left(over), compareMore(now, act),
    folded("come-back", "Come back later", command(study.again, "opens this study again"), command(over.command, "repeats it from the start"),
      report ? command(report.place, "is the report") : null));
}

function compareMore({ progress, version }, act) {
  const more = $("more") ?? el("input", { type: "number", id: "more", min: "1", max: "1000", value: "10", "aria-label": "More experiments" });
  const on = () => act("go_on", { more: Math.max(1, Math.min(1000, Math.round(Number(more.value)) || 10)) });
  return el("p", { class: "actions" }, more, button("more experiments", on),
    progress.answered >= progress.questions ? null : button("Keep comparing", () => act("go_on", { more: 0 })),
    can("undo") ? button("Undo last answer", () => act("undo", { version }, "last answer undone")) : null);
}

// Show the chance that going on helps, and folded what else is known of it, and what could stay as it was.
function left({ next: { outlook }, smaller, why, held, missed }) {
  const told = new Set([...why, ...held, missed]);
  const others = outlook?.sentences.filter((words) => !told.has(words)) ?? [];
  const [first, ...more] = others.flatMap((words) => words.split(/(?<=\.) (?=\p{Lu})/u));
  return [first ? sentences([first]) : null, more.length || smaller || outlook?.command ? folded("left-to-gain", "More on what is left to gain", sentences(more),
    outlook?.command ? command(outlook.command, "widens the range") : null, // the last sentence ends with "for example with:"
    smaller ? el("p", { class: "actions" }, button("Look at the smaller change", () => showTheta(smaller))) : null) : null];
}

async function close(act) {
  if (await act("close", {})) {
    state.closed = true;
    ask("Closed", el("p", {}, "You can close this tab."), []);
  }
}

const command = (text, what) => el("p", { class: "command" }, el("code", {}, text), copying(text), el("span", { class: "faint" }, what));
