// Every question and answer, to be looked at again and retracted.

import { get } from "./api.js";
import { $, ask, el, fill, symbol, when, withUnit } from "./dom.js";
import { miniature } from "./miniature.js";

export async function showHistory(act) {
  const view = $("view-history");
  if (!view.firstChild) fill(view, el("h2", { id: "history-title" }, "History"), el("p", {}, "Loading…"));
  let history;
  try {
    history = await get("/api/history");
  } catch (error) {
    return fill(view, el("h2", { id: "history-title" }, "History"), el("p", {}, error.message));
  }
  const { answers, notes } = history;
  const rows = answers.map((answer) => row(answer, act)).reverse();
  const heads = ["", "when", "new", "best so far", "verdict", "marks", "comment", ""];
  const table = el("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Answers" },
    el("table", { class: "answers" }, el("thead", {}, el("tr", {}, heads.map((text) =>
      el("th", { scope: "col" }, text)))), el("tbody", {}, rows)));
  const note = el("input", { type: "text", maxlength: "2000", id: "note", autocomplete: "off" });
  const form = el("form", { class: "note", on: { submit: (event) => {
    event.preventDefault();
    if (note.value.trim()) act("note", { text: note.value.trim() }, "remark");
    note.value = "";
  } } }, el("label", { for: "note" }, "A remark on the study "), note, el("button", {}, "Keep"));
  const looked = $("again");
  return fill(view, el("h2", { id: "history-title" }, "History"),
    answers.length ? table : el("p", {}, "Nothing is answered yet."),
    looked ?? el("div", { id: "again", tabindex: "-1" }), el("h3", {}, "Remarks"),
    notes.length ? el("ul", {}, notes.map((n) => el("li", {}, `${when(n.at)}: ${n.text}`))) : el("p", {}, "None yet."), form);
}

function row(answer, act) {
  const state = answer.retracted ? "retracted" : answer.repeated ? "asked again" : "";
  const retract = answer.retracted || answer.repeated ? state : el("button", { type: "button", on: { click: () =>
    ask(`Retract answer ${answer.answer}?`, el("p", {}, "It will teach nothing any more; every experiment stays. This cannot be taken back."), [
      ["Retract it", () => act("retract", { answer: answer.answer }, "answer retracted"), "primary"], ["Keep it", null]]) } }, "Retract…");
  const look = el("button", { type: "button", on: { click: () => lookAgain(answer.answer) },
    "aria-label": `Look at comparison ${answer.answer} again` }, `${answer.answer}`);
  return el("tr", { class: answer.retracted ? "retracted" : "" }, el("td", {}, look), el("td", {}, when(answer.at)),
    el("td", {}, answer.challenger), el("td", {}, answer.incumbent), el("td", {}, answer.text),
    el("td", {}, answer.marks.join(", ")), el("td", {}, answer.comment, answer.blind ? " (blind)" : ""), el("td", {}, retract));
}

async function lookAgain(number) {
  const { question, verdict, comment, time_unit: unit } = await get(`/api/history/${number}`);
  const place = $("again");
  const side = (name) => el("section", { class: "side", "aria-label": name },
    el("header", {}, el("h4", {}, name === "left" ? "Left" : "Right"),
      el("p", { class: "which" }, `experiment ${question[name].number} · ${question[name].role}`)),
    el("p", {}, question[name].kpis.slice(0, 4).map((kpi) => [symbol(kpi.title), ` ${withUnit(kpi.text, kpi.unit)} · `]).flat(2)),
    el("div", { class: "plot", role: "img", "aria-label": question[name].stories.join(". "), data: { side: name } }));
  fill(place, el("h3", {}, `Comparison ${number}: ${verdict}${comment ? ` (“${comment}”)` : ""}`),
    el("div", { class: "pair small" }, side("left"), side("right")));
  for (const name of ["left", "right"]) {
    miniature(place.querySelector(`[data-side=${name}]`), question, name, unit);
  }
  place.scrollIntoView({ block: "nearest" });
  place.focus({ preventScroll: true });
}
