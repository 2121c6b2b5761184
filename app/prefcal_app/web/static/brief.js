// Show the briefing: the task, what knobs and KPIs mean, and how long it takes.

import { get } from "./api.js";
import { $, el, fill, symbol } from "./dom.js";

let known = null;
let closed = false;

async function brief() {
  known ??= await get("/api/brief");
  return known;
}

// Return the full briefing, for the dialog and the page that waits for the first experiments.
export async function briefing() {
  let told;
  try {
    told = await brief();
  } catch (error) {
    return [el("p", { class: "problem" }, error.message)];
  }
  return [
    told.text ? el("p", { class: "task" }, symbol(told.text)) : null,
    el("p", {}, told.how),
    told.start ? el("p", {}, told.start) : null,
    told.panels.length ? el("p", {}, `Look at the curves first (${told.panels.join(", ")}), then at the numbers above them.`) : null,
    table("The knobs: what differs between experiments", told.knobs.map((knob) =>
      [knob.name, knob.about, `${knob.range} ${knob.unit}`.trim()])),
    table("KPIs: what is measured", told.kpis.map((kpi) =>
      [kpi.unit ? `${kpi.title} [${kpi.unit}]` : kpi.title, kpi.about, kpi.wanted])),
  ].filter(Boolean);
}

function table(title, rows) {
  if (!rows.length) return null;
  return el("section", {}, el("h3", {}, title), el("div", { class: "scroll" }, el("table", { class: "words" },
    el("tbody", {}, rows.map(([name, about, range]) => el("tr", {},
      el("th", { scope: "row" }, symbol(name)), el("td", {}, symbol(about)), el("td", { class: "faint" }, range)))))));
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
    : [first ? "The first question follows." : "Your answer is saved.", unseen ? `${unseen.going_on || unseen.line}.` : ""].join(" ").trim();
  const bar = $("wait-progress");
  bar.hidden = !preparing && !unseen?.going_on;
  if (preparing) [bar.max, bar.value] = [preparing.parts, preparing.part - 1];
  else if (unseen) [bar.max, bar.value] = [unseen.due, unseen.simulated];
  const stops = number && stopping && !preparing;
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
  const { text } = await brief();
  if (!text || closed) return;
  const button = (words, run, kind = "") => el("button", { type: "button", class: kind, on: { click: run } }, words);
  fill(place, el("p", { tabindex: "0" }, symbol(text)), el("p", { class: "actions" },
    button("Got it", () => {
      [closed, place.hidden] = [true, true];
      dispatchEvent(new Event("resize"));
    }),
    button(["Knobs, KPIs and keys ", el("kbd", {}, "?")], () => $("help").click())));
  place.hidden = false;
  dispatchEvent(new Event("resize")); // the curves fill the remaining space
}
