// Draw everything simulated: one KPI against another, with what was shown on top.
/* global Plotly */

import { css } from "./bounds.js";
import { base, named, titled, typeset } from "./miniature.js";

const CONFIG = { displayModeBar: false, doubleClick: false, showTips: false };
const HEIGHT = { wide: 430, narrow: 330 };

// Return the range of an axis, in decades if it is logarithmic, and the places of all points on it.
// Runs to the end without a value, for example that never settle, are placed beyond the others.
function along(data, k) {
  const axis = data.axes[k];
  const known = data.points.map(({ values }) => values[k] === null ? null
    : axis.log ? Math.log10(Math.max(values[k], axis.least)) : values[k]);
  const seen = known.filter((value) => value !== null);
  let [low, high] = seen.length ? [Math.min(...seen), Math.max(...seen)] : [0, 1];
  if (!(low < high)) [low, high] = [low - 1, high + 1];
  const pad = 0.05 * (high - low);
  const lacks = known.some((value, row) => value === null && !data.points[row].end);
  const beyond = high + 2.2 * pad;
  const places = known.map((value, row) => value ?? (data.points[row].end ? null : beyond))
    .map((value) => (value !== null && axis.log ? 10 ** value : value));
  return { axis, places, range: [low - pad, lacks ? beyond + pad : high + pad], edge: lacks ? high + pad : null };
}

// Return the points that are drawn: all but the failed and the stopped.
export function drawn(data, which) {
  const [x, y] = which.map((k) => along(data, k).places);
  return data.points.map((point, row) => ({ row, point, x: x[row], y: y[row] })).filter((at) => at.x !== null && at.y !== null);
}

function scale({ axis, range, edge }) {
  const size = (edge ?? range[1]) - range[0];
  const ticks = axis.log ? { dtick: Math.max(1, Math.ceil(size / 6)), tickformat: "~g" } : { nticks: 7 };
  return { gridcolor: css("--grid"), zeroline: false, linecolor: css("--grid"), automargin: true,
    tickfont: { color: css("--muted"), size: 11 }, title: titled(typeset(named({ name: axis.title, unit: axis.unit }))),
    type: axis.log ? "log" : "linear", range, ...ticks };
}

// Shade the strip of the runs without a value, and say what it is.
function strips(x, y) {
  const font = { color: css("--muted"), size: 11 };
  const shade = { type: "rect", fillcolor: css("--grid"), opacity: 0.6, line: { width: 0 }, layer: "below" };
  const raw = (scaled, value) => (scaled.axis.log ? 10 ** value : value); // shapes take values, annotations decades
  const shapes = [];
  const annotations = [];
  if (x.edge !== null) {
    shapes.push({ ...shade, xref: "x", yref: "paper", x0: raw(x, x.edge), x1: raw(x, x.range[1]), y0: 0, y1: 1 });
    annotations.push({ xref: "x", yref: "paper", x: (x.edge + x.range[1]) / 2, y: 0.02, yanchor: "bottom", text: "no value", textangle: -90, showarrow: false, font });
  }
  if (y.edge !== null) {
    shapes.push({ ...shade, xref: "paper", yref: "y", x0: 0, x1: 1, y0: raw(y, y.edge), y1: raw(y, y.range[1]) });
    annotations.push({ xref: "paper", yref: "y", x: 0.01, xanchor: "left", y: (y.edge + y.range[1]) / 2, text: "no value", showarrow: false, font });
  }
  return { shapes, annotations };
}

function traces(data, places, chosen) {
  const group = (name, test, marker, more = {}) => {
    const kept = places.filter(test);
    return { type: "scatter", mode: "markers", name, x: kept.map((at) => at.x), y: kept.map((at) => at.y),
      customdata: kept.map((at) => at.row), marker, hoverinfo: "none", cliponaxis: false, ...more };
  };
  const label = { mode: "markers+text", textposition: "top right", textfont: { color: css("--ink"), size: 12 } };
  const numbered = (name, test, marker) => group(name, test, marker,
    { ...label, text: places.filter(test).map((at) => String(at.point.number ?? "")) });
  const edge = { color: css("--card"), width: 1.5 };
  const { best, sides } = data;
  const side = (name) => group(name, (at) => at.row === sides[name],
    { color: "rgba(0,0,0,0)", size: 21, symbol: "diamond", line: { color: css(`--${name}`), width: 2.5 } });
  return [
    group("simulated", (at) => at.point.number === null, { color: css("--muted"), size: 5, opacity: 0.4 }),
    numbered("shown", (at) => at.point.number !== null && at.row !== best, { color: css("--ink"), size: 9, line: edge }),
    numbered("best", (at) => at.row === best, { color: css("--good"), size: 17, symbol: "star", line: edge }),
    side("left"), side("right"),
    group("chosen", (at) => at.row === chosen, { color: css("--focus"), size: 13, symbol: "circle-open", line: { width: 3 } }),
  ];
}

// Draw the axes `which`, [x, y]; `pick(row)` is called with the point that the person clicks.
export function draw(div, data, which, chosen, pick) {
  const width = div.clientWidth;
  if (!width || typeof Plotly === "undefined") return;
  const [x, y] = which.map((k) => along(data, k));
  const layout = { ...base(width, width < 500 ? HEIGHT.narrow : HEIGHT.wide), hovermode: "closest", hoverdistance: 12,
    margin: { l: 56, r: 16, t: 22, b: 48 },
    xaxis: scale(x), yaxis: scale(y), ...strips(x, y) };
  const fresh = !div.classList.contains("js-plotly-plot");
  Plotly.react(div, traces(data, drawn(data, which), chosen), layout, CONFIG);
  if (fresh) div.on("plotly_click", ({ points }) => pick(points[0].customdata));
}

// Return the nearest drawn point in the direction of an arrow key, as seen on the screen.
export function step(div, data, which, from, [dx, dy]) {
  const { xaxis, yaxis } = div._fullLayout;
  const pixels = drawn(data, which).map(({ row, x, y }) => ({ row, x: xaxis.d2p(x), y: yaxis.d2p(y) }));
  const here = pixels.find(({ row }) => row === from);
  if (!here) return pixels[0]?.row ?? null;
  let [found, least] = [from, Infinity];
  for (const { row, x, y } of pixels) {
    const along = (x - here.x) * dx + (y - here.y) * dy;
    const across = Math.abs((x - here.x) * dy) + Math.abs((y - here.y) * dx);
    const far = along + 3 * across;
    if (row !== from && along > 0.5 && far < least) [found, least] = [row, far];
  }
  return found;
}
