// Show what there is while no question is: the briefing, progress, and an experiment that could not run.

import { fetched, get } from "./api.js";
import { $, button, el, fill, symbol, table, values } from "./dom.js";
import { can } from "./flow.js";

let known = null;
let closed = false;

// Return the full briefing, for the dialog and the page that waits for the first experiments.
export async function briefing() {
  const place = el("div", {});
  const told = known ??= await fetched(place, "/api/brief");
  if (!told) return [place];
  const words = (title, rows) => (rows.length ? el("section", {}, el("h3", {}, title), table(null, rows.map(([name, about, range]) =>
    [symbol(name), symbol(about), range]), { class: "words", kinds: ["", "", "faint"] })) : null);
  return [
    told.text ? el("p", { class: "task" }, symbol(told.text)) : null,
    el("p", {}, told.how),
    told.start ? el("p", {}, told.start) : null,
    told.panels.length ? el("p", {}, `Look at the curves first (${told.panels.join(", ")}), then at the numbers above them.`) : null,
    words("The knobs: what differs between experiments", told.knobs.map((knob) => [knob.name, knob.about, `${knob.range} ${knob.unit}`.trim()])),
    words("KPIs: what is measured", told.kpis.map((kpi) => [kpi.unit ? `${kpi.title} [${kpi.unit}]` : kpi.title, kpi.about, kpi.wanted])),
  ].filter(Boolean);
}

// Show progress while there is no question yet and, before the first one, the briefing.
export function waitFor({ pending, preparing, progress, simulated, stopping }, act) {
  const first = progress.answered === 0;
  const number = pending?.number;
  const which = progress.running > 1 ? `${progress.running} experiments` : `experiment ${number}`;
  const running = number ? `Running ${which}` : "Choosing the next experiment";
  $("wait-title").textContent = preparing ? "Getting ready" : running;
  const unseen = number ? null : simulated;
  $("wait-text").textContent = preparing
    ? `Compiling the solver, part ${preparing.part} of ${preparing.parts} (${preparing.title}): only once on this machine.`
    : [first ? "The first question follows." : "Your answer is saved.", ...(unseen ? [`${unseen.going_on || unseen.line}.`, unseen.pace] : [])].join(" ").trim();
  const bar = $("wait-progress");
  bar.hidden = !preparing && !unseen?.going_on;
  if (preparing) [bar.max, bar.value] = [preparing.parts, preparing.part - 1];
  else if (unseen) [bar.value, bar.max] = unseen.progress;
  const stops = can("stop_run") && !preparing;
  $("stop").hidden = !stops;
  $("stop-run").onclick = () => act("stop_run", { index: pending.index });
  $("stop-text").textContent = stops ? stopping : "";
  $("view-wait").classList.toggle("briefed", first);
  $("wait-brief").hidden = !first;
  if (first && !$("wait-brief").firstChild) briefing().then((nodes) => fill($("wait-brief"), nodes));
}

// Show the task above the first question until the person closes it.
export async function intro(now) {
  const place = $("intro");
  const due = now.progress.answered === 0 && !now.question.repeat && !closed;
  if (!due) place.hidden = true;
  if (!due || place.firstChild) return;
  known ??= await get("/api/brief");
  const { text } = known;
  if (!text || closed) return;
  const show = (shown) => {
    place.hidden = !shown;
    dispatchEvent(new Event("resize")); // the curves fill the remaining space
  };
  fill(place, el("p", { tabindex: "0" }, symbol(text)), el("p", { class: "actions" },
    button("Got it", () => {
      closed = true;
      show(false);
    }),
    button(["Knobs, KPIs", el("span", { class: "by-key" }, " and keys "), el("kbd", {}, "?")], () => $("help").click())));
  show(true);
}

// Show an experiment that could not run, or a study file that could not be written.
export function showFailed({ pending, problem, live }, act) {
  const title = pending ? `Experiment ${pending.number} ${live ? "was not completed" : "did not run"}` : "That did not work";
  fill($("view-failed"), el("h2", { id: "failed-title" }, title), el("p", { class: "problem" }, problem),
    pending ? values(pending.theta) : null,
    el("p", {}, "Each answer was saved when you gave it."),
    el("p", { class: "actions" }, can("retry") ? button("Try again", () => act("retry", {}), { class: "primary" }) : null,
      can("fail") ? button("Count it as failed", () => act("fail", { index: pending.index, reason: problem ?? "" })) : null));
}
