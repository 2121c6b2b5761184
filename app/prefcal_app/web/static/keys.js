// Handle keys. They do nothing while the person types, with a modifier other than shift, or on repeat.

import { answer, finish, mark, open, skip, toggleBlind, undo, current } from "./flow.js";
import { jump, moveCursor, repeat, resetZoom, showManeuver, toggleOverlay, toggleTable, toggleZoom } from "./question.js";
import { $, ask, el, table } from "./dom.js";
import { drives, stopLive } from "./live.js";
import { chooseIt, showOther } from "./simulated.js";
import { verify } from "./verify.js";
import { briefing } from "./waiting.js";

// Of each key: how it is written, what it does in words, what it does, and when the list of keys names it.
export const QUESTION = {
  ArrowLeft: ["← →", "left, right is better", () => answer("left")],
  ArrowRight: [null, "", () => answer("right")],
  ArrowDown: ["↓", "about the same", () => answer("same")],
  s: ["S", "can't tell", () => answer("cannot tell")],
  q: ["Q", "mark left as unsafe or very bad", () => mark("left", "unsafe")],
  a: ["A", "mark left as good enough", () => mark("left", "good enough")],
  e: ["E", "mark right as unsafe or very bad", () => mark("right", "unsafe")],
  d: ["D", "mark right as good enough", () => mark("right", "good enough")],
  c: ["C", "write a comment; Enter or Esc leaves the field", () => $("comment").focus()],
  t: ["T", "all KPIs of both sides, in one table", toggleTable],
  f: ["F", "zoom to the target and back", toggleZoom],
  0: ["0", "the whole time, or only while things happen (or double-click)", resetZoom],
  o: ["O", "switch between one plot and side by side", toggleOverlay],
  b: ["B", "blind: hide θ and which experiment is the best so far", toggleBlind],
  ",": [", .", "move the cursor (faster with shift)", () => moveCursor(-1)],
  ".": [null, "", () => moveCursor(1)],
  "<": [null, "", () => moveCursor(-10)],
  ";": [null, "", () => moveCursor(-10)],
  ">": [null, "", () => moveCursor(10)],
  ":": [null, "", () => moveCursor(10)],
  j: ["J", "go to where the two differ most; again: in the next maneuver", jump],
  "1-9": ["1 … 9", "show the first, second, ... maneuver", () => {}, () => current()?.question?.maneuver],
  p: ["P", "ask me an earlier question again", repeat],
};
const simulates = () => current()?.screening;
const EVERYWHERE = {
  z: ["Z", "undo the last answer", undo],
  h: ["H", "history", () => open("history")],
  w: ["W", "where are we", () => open("status")],
  k: ["K", "stop the run on the plant", stopLive, () => current()?.live],
  m: ["M", "everything simulated, as a picture", () => simulates() && open("simulated"), simulates],
  1: ["1 2 C", "at the end: look at another candidate beside the result; choose what you look at", () => showOther(0), simulates],
  2: [null, "", () => showOther(1)],
  c: [null, "", chooseIt],
  "o in the trial": ["O", "while you try old and new on the plant: switch to the other one", () => {}, () => current()?.over?.trial],
  v: ["V", "at the end: verify the result on plants that are not exactly as modeled", verify],
  Escape: ["Esc", "back to the question; skip a repeated question", leave],
  "?": ["?", "the task, and these keys", showKeys],
};

function leave() {
  if (document.body.dataset.view === "now" && current()?.question?.repeat) skip();
  else open("now");
}

const typing = (target) =>
  target instanceof Element && (target.matches("input:not([type=range]), textarea, select, [contenteditable]"));

// Listen for keys. `of(name)` returns the row of a table like those above, or nothing.
export function keyboard(of = asked) {
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey || event.isComposing) return;
    // A run on a plant can be stopped at any time, also while a dialog is open.
    if ($("dialog").open && !(event.key.toLowerCase() === "k" && drives(current()))) return;
    if (typing(event.target)) {
      // In other fields Enter submits; here it only leaves, so that the next key is the verdict.
      const ends = event.key === "Escape" || (event.key === "Enter" && event.target.id === "comment");
      if (ends) event.target.blur();
      return;
    }
    const button = event.target instanceof Element && event.target.closest("button, summary, a");
    if (button && (event.key === " " || event.key === "Enter")) return;
    const name = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const found = of(name);
    if (!found) return;
    event.preventDefault();
    const repeats = [",", ".", "<", ">", ";", ":"].includes(name);
    if (!event.repeat || repeats) found[2]();
  });
}

export const maneuver = (name) => (/^[1-9]$/.test(name) ? [null, "", () => showManeuver(Number(name) - 1)] : undefined);

function asked(name) {
  const open = document.body.dataset.view === "now" && current()?.phase === "question";
  if (open && maneuver(name)) return maneuver(name);
  return (open && QUESTION[name]) || EVERYWHERE[name];
}

export async function showKeys() {
  const known = [QUESTION, EVERYWHERE].flatMap(Object.values)
    .filter(([, , , named]) => !named || named());
  const told = await briefing();
  if ($("dialog").open) return; // pressed twice while loading
  ask("What this is about", [...told, keyTable(known),
    el("p", {}, el("span", { class: "by-key" }, "Keys are off while you type. "), "Drag over a plot to zoom both sides.")],
  [["Close", null, "primary"], ["Finish the study…", finish]], "wide");
}

// Return the keys and what they do as a table with its heading.
export function keyTable(known) {
  // Objects list numeric keys first: move "0" to the end.
  const rows = known.filter(([key]) => key).sort((a, b) => (a[0] === "0") - (b[0] === "0"));
  return el("div", { class: "by-key" }, el("h3", {}, "Keys"), table(null, rows.map(([key, words]) => [el("kbd", {}, key), words]), { class: "keys" }));
}
