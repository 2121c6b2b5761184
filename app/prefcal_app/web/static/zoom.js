// Say what part of the curves is shown, on axes that both sides share, and remember it: for the next
// question, and after a reload.

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

function extent(values, into) {
  for (const value of values) {
    if (value === null) continue; // a gap in the curve
    if (value < into[0]) into[0] = value;
    if (value > into[1]) into[1] = value;
  }
  return into;
}

const aimed = (panel) => panel.target !== null && panel.band;

// Return the axes of the interesting time: from just before either side comes near its target
// until just after both stay there. Without a band, the time while a reference moves; without a
// reference, the whole time of these two runs.
function target(question, all) {
  const { panels, left, right } = question;
  const spans = [left, right].flatMap((side) => panels.some(aimed)
    ? panels.flatMap((panel, i) => (aimed(panel) ? side.curves[i].map((c) => settling(panel, c)) : []))
    : side.references.filter(Boolean).map(moving));
  const [from, to] = extent(spans.flat(), [Infinity, -Infinity]);
  if (!(from <= to)) return these(question, all);
  const pad = Math.max(0.08 * (to - from), 0.03 * (all.x[1] - all.x[0]));
  const x = [Math.max(all.x[0], from - pad), Math.min(all.x[1], to + 2 * pad)];
  const y = panels.map((panel, i) => (aimed(panel)
    ? [panel.target - 8 * panel.band, panel.target + 8 * panel.band] : within(x, drawn(question, i), all.y[i])));
  return { x, y };
}

const drawn = ({ left, right }, i) =>
  [left, right].flatMap((side) => [...side.curves[i], side.references[i]]).filter(Boolean);

// Return the axes of these two experiments alone, within the study's.
function these(question, all) {
  const x = [Infinity, -Infinity];
  for (const side of [question.left, question.right]) {
    for (const { t } of side.curves.flat()) extent([t[0], t.at(-1)], x);
  }
  if (!(x[0] < x[1])) return all;
  return { x, y: question.panels.map((_, i) => within(x, drawn(question, i), all.y[i])) };
}

// Return the range of the curves within `x`, at least a tenth of the full axis, so that noise does
// not fill a panel.
function within([from, to], curves, [low, high]) {
  const seen = [Infinity, -Infinity];
  for (const { t, y } of curves) extent(y.filter((_, k) => t[k] >= from && t[k] <= to), seen);
  if (!(seen[0] <= seen[1])) return [low, high];
  const middle = (seen[0] + seen[1]) / 2;
  const half = Math.max((seen[1] - seen[0]) * 0.56, (high - low) / 20);
  return [Math.max(low, middle - half), Math.min(high, middle + half)];
}

// Return when a curve first comes near the target, and when it enters the band for good.
function settling({ target: aim, band }, { t, y }) {
  const near = y.findIndex((v) => Math.abs(v - aim) <= 8 * band);
  const out = y.findLastIndex((v) => Math.abs(v - aim) > band);
  const inside = t[Math.min(out + 1, t.length - 1)];
  return near >= 0 ? [t[near], inside] : [inside];
}

const moving = ({ t, y }) => t.filter((_, k) => k && y[k] !== y[k - 1]);
