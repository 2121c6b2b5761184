// Draw the page: each phase and view has its own module, called when the state changes.

import { $, DARK, button, el, fill, say } from "./dom.js";
import { act, answer, can, finish, open, restoreComment, skip, start, state, toggleBlind, undo } from "./flow.js";
import { showHistory } from "./history.js";
import { drives, inPlace, mustRestore, showLive, showUnrestored, stopLive } from "./live.js";
import { keyboard, showKeys } from "./keys.js";
import { showOver } from "./over.js";
import * as question from "./question.js";
import { replaceRecord, showRecord } from "./record.js";
import { showSimulated } from "./simulated.js";
import { showStatus } from "./status.js";
import { follow } from "./trial.js";
import { intro, showFailed, waitFor } from "./waiting.js";

const HEADINGS = {
  question: "Which experiment is better?", record: "Run the next experiment", confirm: "Confirm the next run",
  failed: "An experiment failed", over: "The study is finished", running: "Running", loading: "Starting",
};

const PAGES = ["history", "status", "simulated"];

function render(before) {
  const { now } = state;
  const same = before && before.question?.id === now.question?.id && before.blind === now.blind;
  document.body.dataset.phase = now.phase;
  document.body.dataset.question = now.question?.id ?? "";
  document.body.dataset.blind = now.blind;
  $("scenario").textContent = now.scenario.title;
  progress(now.progress, now.simulated);
  $("undo").disabled = !can("undo");
  if (now.phase === "question") {
    intro(now);
    question.offer(now);
    question.show(now, same);
    if (!same) asked(now);
  }
  if (now.phase === "running") waitFor(now, act);
  if (now.phase === "record" && before?.pending?.index !== now.pending?.index) showRecord(now, act);
  if (inPlace(now)) showLive(now, act);
  if (now.phase === "failed") showFailed(now, act);
  if (now.phase === "over") showOver(now, act);
  follow(now);
  arrange();
  if (before && before.phase !== now.phase && now.phase !== "question") say($("heading").textContent);
  look();
}

function look() {
  if (state.view === "history") showHistory(act);
  if (state.view === "status") showStatus(state.now, act);
  if (state.view === "simulated") showSimulated(act);
}

function opened() {
  arrange();
  look();
  $("main").focus({ preventScroll: true });
}

function asked(now) {
  state.shownAt = performance.now();
  restoreComment(now);
  const which = now.question.repeat ? "an earlier question again"
    : `${now.progress.text}${now.question.further ? ", two experiments that you have seen" : ""}`;
  say(`New question: ${which}. ${question.inWords(now.question)}`);
}

function progress({ answered, questions, text }, simulated) {
  $("progress-text").textContent = text;
  if (simulated) $("progress-text").append(el("span", { class: "hidden" }, " · "), el("span", { class: "unseen", title: simulated.failure || null }, simulated.line));
  const bar = $("progress");
  bar.setAttribute("aria-valuemax", Math.max(questions, 1));
  bar.setAttribute("aria-valuenow", answered);
  bar.firstElementChild.style.width = `${(100 * answered) / Math.max(questions, 1)}%`;
  const place = state.now.phase === "over" ? "done" : `${Math.min(answered + 1, questions)}/${questions}`;
  document.title = `${place} · ${state.now.scenario.title} · prefcal`;
}

// Show what is no longer as it was when the study was begun, until the person has read it.
function remark(remarks) {
  const place = $("remarks");
  if (!remarks.length || place.childElementCount) return;
  place.hidden = false;
  fill(place, ...remarks.map((words) => el("p", {}, words)), button("Understood", () => { place.hidden = true; }));
}

// Show the sections and buttons of the current phase and view.
function arrange() {
  const phase = state.now?.phase ?? "loading";
  const here = state.view === "now";
  const shown = here ? { loading: "wait", running: inPlace(state.now) ? "live" : "wait", confirm: "live" }[phase] ?? phase : state.view;
  for (const section of document.querySelectorAll("main > section")) {
    section.hidden = section.id !== `view-${shown}`;
  }
  document.body.dataset.view = state.view;
  $("heading").textContent = shown === "question" && state.now.question.repeat ? "Once more: which is better?"
    : mustRestore(state.now) && phase === "confirm" ? "Restore the plant first" : HEADINGS[phase];
  if (state.now) showUnrestored(state.now, shown !== "live");
  if (state.now) remark(state.now.study.remarks);
  $("verdicts").hidden = shown !== "question" || !can("answer");
  $("replace").hidden = !here || !can("record") || !state.now.rig?.recorded.length;
  $("stop-live").hidden = !drives(state.now);
  $("skip").hidden = !state.now?.question?.repeat;
  for (const button of document.querySelectorAll("[data-in=question]")) {
    button.hidden = shown !== "question";
  }
  $("to-now").hidden = here;
  for (const view of PAGES) $(`to-${view}`).setAttribute("aria-current", state.view === view ? "page" : "false");
  $("to-simulated").hidden = !state.now?.screening;
  if (shown === "question") question.fit();
}

function begin() {
  if (location.pathname !== "/") history.replaceState(null, "", "/");
  for (const choice of ["left", "right", "same", "cannot-tell"]) {
    $(`verdict-${choice}`).addEventListener("click", () => answer(choice.replace("-", " ")));
  }
  const clicks = { undo, skip, finish, "stop-live": stopLive, replace: replaceRecord, blind: toggleBlind, help: showKeys };
  for (const [id, run] of Object.entries(clicks)) $(id).addEventListener("click", () => run());
  for (const view of ["now", ...PAGES]) $(`to-${view}`).addEventListener("click", () => open(view));
  question.startOffer();
  DARK.addEventListener("change", look);
  question.start();
  keyboard();
  start(render, opened);
}

begin();
