// Verify the result on varied plants, show what came of it, and ask about the worst runs.

import { get, post } from "./api.js";
import { $, button, copying, el, fill, folded, shownTable, symbol } from "./dom.js";
import { current } from "./flow.js";

const PAUSE = 500; // ms between two looks at a verification that runs
const place = el("div", { id: "verification", "aria-live": "polite" });
let timer = 0;
let wanted = ""; // where the study was when V was pressed, whose result is verified once its report is written
let about = null; // the version of the study that the place is about

// Return the place of the verification; it stays while the page is drawn anew.
export function verification() {
  const { version } = current();
  const asked = waits();
  if (about !== version || asked) {
    about = version;
    wanted = "";
    show(() => (asked ? post("verify", {}, false) : get("/api/verification")));
  }
  return place;
}

export function verify() {
  const { over } = current() ?? {};
  if (over?.next.verifies) {
    show(() => post("verify", {}, false));
  } else if (over && !over.report) {
    wanted = reached();
    $("writing").textContent = writing();
  }
}

// What is worked out at the end changes the version, but not how far the study has come.
const reached = () => JSON.stringify(current()?.progress ?? null);
const waits = () => wanted === reached();
export const writing = () => (waits() ? "The report is being written, then the result is verified…" : "The report is being written…");

async function show(ask) {
  clearTimeout(timer);
  try {
    const told = await ask();
    fill(place, told.running ? going(told) : [told.problem ? problem(told.problem) : null, told.said ? said(told.said) : offer(told)]);
    if (told.running) timer = setTimeout(() => show(() => get("/api/verification")), PAUSE);
  } catch (error) {
    fill(place, problem(error.message), el("p", { class: "actions" }, start("Verify it")));
  }
}

const problem = (words) => el("p", { class: "problem", role: "alert" }, words);

const start = (words) => button([words, " ", el("kbd", { "aria-hidden": "true" }, "V")], verify, { id: "verify" });

const offer = ({ runs }) => [el("p", {}, current()?.live || current()?.rig ? "Nothing can be varied on a rig: this says which limits the result keeps, and its margins if the plant is known."
  : `Try the result on ${runs} plants that are not exactly as modeled. What is varied depends on the plant, and is listed beside the verdict.`),
  el("p", { class: "actions" }, start("Verify it"))];

const going = ({ done, planned }) => [el("p", {}, planned ? `${done} of ${planned} runs: random plants, each change alone, the tuning before and, if some fail, others…` : "It begins…"),
  el("progress", { max: planned || 1, value: planned ? done : null, "aria-label": "Runs on varied plants" }),
  el("p", { class: "actions" }, button("Stop and keep these", () => show(() => post("stop_verifying", {}, false))))];

// Show the verdict and what it advises; all that it rests on is folded, and stays as the person left it.
function said({ best, verdict, statement, limits, lines, margins, advice, basis, varied, tables, effects, worst }) {
  const tabled = (each) => [el("h5", {}, each.label), shownTable(each), each.caption ? el("p", { class: "faint" }, symbol(each.caption)) : null];
  const list = (title, lines) => (lines.length ? [el("h5", {}, title), el("ul", { class: "plain" }, lines.map((text) => el("li", {}, symbol(text))))] : []);
  return [el("p", { class: "statement" }, el("strong", {}, symbol(verdict))), verdict.includes(statement) ? null : el("p", {}, symbol(statement)), list("What to do about it", advice),
    lines ? [el("p", {}, "To judge it by the usual limits, run this, then open this page again:"), el("div", { class: "command" }, el("pre", {}, lines), copying(lines))] : null,
    worst.length ? folded("worst-runs", "The worst runs, beside the nominal one: acceptable?", worst.map((each, k) => run(each, k, best))) : null,
    folded("verified", "What was varied, its margins, and what hurts most", el("p", { class: "faint" }, symbol(limits)), varied.map(tabled),
      el("h5", {}, "What margin has it?"), el("p", { class: "statement" }, symbol(margins)), el("p", { class: "faint" }, symbol(`${basis}.`)),
      tables.map(tabled), list("What hurts most, one at a time", effects)),
    el("p", { class: "actions" }, start("Verify again"))];
}

function run({ words, values, seed, verdict, picture }, k, best) {
  const judge = (acceptable) => show(() => post("judge", { run: k, seed, best, acceptable }, false));
  const choice = (text, acceptable) => button(text, () => judge(acceptable), { "aria-pressed": String(verdict === text.toLowerCase()) });
  return el("figure", { class: "worst" }, picture ? el("img", { src: `${picture}?${Date.now()}`, alt: `Curves of worst run ${k + 1} beside the nominal run`, loading: "lazy" }) : null,
    el("figcaption", {}, el("strong", {}, symbol(`${k + 1}: ${words}. `)), symbol(values),
      el("span", { class: "actions" }, choice("Acceptable", true), choice("Not acceptable", false))));
}
