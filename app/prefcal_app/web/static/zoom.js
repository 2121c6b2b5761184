// Say what part of the curves is shown, on axes that both sides share, and remember it: for the next
// question, and after a reload.

import { keep, kept } from "./dom.js";

const KEY = "prefcal-zoom";
export const EVENTS = { kind: "events", part: 0 }, WHOLE = { kind: "whole" }, TARGET = { kind: "target" };
let chosen = null;

// A part that was dragged belongs to these panels only: other questions may have other units.
const subject = ({ maneuver, panels }) => [maneuver, ...panels.map(({ title, unit }) => `${title} ${unit}`)].join("|");

export const dragged = (question, view) => ({ kind: "dragged", of: subject(question), view });

export function remember(zoom) {
  chosen = zoom;
  keep(KEY, JSON.stringify(zoom), "sessionStorage");
}

// Return what was chosen last; at first, and for each new question, the first time in which things happen.
export function recalled() {
  try {
    chosen ??= JSON.parse(kept(KEY, "sessionStorage"));
  } catch {
    // Nothing of ours.
  }
  return !chosen || chosen.kind === "events" ? EVENTS : chosen;
}

export const applies = ({ kind, of }, question) =>
  kind === "target" || (kind === "dragged" && of === subject(question));

// Return what follows a zoom: each part of the time in which things happen, the whole time, the first part.
export function following({ kind, part }, { windows }) {
  if (kind === "whole") return EVENTS;
  return kind === "events" && part + 1 < windows.length ? { ...EVENTS, part: part + 1 } : WHOLE;
}

// Return the axes of a question.
export function view(zoom, question, all) {
  if (zoom.kind === "whole" || !question.windows.length) return all;
  if (!applies(zoom, question)) return { x: question.windows[zoom.part] ?? question.windows[0], y: all.y, part: zoom.part };
  return zoom.kind === "target" ? target(question, all) : zoom.view;
}

const aimed = (panel) => panel.target !== null && panel.band;

// Return the axes around the target, in the time in which things happen; panels without a band get
// the range of their curves in that time.
function target({ panels, windows: [x], left, right }, all) {
  return { x, y: panels.map((panel, i) => {
    if (aimed(panel)) return [panel.target - 8 * panel.band, panel.target + 8 * panel.band];
    return within(x, [left, right].flatMap((side) => [...side.curves[i], side.references[i]]).filter(Boolean), all.y[i]);
  }) };
}

// Return the range of the curves within `x`, at least a tenth of the full axis, so that noise does
// not fill a panel.
function within([from, to], curves, [low, high]) {
  const seen = curves.flatMap(({ t, y }) => y.filter((value, k) => value !== null && t[k] >= from && t[k] <= to));
  if (!seen.length) return [low, high];
  const [least, most] = seen.reduce(([a, b], value) => [Math.min(a, value), Math.max(b, value)], [Infinity, -Infinity]);
  const half = Math.max((most - least) * 0.56, (high - low) / 20);
  return [Math.max(low, (least + most) / 2 - half), Math.min(high, (least + most) / 2 + half)];
}
