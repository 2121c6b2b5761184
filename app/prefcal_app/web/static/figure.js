// Build one plotly figure: panels stacked over one time axis, with their targets and limits.

import { css } from "./dom.js";

export const MARGIN = { l: 46, r: 10, t: 4, b: 38 };
export const HEAD = 20; // px above each panel, for its title

const LIMIT = () => ({ color: css("--bad"), width: 1.3, dash: "dash" });
const TARGET = () => ({ color: css("--good"), width: 1.3, dash: "dot" });

// Return plotly shapes across the whole panel of the axis `yref`. Limits that change in time are
// drawn as curves instead: `held` says which of the two do.
function bounds(panel, yref, held) {
  const across = { xref: "paper", x0: 0, x1: 1, yref };
  const level = (y, line) => ({ type: "line", ...across, y0: y, y1: y, line });
  const shapes = [];
  if (panel.target !== null && panel.band) {
    shapes.push({ type: "rect", ...across, y0: panel.target - panel.band, y1: panel.target + panel.band,
      fillcolor: css("--band"), line: { width: 0 }, layer: "below" });
  }
  if (panel.target !== null) shapes.push(level(panel.target, TARGET()));
  [panel.low, panel.high].forEach((limit, k) => {
    if (limit !== null && !held[k]) shapes.push(level(limit, LIMIT()));
  });
  return shapes;
}

const written = (value) => String(value).replace("-", "−");

const LEAST = 3; // px: a thinner band is hidden by the line of its target

// Return in words the target and the limits that are drawn: those within `range`, the axis of panel
// i in a figure of these `sides`, which is `height` px high. Of a limit that changes, every value.
export function aims({ target, band, low, high }, i, { sides, range, height }) {
  const seen = (value) => value !== null && value >= range[0] && value <= range[1];
  const taken = (k, limit) => {
    const changing = sides.flatMap((side) => side.limits[i]?.[k]?.y ?? []).filter((v) => v !== null);
    const all = [...new Set(changing.length ? changing : [limit])].filter(seen).sort((a, b) => a - b);
    return all.length > 4 ? `${written(all[0])}…${written(all.at(-1))}` : all.map(written).join(" or ");
  };
  const words = [];
  const thick = band && (2 * band * height) / (range[1] - range[0]) >= LEAST;
  if (seen(target)) words.push(`target ${written(target)}${thick ? ` ± ${band}` : ""}`);
  else if (target === null && sides.some((side) => side.references[i])) words.push("reference dotted");
  const [least, most] = [taken(0, low), taken(1, high)];
  if (least && most) words.push(`limits ${least} to ${most}`);
  else if (most) words.push(`limit ${most}`);
  else if (least) words.push(`at least ${least}`);
  return words.length ? ` · ${words.join(" · ")}` : "";
}

const axisOf = (i) => (i ? `y${i + 1}` : "y");
const sidesOf = (name) => (name === "both" ? ["left", "right"] : [name]);

// Return the top and bottom of panel i of n, in px from the top.
export function place(i, n, height) {
  const each = (height - MARGIN.t - MARGIN.b) / n;
  return { top: MARGIN.t + i * each + HEAD, bottom: MARGIN.t + (i + 1) * each - 4 };
}

export function traces(question, name) {
  return sidesOf(name).flatMap((side) => question.panels.flatMap((panel, i) =>
    lines(question[side], panel, i, css(`--${side}`), name === "both" && side === "right" ? "6px,3px" : "solid")));
}

function lines({ curves, references, limits }, panel, i, color, dash) {
  const common = { type: "scatter", mode: "lines", yaxis: axisOf(i), hoverinfo: "skip" };
  const held = (curve, line) => ({ ...common, x: curve.t, y: curve.y, line: { ...line, shape: "hv" } });
  const shape = panel.shape === "step" ? "hv" : "linear";
  const line = { color, width: 2, shape, dash, simplify: false }; // plotly's simplification adds kinks that the plant does not have
  return [
    ...limits[i].filter(Boolean).map((limit) => held(limit, LIMIT())),
    ...[references[i]].filter(Boolean).map((reference) => held(reference, TARGET())),
    ...curves[i].map((curve, run) => ({ ...common, x: curve.t, y: curve.y,
      line: run ? { ...line, width: 1 } : line, opacity: run ? 0.45 : 1 })),
  ];
}

// Say how to see the rest of the time, if only a part is shown, and where things happen in it.
function rest({ axes: { x }, windows }, { x: shown, part }, unit) {
  if (shown[0] <= x[0] && shown[1] >= x[1]) return "";
  const how = matchMedia("(hover: none)").matches ? "double-tap" : "key 0";
  const next = windows[part + 1]; // a zoom to the target is no part
  if (next) return ` · ${how}: moves again from ${Number(next[0].toPrecision(4))} ${unit}`;
  return ` · ${how}: all of the time`;
}

export function layout(question, name, view, unit, { width, height }) {
  const { panels } = question;
  const plain = unit.replace(/[<>&]/g, "");
  const inner = height - MARGIN.t - MARGIN.b;
  const font = { color: css("--muted"), size: 11 };
  const grid = { gridcolor: css("--grid"), zeroline: false, linecolor: css("--grid"), tickfont: font, ticklen: 0, automargin: false };
  const made = {
    width, height, margin: { ...MARGIN, pad: 0 }, showlegend: false, hovermode: false,
    paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", dragmode: "zoom",
    font: { family: "system-ui, sans-serif" }, shapes: [],
    xaxis: { ...grid, range: [...view.x], anchor: `y${panels.length > 1 ? panels.length : ""}`, nticks: width < 420 ? 6 : 10,
      title: { text: unit ? `time [${plain}]${rest(question, view, plain)}` : "time", font: { ...font, size: 12 }, standoff: 4 } },
  };
  panels.forEach((panel, i) => {
    const { top, bottom } = place(i, panels.length, height);
    const at = (px) => Math.min(Math.max(1 - (px - MARGIN.t) / inner, 0), 1);
    made[i ? `yaxis${i + 1}` : "yaxis"] = { ...grid, range: [...view.y[i]],
      domain: [at(bottom), at(top)], anchor: "x", nticks: 5 };
    const held = [0, 1].map((k) => sidesOf(name).some((side) => question[side].limits[i][k]));
    made.shapes.push(...bounds(panel, axisOf(i), held));
  });
  return made;
}
