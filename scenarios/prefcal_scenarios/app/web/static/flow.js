// The flow: what the server says is kept, what the person does is sent. It knows of no view.

import { Refusal, news, post } from "./api.js";
import { $, ask, el } from "./dom.js";

export const state = { now: null, view: "now", blind: false, sending: 0, answered: null, shownAt: 0, lost: false };
const LINGER = 150; // ms in which a verdict after a new question is a second press of the last one

export const current = () => state.now;
export const isBlind = () => state.blind;

let waiting = null;
let changed = () => {};
let opened = () => {};

// `onchange(before)` draws what the server said, `onopen()` another view of it.
export function start(onchange, onopen) {
  [changed, opened] = [onchange, onopen];
  listen();
}

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
  if (!before || told(before) !== told(now)) changed(before);
}

const told = ({ version, blind, over }) => JSON.stringify([version, blind, over]);

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
  opened();
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

export const WORDS = { left: "left is better", right: "right is better", same: "about the same",
  "cannot tell": "can't tell", "much left": "left is much better", "much right": "right is much better" };

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

export async function undo() {
  if (state.now?.question?.repeat) return skip();
  if (!state.now?.can_undo) return undefined;
  const done = await act("undo", { version: state.now.version }, "last answer taken back");
  if (done) $("comment").value ||= state.now.draft;
  return undefined;
}

// Leave a question that is only asked again: nothing is recorded, and the open one comes back.
export const skip = () => act("undo", { version: state.now.version });

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

