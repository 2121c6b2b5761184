// Remember what part of the curves is shown: for the next question, and after a reload.

import { target } from "./axes.js";
import { keep, kept } from "./dom.js";

const KEY = "prefcal-zoom";
export const EVENTS = { kind: "events" }, WHOLE = { kind: "whole" }, TARGET = { kind: "target" };
let chosen = null;

// A part that was dragged belongs to these panels only: other questions may have other units.
const subject = ({ maneuver, panels }) => [maneuver, ...panels.map(({ title, unit }) => `${title} ${unit}`)].join("|");

export const dragged = (question, view) => ({ kind: "dragged", of: subject(question), view });

export function remember(zoom) {
  chosen = zoom;
  keep(KEY, JSON.stringify(zoom), "sessionStorage");
}

// Return what was chosen last; at first, the time in which things happen.
export function recalled() {
  try {
    chosen ??= JSON.parse(kept(KEY, "sessionStorage"));
  } catch {
    // Nothing of ours.
  }
  return chosen ?? EVENTS;
}

export const applies = ({ kind, of }, question) =>
  kind === "target" || (kind === "dragged" && of === subject(question));

// Return the axes of a question.
export function view(zoom, question, all) {
  if (zoom.kind === "whole" || !question.window) return all;
  if (!applies(zoom, question)) return { x: question.window, y: all.y };
  return zoom.kind === "target" ? target(question, all) : zoom.view;
}
