// A rig: the next θ for the person who runs it, and the record that he brings.

import { Refusal, sendRecord } from "./api.js";
import { $, ask, copied, el, fill, say, symbol, withUnit } from "./dom.js";
import { isBlind, refresh } from "./flow.js";

const MOST = 20 * 1024 * 1024;

export function showRecord(now, act) {
  const { pending } = now;
  const copy = el("button", { type: "button", on: { click: (event) => copied(pending.copy, event.target) } }, "Copy θ");
  const template = new Blob([`${pending.columns.join(",")}\n`], { type: "text/csv" });
  const link = el("a", { href: URL.createObjectURL(template), download: `experiment-${pending.number}.csv` },
    "empty CSV with these columns");
  const refused = el("div", { class: "refused", role: "alert", hidden: true });
  const unsafe = el("input", { type: "checkbox", id: "became-unsafe" });
  const input = el("input", { type: "file", id: "record-file", accept: ".csv,.txt,text/csv,text/plain" });
  const zone = el("div", { class: "drop" }, el("label", { for: "record-file" },
    "Drop the record here, or choose a CSV file"), input);
  input.addEventListener("change", () => input.files.length && send(input.files[0]));
  zone.addEventListener("dragover", (event) => {
    event.preventDefault();
    zone.classList.add("over");
  });
  zone.addEventListener("dragleave", () => zone.classList.remove("over"));
  zone.addEventListener("drop", (event) => {
    event.preventDefault();
    zone.classList.remove("over");
    if (event.dataTransfer.files.length) send(event.dataTransfer.files[0]);
  });
  fill($("view-record"),
    el("h2", { id: "record-title" }, `Experiment ${pending.number}: run your plant with`),
    el("dl", { class: "values big" }, pending.theta.map((knob) => el("div", {},
      el("dt", {}, symbol(knob.name)), el("dd", { title: knob.exact }, withUnit(knob.text, knob.unit))))),
    el("p", { class: "actions" }, copy, el("span", {}, "in full precision")),
    pending.instructions ? el("p", { class: "instructions" }, pending.instructions) : null,
    el("h3", {}, "Its record"),
    el("p", {}, "A CSV file with the columns ", pending.columns.map((column, i) =>
      [i ? ", " : "", el("code", {}, column)]).flat(), "; or start from an ", link, "."),
    zone, refused,
    el("p", {}, unsafe, el("label", { for: "became-unsafe" }, " It became unsafe and was stopped")),
    el("p", {}, "Or: ", el("button", { type: "button", on: { click: failed } }, "The run failed, there is no record")),
    el("p", { class: "faint" }, "This may take days: everything is saved. Go on later with ", el("code", {}, now.study.again)));

  function failed() {
    ask("Count it as failed?", el("p", {}, "It is then compared as a run without a record."), [
      ["It failed", () => act("fail", { index: pending.index, reason: "" }), "primary"], ["Go back", null]]);
  }

  async function send(file) {
    refused.hidden = true;
    if (file.size > MOST) return refuse(`The file has ${Math.round(file.size / 1e6)} MB; 20 MB are taken.`);
    try {
      refresh(await sendRecord(pending.index, unsafe.checked, await file.arrayBuffer(), isBlind()));
      say("The record is saved.");
    } catch (error) {
      if (error.now) refresh(error.now);
      refuse(error instanceof Refusal ? error.message : "No connection to prefcal: nothing was sent.");
    }
    input.value = "";
    return undefined;
  }

  function refuse(text) {
    fill(refused, el("p", {}, "The record is refused, and nothing was saved:"),
      el("ul", {}, text.split("; ").map((problem) => el("li", {}, problem))));
    refused.hidden = false;
  }
}
