// Handle a live plant: confirm what is written, show how far the run is, and stop it at any time.

import { $, button, el, fill, svg, symbol, table, withUnit } from "./dom.js";
import { act, current } from "./flow.js";

const [WIDE, HIGH] = [600, 120]; // of a curve, in its own units
let drawn = ""; // which page is drawn; its parts are then changed in place, so that the focus stays

// Return whether a run is in progress on the plant, which can be stopped.
export const drives = (now) => Boolean(now?.live?.running) && ["stop_run", "end_trial"].some((step) => now.can.includes(step)) && !now.live.running.restores;

// Return whether the page of the plant is the one to show.
export const inPlace = (now) => Boolean(now?.live) && (now.phase === "confirm" || (now.phase === "running" && Boolean(now.live.running)));

// Return whether the plant must get its old values back before anything else.
export const mustRestore = (now) => Boolean(now?.live?.unrestored || now?.live?.running?.recovers);

export function stopLive() {
  const now = current();
  if (!drives(now) || now.live.running.stopping) return undefined;
  if (now.can.includes("end_trial")) return act("end_trial", {});
  if (!now.pending) return undefined;
  return act("stop_run", { index: now.pending.index });
}

export function showLive(now) {
  const { running: run, changes, problem, unrestored } = now.live;
  const kind = JSON.stringify(run ? ["run", now.pending?.index, run.recovers, run.restores] : ["confirm", now.pending?.index, changes, problem, unrestored]);
  const fresh = kind !== drawn || !$("view-live").firstChild;
  drawn = kind;
  if (run) {
    if (fresh) running(now);
    progress(now);
  } else if (fresh) confirming(now);
}

// Show on every other page that the plant does not have its old values, until it has them.
export function showUnrestored(now, elsewhere) {
  const place = $("unrestored");
  const { unrestored, problem, running: run } = now.live ?? {};
  const words = unrestored ? `The plant does not have its old values yet: ${problem}.` : run?.recovers ? `${sentence(run.stage)}` : "";
  place.hidden = !elsewhere || !words;
  if (place.hidden || place.dataset.words === words) return;
  place.dataset.words = words; // screen readers read it again whenever it is set
  fill(place, el("span", {}, words), unrestored
    ? button("Try to restore again", () => act("retry", {})) : null);
}

function confirming({ live, pending }) {
  const title = el("h2", { id: "live-title" }, `Experiment ${pending.number}: write these values to the plant?`);
  const again = button("Read the plant again", () => act("retry", {}), { id: "read-again" });
  const skip = button("Count it as failed", () => act("fail", { index: pending.index, reason: "it was not run" }));
  if (live.unrestored) {
    again.textContent = "Try to restore again";
    return fill($("view-live"), el("h2", { id: "live-title" }, "The plant does not have its old values yet"),
      el("p", { class: "problem", role: "alert" }, live.problem),
      el("p", {}, `They are kept on the disk, and nothing is written for experiment ${pending.number} until the plant has them. See what keeps it from taking them, or set them there by hand.`),
      el("p", { class: "actions" }, again, skip));
  }
  if (!live.changes) {
    return fill($("view-live"), title, live.problem
      ? [el("p", { class: "problem", role: "alert" }, live.problem), el("p", {}, "Nothing was written."), el("p", { class: "actions" }, again, skip)]
      : el("p", {}, "Reading the plant's present values…"));
  }
  return fill($("view-live"), title,
    live.instructions ? el("p", { class: "instructions" }, live.instructions) : null,
    pending.promise ? el("p", { class: "faint" }, pending.promise) : null,
    live.problem ? el("p", { class: "problem", role: "alert" }, live.problem) : null, written(live.changes),
    el("p", {}, `${live.duration ? `The run records for at most ${seconds(live.duration)}. ` : ""}Afterward ${live.afterward}.${live.stops ? " You can stop it at any time." : ""}`),
    el("p", { class: "actions" }, button("Write and start", () => act("write_and_start", { index: pending.index }), { id: "write-and-start", class: "primary" }), again, skip),
    el("p", { class: "faint" }, "Nothing is written before you confirm."));
}

export const written = (changes) => table(["", "now", "new", "limits", "at most, per second"], changes.map(({ name, unit, old, new: next, limits, rate }) =>
  [symbol(name), withUnit(old, unit), ["→ ", withUnit(next, unit)], withUnit(limits, unit), withUnit(rate, unit)]),
{ class: "changes", label: "What is written", kinds: ["", "number", "number new", "number plain", "number plain"] });

function running({ live, pending }) {
  const { recovers, restores } = live.running;
  const title = recovers ? "Restoring the values from before an interrupted run"
    : restores ? `Experiment ${pending.number} has ended: the plant gets its old values back` : `Experiment ${pending.number} runs on the plant`;
  fill($("view-live"), el("h2", { id: "live-title" }, title),
    el("p", { id: "live-stage", role: "status" }),
    recovers || restores ? el("p", {}, "Nothing else is written until the plant has them. If you end prefcal, they are restored at the next start.") : null,
    el("p", { hidden: recovers || restores }, el("progress", { id: "live-progress", "aria-label": "Recorded time", max: live.duration ?? 1, value: 0 }), " ",
      el("span", { id: "live-left" })),
    el("p", { id: "live-problem", class: "problem", role: "alert", hidden: true }),
    el("p", { class: "actions", hidden: recovers || restores || !live.stops }, 
      button(["Stop and restore the old values ", el("kbd", {}, "K")], stopLive, { id: "live-stop", class: "danger" })),
    el("div", { id: "live-curves" }));
}

function progress({ live }) {
  const { running: run } = live;
  const duration = live.duration ?? Math.max(...run.times, 1);
  const { stage, elapsed, problem, stopping, times, outputs } = run;
  set("live-stage", stopping ? "Stopping: the plant gets its old values back." : sentence(stage));
  $("live-progress").value = elapsed;
  set("live-left", run.records ? `${seconds(Math.max(duration - elapsed, 0))} left` : "");
  set("live-problem", problem);
  $("live-problem").hidden = !problem;
  $("live-stop").disabled = stopping;
  $("stop-live").disabled = stopping;
  fill($("live-curves"), times.length ? outputs.map((output) => curve(output, times, duration)) : []);
}

const sentence = (words) => `${words[0].toUpperCase()}${words.slice(1)}.`;

// Screen readers read a text again whenever it is set.
function set(id, words) {
  if ($(id).textContent !== words) $(id).textContent = words;
}

function seconds(value) {
  const whole = Math.ceil(value);
  if (whole < 120) return `${whole} s`;
  if (whole >= 7200) return `${Math.ceil(whole / 60)} min`;
  return [`${Math.floor(whole / 60)} min`, whole % 60 ? `${whole % 60} s` : ""].join(" ").trim();
}

// Draw an output so far, with its reference, over the time that the run may take.
export function curve({ name, unit, values, reference }, times, duration) {
  const known = [...values, ...reference].filter((value) => value !== null);
  const [low, high] = [Math.min(...known), Math.max(...known)];
  const span = Math.max(high - low, 1e-9, Math.abs(high) * 1e-3);
  const middle = (low + high) / 2;
  const place = (time, value) => `${((WIDE * time) / duration).toFixed(1)},${(HIGH / 2 - ((value - middle) / span) * (HIGH - 12)).toFixed(1)}`;
  const line = (row, kind) => {
    const points = row.flatMap((value, k) => (value === null ? [] : [place(times[k], value)]));
    return svg("polyline", { points: points.join(" "), class: kind });
  };
  const picture = svg("svg", { viewBox: `0 0 ${WIDE} ${HIGH}`, preserveAspectRatio: "none", "aria-hidden": "true" },
    line(reference, "aim"), line(values, "output"));
  const last = values.at(-1);
  const now = last === null || last === undefined ? "bad quality" : withUnit(String(Number(last.toPrecision(4))), unit);
  const aim = reference.at(-1);
  return el("div", { class: "card live-curve" }, el("p", {}, symbol(name), ": ", el("b", {}, now),
    aim === null || aim === undefined ? null : el("span", { class: "faint" }, ` (reference, dashed: ${withUnit(String(Number(aim.toPrecision(4))), unit)})`)), picture);
}
