// Keep the server's latest state and send the person's actions. This module knows no view.

import { Refusal, news, post } from "./api.js";
import { $, ask, counted, el, keep, kept } from "./dom.js";

export const state = { now: null, view: "now", blind: false, sending: 0, answered: null, shownAt: 0, lost: false, closed: false,
  saved: "", unsure: null }; // the last answer that was saved, and one that was sent without a reply
const KEY = "prefcal-comment";
const LINGER = 150; // ms after a new question in which a verdict counts as a double press of the last one

export const current = () => state.now;
// Return whether the person can take a step now, as the study says.
export const can = (step) => Boolean(state.now?.can.includes(step));
export const isBlind = () => state.blind;

let waiting = null;
let changed = () => {};
let opened = () => {};

// Start listening. `onchange(before)` draws a new state, `onopen()` another view of it.
export function start(onchange, onopen) {
  [changed, opened] = [onchange, onopen];
  $("comment").addEventListener("input", keepComment);
  stay();
  listen();
}

// Keep the comment on the open question while it is typed, so that a reload does not lose it.
const subject = ({ study, question }) => `${study.place} ${question?.id}`;

function keepComment() {
  if (!state.now) return;
  keep(KEY, JSON.stringify({ subject: subject(state.now), text: $("comment").value }), "sessionStorage");
}

function putComment(text) {
  $("comment").value = text;
  keepComment();
}

// Show what was typed about this question before a reload; what is in the field stays there.
export function restoreComment(now) {
  try {
    const last = JSON.parse(kept(KEY, "sessionStorage"));
    if (last?.subject === subject(now)) $("comment").value ||= last.text;
  } catch {
    // Nothing of ours.
  }
}

// Back leads from the other pages to the question, as between pages of their own.
function stay() {
  history.replaceState(state.view, "");
  addEventListener("popstate", ({ state: view }) => {
    $("dialog").close();
    show(state.blind ? "now" : view ?? "now");
  });
}

function show(view) {
  state.view = view;
  opened();
}

async function listen() {
  while (!state.closed) {
    waiting = new AbortController();
    try {
      const asked = state.blind;
      // A hidden tab holds no connection: all tabs share the browser's six.
      const held = !document.hidden || !state.now;
      if (!held) await hiddenFor(3000);
      const now = await news(held ? state.now?.version ?? null : null, asked, waiting.signal);
      if (state.lost) banner("");
      state.lost = false;
      if (asked === state.blind) take(now);
      settle();
    } catch (error) {
      if (error.name !== "AbortError") await lost(error);
    }
  }
}

// Resolve after `ms`, or as soon as the tab is visible again.
const hiddenFor = (ms) => new Promise((resolve) => {
  setTimeout(resolve, ms);
  document.addEventListener("visibilitychange", resolve, { once: true });
});

async function lost(error) {
  if (state.closed) return; // by this person, on this page
  state.lost = true;
  banner(error instanceof Refusal && error.status === 401
    ? "This link is no longer valid. Open the one that the terminal shows." : offline());
  await new Promise((resolve) => setTimeout(resolve, 1000));
}

// Say which answers had been saved, since the file may be gone by now, and that the one just pressed is not.
function offline() {
  const { given = 0 } = state.now?.progress ?? {};
  const count = `It had saved ${counted(given, "answer")}`;
  const last = state.saved ? `, the last one “${state.saved}”` : "";
  const unsure = state.unsure ? ` Not saved, as far as this page knows: “${state.unsure.words}”, which you pressed last.` : "";
  return `No connection to prefcal. ${count}${last}.${unsure} To continue, run: ${state.now?.study.again ?? "prefcal calibrate ..."}`;
}

// Say what became of an answer that was sent without a reply: if its question is open, it is lost.
function settle() {
  if (!state.unsure) return;
  const { question, words, comment: text } = state.unsure;
  state.unsure = null;
  if (state.now.question?.id === question) banner(`“${words}” was not saved: the connection was lost. Please answer again.`);
  else {
    state.saved = words;
    saved(words);
    if ($("comment").value === text) putComment("");
  }
}

export function banner(text) {
  $("banner").hidden = !text;
  if ($("banner").textContent !== text) $("banner").textContent = text; // screen readers read it again whenever it is set
}

function take(now) {
  const before = state.now;
  if (before && now.version < before.version && now.blind === before.blind) return;
  state.now = now;
  // After a long poll without news, keep the view as it is, with the focus.
  if (!before || told(before) !== told(now)) changed(before);
}

const told = ({ version, blind, over }) => JSON.stringify([version, blind, over]);

export function open(view) {
  if (state.blind && view !== "now") {
    ask("You are comparing blind", el("p", {}, "That page shows which experiment is which."), [
      ["Stay blind", null, "primary"], ["Show it and end blind mode", () => {
        toggleBlind();
        open(view);
      }]]);
    return;
  }
  if (view !== state.view) history.pushState(view, "");
  show(view);
}

// Send one action and return whether it succeeded; a refusal is shown.
export async function act(name, fields, words = "") {
  state.sending += 1;
  document.body.classList.add("busy");
  if (words) $("saved").textContent = ""; // it is about an earlier action
  try {
    const now = await post(name, fields, state.blind);
    banner("");
    take(now);
    if (words) saved(words);
    if (["answer", "undo"].includes(name)) state.saved = name === "answer" ? words : "";
    return true;
  } catch (error) {
    if (error.now) take(error.now);
    if (!(error instanceof Refusal) && name === "answer") state.unsure = { words, ...fields };
    banner(error instanceof Refusal ? error.message : state.unsure ? offline() : "No connection to prefcal. This may not be saved.");
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

export const WORDS = { left: "left is better", right: "right is better", same: "about the same",
  "cannot tell": "can't tell" };

export async function answer(choice) {
  const { now } = state;
  if (state.view !== "now" || !can("answer")) return;
  const { id } = now.question;
  if (state.answered === id || performance.now() - state.shownAt < LINGER) return;
  state.answered = id;
  const text = $("comment").value;
  putComment("");
  const done = await act("answer", { question: id, choice, comment: text, blind: state.blind }, WORDS[choice]);
  if (done) return;
  // Not recorded: reopen the question and restore the comment.
  state.answered = null;
  if (!$("comment").value) putComment(text);
}

export function mark(side, kind) {
  const { now } = state;
  if (state.view !== "now" || !can("mark")) return;
  const on = !now.question[side].marks.includes(kind);
  act("mark", { question: now.question.id, side, mark: kind, on },
    on ? `${side} is ${kind}` : `${side} is no longer ${kind}`);
}

export async function undo() {
  if (state.now?.question?.repeat) return skip();
  if (!can("undo")) return undefined;
  const done = await act("undo", { version: state.now.version }, "last answer undone");
  if (done && !$("comment").value) putComment(state.now.draft);
  return undefined;
}

// Skip a repeated question: nothing is recorded, and the open question comes back.
export const skip = () => act("undo", { version: state.now.version });

export function finish() {
  const { answered, questions } = state.now.progress;
  ask("Finish the study?", el("p", {}, `${answered} of ${questions} questions are answered. ` +
    "The best so far is the result. You can continue the study at any time."), [
    ["Finish", () => act("finish", {}), "primary"], ["Keep comparing", null]]);
}

export function toggleBlind() {
  state.blind = !state.blind;
  $("blind").setAttribute("aria-pressed", state.blind);
  waiting?.abort();
  news(null, state.blind).then(take, lost);
}

