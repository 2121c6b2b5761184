// List every question and answer, to look at again or retract.

import { get } from "./api.js";
import { $, ask, el, fill, when } from "./dom.js";
import { WORDS } from "./flow.js";
import { showAgain } from "./maneuvers.js";

const HEADS = ["question", "experiment", "against", "verdict", "marks", "comment", "answered", "retract"];

export async function showHistory(act) {
  const view = $("view-history");
  const title = el("h2", { id: "history-title" }, "History");
  if (!view.firstChild) fill(view, title, el("p", {}, "Loading…"));
  let history;
  try {
    history = await get("/api/history");
  } catch (error) {
    return fill(view, title, el("p", {}, error.message));
  }
  const { answers, notes } = history;
  fill(view, title,
    el("p", { class: "faint" }, "Newest first. Open a question to see it as it was shown. Retracting an answer only changes what is learned."),
    $("again") ?? el("div", { id: "again", tabindex: "-1" }),
    answers.length ? table(answers, act) : el("p", {}, "There are no answers yet."),
    notes.length ? [el("h3", {}, "Remarks"),
      el("ul", { class: "remarks" }, notes.map((n) => el("li", {}, n.text, " ", el("span", { class: "faint" }, when(n.at)))))] : []);
  return undefined;
}

function table(answers, act) {
  const rows = answers.map((answer) => row(answer, act)).reverse();
  return el("div", { class: "scroll card flat", tabindex: "0", role: "region", "aria-label": "Answers" },
    el("table", { class: "answers" }, el("thead", {}, el("tr", {}, HEADS.map((text) =>
      el("th", { scope: "col" }, text)))), el("tbody", {}, rows)));
}

function row(answer, act) {
  const { challenger, incumbent, winner } = answer;
  const state = answer.retracted ? "retracted" : answer.repeated ? "asked again" : "";
  const retract = state ? el("span", { class: "faint" }, state)
    : el("button", { type: "button", on: { click: () => confirm(answer, act) } }, "Retract…");
  const look = el("button", { type: "button", on: { click: () => lookAgain(answer) },
    "aria-label": `Look at ${named(answer)} again` }, answer.number);
  const number = (value, won) => el("td", { class: won ? "won" : "" }, value ?? "–", won ? el("span", { class: "hidden" }, " (preferred)") : null);
  return el("tr", { class: answer.retracted ? "retracted" : "" }, el("td", {}, look),
    number(challenger, winner === "new"), number(incumbent, winner === "best"),
    el("td", {}, el("span", { class: `chip ${winner}` }, answer.text)),
    el("td", {}, answer.marks.map((mark) => el("span", { class: `chip ${mark.includes("unsafe") ? "bad" : "good"}` }, mark))),
    el("td", { class: "comment" }, answer.comment, answer.blind ? el("span", { class: "chip" }, "blind") : null),
    el("td", { class: "faint" }, when(answer.at)), el("td", {}, retract));
}

const named = ({ number }) => `question ${number}`;

function confirm(which, act) {
  const { answer } = which;
  ask(`Retract ${named(which)}?`, el("p", {}, "Nothing will be learned from it any more. Every experiment stays. This cannot be undone."), [
    ["Keep it", null, "primary"], ["Retract it", () => act("retract", { answer }, "answer retracted")]]);
}

async function lookAgain(which) {
  const place = $("again");
  let asked;
  try {
    asked = await get(`/api/history/${which.answer}`);
  } catch (error) {
    return fill(place, el("p", { class: "problem" }, error.message));
  }
  const { question, verdict, comment } = asked;
  const heading = `${named(which).replace(/^./, (first) => first.toUpperCase())}: ${WORDS[verdict]}`;
  const head = (name, title) => [title, `experiment ${question[name].number}`, verdict === name ? "preferred" : ""];
  return showAgain(place, heading, asked, { left: head("left", "Left"), right: head("right", "Right") }, comment);
}
