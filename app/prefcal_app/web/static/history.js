// List every question and answer, to look at again or retract.

import { fetched, load } from "./api.js";
import { $, ask, button, el, table, when } from "./dom.js";
import { WORDS } from "./flow.js";
import { showAgain } from "./maneuvers.js";

const HEADS = ["question", "experiment", "against", "verdict", "marks", "comment", "answered", "retract"];

let wanted = null; // the answer to show again as soon as the list is there

export function showNext(answer) {
  wanted = answer;
}

export async function showHistory(act) {
  let asked = null;
  const named = wanted;
  wanted = null;
  await load($("view-history"), el("h2", { id: "history-title" }, "History"), "/api/history", ({ answers, notes }) => {
    asked = answers.find(({ answer }) => answer === named);
    return list(answers, notes, act);
  });
  if (asked) await lookAgain(asked);
}

function list(answers, notes, act) {
  return [
    el("p", { class: "faint" }, "Newest first. Open a question to see it as it was shown. Retracting an answer only changes what is learned."),
    $("again") ?? el("div", { id: "again", tabindex: "-1" }),
    answers.length ? el("div", { class: "card flat" }, table(HEADS, answers.map((answer) => row(answer, act)).reverse(),
      { class: "answers", label: "Answers", kinds: ["", "", "", "", "", "comment", "faint"] })) : el("p", {}, "There are no answers yet."),
    ...(notes.length ? [el("h3", {}, "Remarks"),
      el("ul", { class: "remarks" }, notes.map((n) => el("li", {}, n.text, " ", el("span", { class: "faint" }, when(n.at)))))] : []),
  ];
}

function row(answer, act) {
  const { challenger, incumbent, winner } = answer;
  const state = answer.retracted ? "retracted" : answer.repeated ? "asked again" : "";
  const retract = state ? el("span", { class: "faint" }, state) : button("Retract…", () => confirm(answer, act));
  const look = button(answer.number, () => lookAgain(answer), { "aria-label": `Look at ${named(answer)} again` });
  const number = (value, won) => (won ? el("span", { class: "won" }, value ?? "–", el("span", { class: "hidden" }, " (preferred)")) : value ?? "–");
  const marks = answer.marks.map((mark) => el("span", { class: `chip ${mark.includes("unsafe") ? "bad" : "good"}` }, mark));
  return { kind: answer.retracted ? "retracted" : "", cells: [look, number(challenger, winner === "new"), number(incumbent, winner === "best"),
    el("span", { class: `chip ${winner}` }, answer.text), marks,
    [answer.comment, answer.blind ? el("span", { class: "chip" }, "blind") : ""], when(answer.at), retract] };
}

const named = ({ number }) => `question ${number}`;

function confirm(which, act) {
  const { answer } = which;
  ask(`Retract ${named(which)}?`, el("p", {}, "Nothing will be learned from it any more. Every experiment stays. This cannot be undone."), [
    ["Keep it", null, "primary"], ["Retract it", () => act("retract", { answer }, "answer retracted")]]);
}

async function lookAgain(which) {
  const place = $("again");
  const asked = await fetched(place, `/api/history/${which.answer}`);
  if (!asked) return;
  const { question, verdict, comment } = asked;
  const heading = `${named(which).replace(/^./, (first) => first.toUpperCase())}: ${WORDS[verdict]}`;
  const head = (name, title) => [title, `experiment ${question[name].number}`, verdict === name ? "preferred" : ""];
  showAgain(place, heading, asked, { left: head("left", "Left"), right: head("right", "Right") }, comment);
}
