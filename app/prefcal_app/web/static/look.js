// Show two runs from anywhere as a question of a study shows them, without a study.

import { get } from "./api.js";
import { $, ask, el, fill, say } from "./dom.js";
import { banner } from "./flow.js";
import { QUESTION, keyTable, keyboard, maneuver } from "./keys.js";
import * as question from "./question.js";

const VIEW = ["t", "f", "0", "o", "j", "1-9", ",", ".", "<", ";", ">", ":"]; // the keys of a question that apply
const KEYS = {
  ...Object.fromEntries(VIEW.map((key) => [key, QUESTION[key]])),
  x: ["X", "swap left and right", swap],
  n: ["N", "the next pair of runs", next],
  "?": ["?", "what was read, and these keys", help],
};
const chosen = { left: 0, right: 1 };
let runs = [];
let shown = null;

async function show() {
  let pair;
  const { left, right } = chosen;
  try {
    pair = await get(`/api/pair?left=${left}&right=${right}`);
  } catch (error) {
    banner(error.status ? error.message : "No connection to prefcal. To go on, run the command again.");
    return;
  }
  if (left !== chosen.left || right !== chosen.right) return; // others were chosen meanwhile
  shown = pair;
  banner("");
  $("view-wait").hidden = true;
  $("view-question").hidden = false;
  for (const side of ["left", "right"]) $(`choose-${side}`).value = chosen[side];
  const names = `${pair.left.name} and ${pair.right.name}`;
  $("scenario").textContent = names;
  $("scenario").title = names;
  document.title = `${names} · prefcal`;
  $("notes").hidden = !pair.notes.length;
  $("notes").textContent = pair.notes.join(" ");
  document.body.dataset.phase = "question";
  document.body.dataset.question = `${left} ${right}`;
  question.show({ question: pair, scenario: { time_unit: pair.time_unit } }, false);
  question.fit();
  say(`${names}. ${question.inWords(pair)}`);
}

function choose(left, right) {
  [chosen.left, chosen.right] = [left, right];
  show();
}

function swap() {
  choose(chosen.right, chosen.left);
}

// Go on to the next pair: first the next run on the right, then the next one on the left.
function next() {
  if (runs.length < 3) return;
  const [low, high] = [chosen.left, chosen.right].sort((a, b) => a - b);
  if (high + 1 < runs.length) choose(low, high + 1);
  else if (low + 2 < runs.length) choose(low + 1, low + 2);
  else choose(0, 1);
}

function help() {
  if (!shown) return;
  const read = runs.map(({ name, about }) => el("p", {}, el("strong", {}, name), about ? `: ${about}` : ""));
  const known = Object.entries(KEYS)
    .filter(([key]) => (key !== "n" || runs.length > 2) && (key !== "1-9" || shown.maneuver));
  ask("What this shows", [...read, ...shown.notes.map((words) => el("p", {}, words)),
    keyTable(known.map(([, row]) => row)),
    el("p", {}, "Drag over a plot to zoom both sides. Ctrl-C in the terminal ends prefcal.")], [["Close", null, "primary"]], "wide");
}

async function begin() {
  if (location.pathname !== "/") history.replaceState(null, "", "/");
  question.start();
  keyboard((name) => maneuver(name) ?? KEYS[name]);
  $("swap").addEventListener("click", swap);
  $("next").addEventListener("click", next);
  $("help").addEventListener("click", help);
  try {
    ({ runs } = await get("/api/runs"));
  } catch (error) {
    banner(error.status ? error.message : "No connection to prefcal.");
    return;
  }
  $("choose").hidden = runs.length < 3;
  for (const side of ["left", "right"]) {
    fill($(`choose-${side}`), runs.map(({ name }, k) => el("option", { value: k }, name)));
    $(`choose-${side}`).addEventListener("change", () =>
      choose(Number($("choose-left").value), Number($("choose-right").value)));
  }
  await show();
}

begin();
