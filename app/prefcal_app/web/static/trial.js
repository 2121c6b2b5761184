// Try old and new on the plant, one key apart, and confirm which of them stays.

import { $, ask, button, el, fill, values } from "./dom.js";
import { act } from "./flow.js";

export const trial = ({ best, open, blind, kept }) => [kept ? el("p", {}, el("b", {}, kept)) : null,
  el("p", {}, "Enter old and new in turn, and confirm which of them stays on the plant."),
  el("p", { class: "actions" }, button("Old and new", () => show(open, best, false), { id: "trial-open" }),
    button("Blind: A and B", () => show(blind, best, true), { id: "trial-blind" }))];

// Show one side at a time. Values come in the same order and form on both, so that only they differ.
function show(sides, best, blind) {
  let at = 0;
  const place = el("div", { id: "trial-side", "aria-live": "polite" });
  const other = button(["Switch to the other ", el("kbd", {}, "O")], turn, { id: "trial-switch" });
  const draw = () => fill(place, el("h3", {}, sides[at].name),
    el("p", { class: "faint" }, "Enter these values on the plant, then watch it:"), values(sides[at].theta));

  function turn() {
    at = 1 - at;
    draw();
  }

  function pressed(event) {
    if (event.key.toLowerCase() === "o" && !event.ctrlKey && !event.altKey && !event.metaKey && !event.repeat) turn();
  }

  const keep = () => act("keep_on_plant", { index: sides[at].index, best, blind }, "confirmed on the plant");
  ask("Try it on the plant", [place, el("p", {}, other)],
    [["This one stays", keep, "primary"], ["Close, confirm nothing", null]], blind ? "blind" : "trial");
  draw();
  const dialog = $("dialog");
  dialog.addEventListener("keydown", pressed);
  dialog.addEventListener("close", () => dialog.removeEventListener("keydown", pressed), { once: true });
}
