// Draw small static plots: every θ tried, and slices of the learned cost.
/* global Plotly */

import { css } from "./dom.js";

const axis = () => ({ gridcolor: css("--grid"), zeroline: false, linecolor: css("--grid"),
  tickfont: { color: css("--muted"), size: 11 } });

export const base = (width, height) => ({
  width, height, margin: { l: 52, r: 12, t: 8, b: 40 }, showlegend: false, hovermode: false, dragmode: false,
  paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
  font: { family: "system-ui, sans-serif", color: css("--ink"), size: 12 },
});

const STILL = { displayModeBar: false, staticPlot: true };

export const named = (knob) => (knob.unit && knob.unit !== "-" ? `${knob.name} [${knob.unit}]` : knob.name);

// Return "C_A" with a subscript for plotly; characters that could be markup are removed.
export const typeset = (text) => text.replace(/[<>&]/g, "").replace(/_([\p{L}\p{N}]+)/gu, "<sub>$1</sub>");

// Return the axis of a knob over its whole range, with clean ticks if it spans decades.
function along(knob) {
  const log = knob.scale === "log10" && knob.low > 0; // plotly has no logarithms of negative values
  const [low, high] = log ? [Math.log10(knob.low), Math.log10(knob.high)] : [knob.low, knob.high];
  const pad = 0.04 * (high - low);
  const ticks = log && high - low >= 2 ? { dtick: Math.ceil((high - low) / 5) } : { nticks: 5 };
  if (log) ticks.tickformat = "~g"; // by default, plotly labels 0.5 and 50 alike, with their first digit
  return { ...axis(), type: log ? "log" : "linear", range: [low - pad, high + pad], ...ticks };
}

export const titled = (text) => ({ text, font: { size: 12, color: css("--muted") }, standoff: 6 });

// Draw the learned cost along one knob through the best θ; lower is better.
export function slice(div, { knob, x, y, best, samples }) {
  const layout = base(div.clientWidth, 200);
  layout.margin = { ...layout.margin, l: 30 };
  layout.xaxis = { ...along(knob), title: titled(typeset(named(knob))) };
  layout.yaxis = { ...axis(), title: titled("worse →"), showticklabels: false, nticks: 4 };
  const at = x.reduce((near, v, k) => (Math.abs(v - best) < Math.abs(x[near] - best) ? k : near), 0);
  Plotly.react(div, [
    { type: "scatter", mode: "markers", ...samples, marker: { color: css("--muted"), size: 6, opacity: 0.5 } },
    { type: "scatter", mode: "lines", x, y, line: { color: css("--left"), width: 2.2, simplify: false } },
    { type: "scatter", mode: "markers", x: [best], y: [y[at]], marker: { color: css("--left"), size: 13, symbol: "star", line: { color: css("--card"), width: 1 } } },
  ], layout, STILL);
}

export const GROUPS = [
  { kind: "other", sign: "●", words: "another experiment", test: (e) => !e.was_best,
    marker: () => ({ color: css("--muted"), size: 6, opacity: 0.7 }) },
  { kind: "was", sign: "○", words: "was the best for a while", test: (e) => e.was_best && !e.best,
    marker: () => ({ color: css("--left"), size: 8, symbol: "circle-open", line: { width: 2 } }) },
  { kind: "best", sign: "★", words: "the best so far", test: (e) => e.best,
    marker: () => ({ color: css("--left"), size: 14, symbol: "star" }) },
  { kind: "bad", sign: "✕", words: "unsafe: marked, or its run was interrupted", test: (e) => e.marks.some((mark) => mark.startsWith("unsafe")),
    marker: () => ({ color: css("--bad"), size: 9, symbol: "x-thin-open", line: { width: 2 } }) },
];

// Draw all θ tried: one dot per experiment, knob against experiment number.
export function tried(div, knob, k, experiments) {
  const layout = base(div.clientWidth, 190);
  const group = ({ test, marker, words }) => {
    const kept = experiments.filter(test);
    return { type: "scatter", mode: "markers", name: words, x: kept.map((e) => e.number), y: kept.map((e) => e.theta[k]), marker: marker() };
  };
  layout.xaxis = { ...axis(), title: titled("experiment"), rangemode: "tozero", nticks: 6 };
  layout.yaxis = { ...along(knob), title: titled(typeset(named(knob))) };
  Plotly.react(div, GROUPS.map(group), layout, STILL);
}
