// Try old and new on the plant, one key apart, and confirm which of them stays.

import { $, ask, button, el, fill, values } from "./dom.js";
import { act, current } from "./flow.js";
import { curve, stopLive, written } from "./live.js";

export const trial = ({ best, open, blind, kept, live }) => [kept ? el("p", {}, el("b", {}, kept)) : null,
  el("p", {}, live ? "prefcal writes old and new in turn, and you confirm which of them stays. If you confirm none, the plant gets back what it has now."
    : "Enter old and new in turn, and confirm which of them stays on the plant."),
  el("p", { class: "actions" }, button("Old and new", () => (live ? read(false) : show(open, best, false)), { id: "trial-open" }),
    button("Blind: A and B", () => (live ? read(true) : show(blind, best, true)), { id: "trial-blind" }))];

// Show one side at a time. Values come in the same order and form on both, so that only they differ.
function show(sides, best, blind) {
  let at = 0;
  const place = el("div", { id: "trial-side", "aria-live": "polite" });
  const draw = () => fill(place, el("h3", {}, sides[at].name),
    el("p", { class: "faint" }, "Enter these values on the plant, then watch it:"), values(sides[at].theta));

  function turn() {
    at = 1 - at;
    draw();
  }

  const keep = () => act("keep_on_plant", { index: sides[at].index, best, blind }, "confirmed on the plant");
  ask("Try it on the plant", [place, el("p", {}, switching(turn))],
    [["This one stays", keep, "primary"], ["Close, confirm nothing", null]], blind ? "blind" : "trial");
  draw();
  whileOpen(turn);
}

const switching = (turn) => button(["Switch to the other ", el("kbd", {}, "O")], turn, { id: "trial-switch" });

// Let O switch while the dialog is open; call `closed` once it is not.
function whileOpen(turn, closed = () => {}) {
  const dialog = $("dialog");
  const pressed = ({ key, ctrlKey, altKey, metaKey, repeat }) => {
    if (key.toLowerCase() === "o" && !ctrlKey && !altKey && !metaKey && !repeat) turn();
  };
  document.addEventListener("keydown", pressed);
  dialog.addEventListener("close", () => {
    document.removeEventListener("keydown", pressed);
    closed();
  }, { once: true });
}

// Of a live plant, the study says what is read, written and shown; any page follows it, also after a reload.
let drawn = null; // what the dialog shows; its parts are then changed in place, so that the focus stays

const the = () => current()?.over?.trial;
const sidesOf = ({ live, open, blind }) => (live.blind ? blind : open);
const write = ({ best, live }, { index }) => act("try_on_plant", { best, index, blind: live.blind });

async function read(blind) {
  if (await act("try_on_plant", { best: the().best, index: null, blind })) opened();
}

function opened() {
  drawn = "";
  ask("Try it on the plant", el("div", { id: "trial-place" }), [], the().live.blind ? "blind" : "trial");
  whileOpen(turn, () => {
    drawn = null;
    if (the()?.live?.moves) act("end_trial", {});
  });
  follow(current());
}

function turn() {
  const now = the();
  if (now?.live?.moves) write(now, sidesOf(now).find(({ index }) => index !== now.live.wanted));
}

// Draw how far the trial on a live plant is; open and close its dialog with it.
export function follow(now) {
  const tried = now.over?.trial, live = tried?.live;
  if (drawn === null) {
    if (live?.moves && !$("dialog").open) opened();
    return;
  }
  if (!live || !(live.moves || live.reads || live.problem || live.changes.length)) {
    $("dialog").close();
    return;
  }
  const kind = JSON.stringify(live.moves ? [live.wanted, now.live.running?.restores] : live);
  if (kind !== drawn) {
    fill($("trial-place"), live.moves ? held(tried, now) : asked(tried, now.live.instructions));
    $("dialog-title").focus(); // what had it may be gone
  }
  drawn = kind;
  if (live.moves) progress(tried, now);
}

function asked(tried, instructions) {
  const { reads, problem, changes } = tried.live;
  if (reads) return el("p", {}, "Reading the plant's present values…");
  const close = button("Close", () => $("dialog").close());
  const again = button("Read the plant again", () => act("try_on_plant", { best: tried.best, index: null, blind: tried.live.blind }));
  if (!changes.length) return [el("p", { class: "problem", role: "alert" }, `${problem}.`), el("p", { class: "actions" }, again, close)];
  return [instructions ? el("p", { class: "instructions" }, instructions) : null, written(changes), el("p", {}, "Only these values are written, no start value: the plant runs as usual. It gets back what it has now unless you confirm one of the two."),
    el("p", { class: "actions" }, button("Write and try", () => write(tried, sidesOf(tried)[0]), { id: "trial-write", class: "primary" }), close),
    el("p", { class: "faint" }, "Nothing is written before you choose.")];
}

function held(tried, { live }) {
  const { index, name, theta } = sidesOf(tried).find((side) => side.index === tried.live.wanted);
  if (live.running?.restores) return el("p", { role: "status" }, "The plant gets back the values from before.");
  const keep = () => act("keep_on_plant", { index, best: tried.best, blind: tried.live.blind }, "confirmed on the plant");
  return [el("div", { id: "trial-side", "aria-live": "polite" }, el("h3", {}, name), values(theta)), el("p", { id: "trial-stage", role: "status" }),
    el("p", {}, switching(turn)), el("p", { class: "actions" }, button("This one stays", keep, { id: "trial-keep", class: "primary" }),
      button(["Confirm nothing, restore the values from before ", el("kbd", {}, "K")], stopLive, { id: "trial-end" })),
    el("div", { id: "trial-curves" })];
}

function progress({ live: { shown } }, { live: { running } }) {
  if (!$("trial-stage")) return;
  const words = shown === null ? "It is being written…" : "It is on the plant. Watch it, and switch as often as you like.";
  if ($("trial-stage").textContent !== words) $("trial-stage").textContent = words; // screen readers read it again
  $("trial-keep").disabled = shown === null;
  const { times = [], outputs = [] } = running ?? {};
  fill($("trial-curves"), times.length ? outputs.map((output) => curve(output, times, Math.max(times.at(-1), 1e-9))) : []);
}
