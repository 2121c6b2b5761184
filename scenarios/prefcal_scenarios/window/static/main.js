// The flow: what the server says is shown, what the person does is sent.

import { Refusal, news, post } from "./api.js";
import { $, ask, el, say } from "./dom.js";
import { showFailed } from "./failed.js";
import { showHistory } from "./history.js";
import { keyboard, showKeys } from "./keys.js";
import { showOver } from "./over.js";
import * as question from "./question.js";
import { showRecord } from "./record.js";
import { showStatus } from "./status.js";

const state = { now: null, view: "now", blind: false, sending: 0, answered: null, shownAt: 0, lost: false };
const HEADINGS = {
  question: "Which experiment is better?", record: "Run the next experiment",
  failed: "An experiment failed", over: "The study is over", running: "Running", loading: "Starting",
};
const LINGER = 150; // ms in which a verdict after a new question is a second press of the last one

export const current = () => state.now;
export const isBlind = () => state.blind;

let waiting = null;

async function listen() {
  for (;;) {
    waiting = new AbortController();
    try {
      const asked = state.blind;
      // A hidden tab holds no connection: a browser keeps six, which all tabs share.
      const held = !document.hidden || !state.now;
      if (!held) await hiddenFor(3000);
      const now = await news(held ? state.now?.version ?? null : null, asked, waiting.signal);
      if (state.lost) banner("");
      state.lost = false;
      if (asked === state.blind) take(now);
    } catch (error) {
      if (error.name !== "AbortError") await lost(error);
    }
  }
}

// Resolves after `ms`, or as soon as the tab is looked at again.
const hiddenFor = (ms) => new Promise((resolve) => {
  setTimeout(resolve, ms);
  document.addEventListener("visibilitychange", resolve, { once: true });
});

async function lost(error) {
  const again = state.now?.study.again ?? "prefcal calibrate ...";
  state.lost = true;
  banner(error instanceof Refusal && error.status === 401
    ? "This link is no longer valid: open the one that the terminal shows."
    : `No connection to prefcal. Every answer so far is saved; go on with: ${again}`);
  await new Promise((resolve) => setTimeout(resolve, 1000));
}

function banner(text) {
  $("banner").hidden = !text;
  $("banner").textContent = text;
}

function take(now) {
  const before = state.now;
  if (before && now.version < before.version && now.blind === before.blind) return;
  state.now = now;
  // A long poll that ran out: what is on show stays as it is, half-written remarks and the focus too.
  if (!before || told(before) !== told(now)) render(before);
}

const told = ({ version, blind, over }) => JSON.stringify([version, blind, over]);

function render(before) {
  const { now } = state;
  const same = before && before.question?.id === now.question?.id && before.blind === now.blind;
  document.body.dataset.phase = now.phase;
  document.body.dataset.question = now.question?.id ?? "";
  document.body.dataset.blind = now.blind;
  $("scenario").textContent = now.scenario.title;
  progress(now.progress);
  $("undo").disabled = !now.can_undo;
  if (now.phase === "question") {
    question.show(now, same);
    if (!same) asked(now);
  }
  if (now.phase === "running") waitFor(now);
  if (now.phase === "record" && before?.pending?.index !== now.pending?.index) showRecord(now, act);
  if (now.phase === "failed") showFailed(now, act);
  if (now.phase === "over") showOver(now, act);
  arrange();
  if (before && before.phase !== now.phase && now.phase !== "question") say($("heading").textContent);
  if (state.view === "history") showHistory(act);
  if (state.view === "status") showStatus(now, act);
}

function asked(now) {
  state.shownAt = performance.now();
  const { comparisons } = now.progress;
  const repeat = now.question.repeat ? "an earlier question again" :
    `comparison ${now.question.number} of ${comparisons}`;
  say(`New question: ${repeat}. ${question.inWords(now.question)}`);
}

function progress({ answered, comparisons }) {
  const next = Math.min(answered + 1, comparisons);
  $("progress-text").textContent = state.now.phase === "over"
    ? `${answered} of ${comparisons} compared` : `comparison ${next} of ${comparisons}`;
  const bar = $("progress");
  bar.setAttribute("aria-valuemax", Math.max(comparisons, 1));
  bar.setAttribute("aria-valuenow", answered);
  bar.firstElementChild.style.width = `${(100 * answered) / Math.max(comparisons, 1)}%`;
}

function waitFor(now) {
  const number = now.pending?.number;
  $("wait-title").textContent = number ? `Running experiment ${number}` : "Choosing the next experiment";
  $("wait-text").textContent = now.progress.answered > 0
    ? "Your answer is saved." : "The very first run on a machine compiles for half a minute.";
}

// Which of the sections and buttons are there.
function arrange() {
  const phase = state.now?.phase ?? "loading";
  const here = state.view === "now";
  const shown = here ? { loading: "wait", running: "wait" }[phase] ?? phase : state.view;
  for (const section of document.querySelectorAll("main > section")) {
    section.hidden = section.id !== `view-${shown}`;
  }
  document.body.dataset.view = state.view;
  $("heading").textContent = shown === "question" && state.now.question.repeat
    ? "Once more: which is better?" : HEADINGS[phase];
  $("verdicts").hidden = shown !== "question";
  for (const button of document.querySelectorAll("[data-in=question]")) {
    button.hidden = shown !== "question";
  }
  $("to-now").hidden = here;
  $("to-history").setAttribute("aria-current", state.view === "history" ? "page" : "false");
  $("to-status").setAttribute("aria-current", state.view === "status" ? "page" : "false");
  if (shown === "question") question.fit();
}

export function open(view) {
  if (state.blind && view !== "now") {
    ask("You are comparing blind", el("p", {}, "That page shows which experiment is which."), [
      ["Stay blind", null, "primary"], ["Show it, and end blind", () => {
        toggleBlind();
        open(view);
      }]]);
    return;
  }
  state.view = view;
  arrange();
  if (view === "history") showHistory(act);
  if (view === "status") showStatus(state.now, act);
  $("main").focus({ preventScroll: true });
}

// Send one action; whatever it is refused for is shown, and nothing is lost.
export async function act(name, fields, words = "") {
  state.sending += 1;
  document.body.classList.add("busy");
  if (words) $("saved").textContent = ""; // what was saved before says nothing about this
  try {
    const now = await post(name, fields, state.blind);
    banner("");
    take(now);
    if (words) saved(words);
    return true;
  } catch (error) {
    if (error.now) take(error.now);
    banner(error instanceof Refusal ? error.message : "No connection to prefcal: this may not be saved.");
    return false;
  } finally {
    state.sending -= 1;
    document.body.classList.toggle("busy", state.sending > 0);
  }
}

export function refresh(now) {
  banner("");
  take(now);
}

function saved(words) {
  $("saved").textContent = `✓ saved: ${words}`;
  $("saved").classList.remove("fresh");
  requestAnimationFrame(() => $("saved").classList.add("fresh"));
}

const WORDS = { left: "left is better", right: "right is better", same: "about the same",
  "cannot tell": "can't tell" };

export async function answer(choice) {
  const { now } = state;
  if (state.view !== "now" || now?.phase !== "question") return;
  const { id } = now.question;
  if (state.answered === id || performance.now() - state.shownAt < LINGER) return;
  state.answered = id;
  const comment = $("comment").value;
  $("comment").value = "";
  const done = await act("answer", { question: id, choice, comment, blind: state.blind }, WORDS[choice]);
  if (done) return;
  // Not recorded: the question is open again, and the comment as it was.
  state.answered = null;
  $("comment").value ||= comment;
}

export function mark(side, kind) {
  const { now } = state;
  if (state.view !== "now" || now?.phase !== "question") return;
  const on = !now.question[side].marks.includes(kind);
  act("mark", { question: now.question.id, side, mark: kind, on },
    on ? `${side} is ${kind}` : `${side} is no longer ${kind}`);
}

export function undo() {
  if (state.now?.can_undo) act("undo", { version: state.now.version }, "last answer taken back");
}

export function finish() {
  const { answered, comparisons } = state.now.progress;
  ask("Finish the study?", el("p", {}, `${answered} of ${comparisons} comparisons are answered. ` +
    "The best so far is the result. You can go on with it any time."), [
    ["Finish", () => act("finish", {}), "primary"], ["Go on comparing", null]]);
}

export function toggleBlind() {
  state.blind = !state.blind;
  $("blind").setAttribute("aria-pressed", state.blind);
  waiting?.abort();
  news(null, state.blind).then(take, lost);
}

function start() {
  if (location.pathname !== "/") history.replaceState(null, "", "/");
  for (const choice of ["left", "right", "same", "cannot-tell"]) {
    $(`verdict-${choice}`).addEventListener("click", () => answer(choice.replace("-", " ")));
  }
  $("undo").addEventListener("click", undo);
  $("blind").addEventListener("click", toggleBlind);
  $("help").addEventListener("click", showKeys);
  $("theme").addEventListener("click", () => state.view === "status" && showStatus(state.now, act));
  $("finish").addEventListener("click", finish);
  $("offer-finish").addEventListener("click", () => act("finish", {}));
  $("to-now").addEventListener("click", () => open("now"));
  $("to-history").addEventListener("click", () => open("history"));
  $("to-status").addEventListener("click", () => open("status"));
  question.start();
  keyboard();
  listen();
}

start();
