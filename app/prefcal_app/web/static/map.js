// Draw everything simulated: one KPI against another, with what was shown on top.
/* global Plotly */

import { css } from "./dom.js";
import { base, named, titled, typeset } from "./miniature.js";

const CONFIG = { displayModeBar: false, doubleClick: false, showTips: false };
const HEIGHT = { wide: 430, narrow: 330 };

// Return the points that are drawn: all with a value on both axes.
export const drawn = (data, [x, y]) => data.points.map((point, row) => ({ row, point, x: point.values[x], y: point.values[y] }))
  .filter((at) => at.x !== null && at.y !== null);

function scale({ title, unit, log }) {
  const ticks = log ? { type: "log", tickformat: "~g", nticks: 4 } : { nticks: 7 }; // with 5, plotly crowds 70, 80, 90 and 100
  return { gridcolor: css("--grid"), zeroline: false, linecolor: css("--grid"), automargin: true,
    tickfont: { color: css("--muted"), size: 11 }, title: titled(typeset(named({ name: title, unit }))), ...ticks };
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
  const [x, y] = which.map((k) => data.axes[k]);
  const layout = { ...base(width, width < 500 ? HEIGHT.narrow : HEIGHT.wide), hovermode: "closest", hoverdistance: 12,
    margin: { l: 56, r: 16, t: 22, b: 48 }, xaxis: scale(x), yaxis: scale(y) };
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
