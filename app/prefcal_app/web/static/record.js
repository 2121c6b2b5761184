// Handle a rig: show the next θ to run, take the record, and preview it before it is saved.

import { Refusal, sendRecord } from "./api.js";
import { $, ask, button, copying, el, fill, say, symbol, values } from "./dom.js";
import { current, isBlind, refresh } from "./flow.js";
import { Plots } from "./plots.js";

const MOST = 20 * 1024 * 1024;

export function showRecord(now, act) {
  const { pending } = now;
  const set = dials(pending);
  fill($("view-record"),
    el("h2", { id: "record-title" }, `Experiment ${pending.number}: run your plant with these values`),
    values(pending.theta.map((knob) => ({ ...knob, title: knob.exact })), "big"),
    el("p", { class: "actions" }, copying(pending.copy, "Copy θ"), el("span", {}, "in full precision")),
    pending.instructions ? el("p", { class: "instructions" }, pending.instructions) : null,
    pending.promise ? el("p", { class: "faint" }, pending.promise) : null, set.block,
    el("h3", {}, "The record"), columns(now), taking("record", pending.index, set.read),
    el("p", {}, "Or: ", button("The run failed; there is no record", failed)),
    el("p", { class: "faint" }, "This may take days: you can stop prefcal meanwhile. Continue later with ", el("code", {}, now.study.again)));

  function failed() {
    ask("Count it as failed?", el("p", {}, "It is then compared as a run without a record."), [
      ["It failed", () => act("fail", { index: pending.index, reason: "" }), "primary"], ["Go back", null]]);
  }
}

function columns({ rig, pending }) {
  const template = new Blob([`${rig.columns.join(",")}\n`], { type: "text/csv" });
  const link = el("a", { href: URL.createObjectURL(template), download: `experiment-${pending?.number ?? 1}.csv` },
    "empty CSV with these columns");
  return el("p", {}, "A CSV file with the columns ", rig.columns.map((column, i) =>
    [i ? ", " : "", el("code", {}, column)]).flat(), "; or start from an ", link, ".");
}

// Let the person enter the values that were really set, if they differ from the proposal.
function dials(pending) {
  const inputs = pending.theta.map((knob) => el("input", { type: "text", inputmode: "decimal", value: knob.exact,
    "aria-label": `${knob.name} that was set` }));
  const block = el("details", { class: "dials" }, el("summary", {}, "I used other values"),
    el("p", { class: "faint" }, "Enter the values your plant really ran with. The study learns from them and keeps the proposal too."),
    el("dl", { class: "values" }, pending.theta.map((knob, k) => el("div", {}, el("dt", {}, symbol(knob.name)),
      el("dd", {}, inputs[k], knob.unit ? ` ${knob.unit}` : "")))));
  const read = () => {
    const values = inputs.map((input) => input.value.trim().replace(",", "."));
    return values.every((text, k) => text === pending.theta[k].exact) ? null : values;
  };
  return { block, read };
}

// Return a drop zone for a file with its preview; `dialed` returns θ if it differs from the proposal.
function taking(id, index, dialed, saved = () => {}) {
  const refused = el("div", { class: "refused", role: "alert", hidden: true });
  const seen = el("div", { class: "preview", id: `${id}-preview` });
  const unsafe = el("input", { type: "checkbox", id: id === "record" ? "became-unsafe" : `${id}-unsafe` });
  const input = el("input", { type: "file", id: `${id}-file`, accept: ".csv,.txt,.parquet,.xlsx,.xls,text/csv,text/plain" });
  const zone = el("div", { class: "drop" }, el("label", { for: input.id }, "Drop the record here, or choose a CSV, Parquet or Excel file"), input);
  let file = null;
  const take = (given) => {
    file = given;
    look();
  };
  input.addEventListener("change", () => input.files.length && take(input.files[0]));
  unsafe.addEventListener("change", () => file && look());
  zone.addEventListener("dragover", (event) => {
    event.preventDefault();
    zone.classList.add("over");
  });
  zone.addEventListener("dragleave", () => zone.classList.remove("over"));
  zone.addEventListener("drop", (event) => {
    event.preventDefault();
    zone.classList.remove("over");
    if (event.dataTransfer.files.length) take(event.dataTransfer.files[0]);
  });

  // Show the curves before anything is saved.
  async function look() {
    fill(seen);
    const found = await sent("preview", false);
    if (!found) return;
    const { side, panels, axes, warnings, text, same, time_unit: unit } = found;
    const plot = el("div", { class: "plot", role: "img", "aria-label": side.stories.join(". ") });
    fill(seen, el("h4", {}, `This is what would be saved: ${text}`),
      warnings.map((words) => el("p", { class: "warning", role: "alert" }, words)), plot,
      el("p", { class: "actions" },
        button(same ? "Save it anyway" : `Save as experiment ${index + 1}`, save, { id: `${id}-save`, class: same ? "" : "primary" }),
        button("Choose another file", () => fill(seen))));
    const plots = new Plots((name) => (name === "left" ? plot : null));
    plots.take({ panels, axes, windows: [], left: side, right: side }, unit);
    plot.style.height = `${plots.least}px`;
    plots.draw();
    seen.scrollIntoView({ block: "nearest" });
  }

  async function save() {
    const now = await sent("record", true);
    if (!now) return;
    refresh(now);
    say("The record is saved.");
    saved();
  }

  async function sent(where, again) {
    refused.hidden = true;
    input.value = "";
    if (file.size > MOST) return refuse(`The file has ${Math.round(file.size / 1e6)} MB; the limit is 20 MB.`);
    try {
      const query = { index, unsafe: unsafe.checked, again, theta: dialed() };
      return await sendRecord(where, query, await file.arrayBuffer(), isBlind());
    } catch (error) {
      if (error.now) refresh(error.now);
      return refuse(error instanceof Refusal ? error.message : "No connection to prefcal. Nothing was sent.");
    }
  }

  function refuse(text) {
    fill(refused, el("p", {}, "The record cannot be used, and nothing was saved:"),
      el("ul", {}, text.split("; ").map((problem) => el("li", {}, problem))));
    refused.hidden = false;
    return null;
  }

  return el("div", {}, zone, refused, el("p", {}, unsafe, el("label", { for: unsafe.id }, " The run became unsafe and was stopped")), seen);
}

// Replace a wrong record with the right one; possible until the study is finished.
export function replaceRecord() {
  const now = current();
  const { recorded } = now.rig;
  const place = el("div", {});
  const choice = el("select", { id: "replaced", on: { change: choose } },
    recorded.map((number) => el("option", { value: number, selected: number === recorded.at(-1) }, `experiment ${number}`)));
  function choose() {
    fill(place, taking("replace", Number(choice.value) - 1, () => null, () => $("dialog").close()));
  }
  choose();
  ask("Replace a record", [el("p", {}, el("label", { for: "replaced" }, "The right record of "), choice), place],
    [["Close", null]], "wide");
}
