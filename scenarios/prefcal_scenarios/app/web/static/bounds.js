// Draw what a panel shows besides curves: the target with its band, and the limits.

const known = new Map();
let theme = "";

// Return a color of the style sheet, read once per theme because reading triggers a layout.
export function css(name) {
  const { theme: now } = document.documentElement.dataset;
  if (now !== theme) known.clear();
  theme = now;
  if (!known.has(name)) known.set(name, getComputedStyle(document.documentElement).getPropertyValue(name).trim());
  return known.get(name);
}

export const LIMIT = () => ({ color: css("--bad"), width: 1.3, dash: "dash" });
export const TARGET = () => ({ color: css("--good"), width: 1.3, dash: "dot" });

// Return plotly shapes across the whole panel of the axis `yref`. Limits that change in time are
// drawn as curves instead: `held` says which of the two do.
export function bounds(panel, yref, held) {
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

// Return target and limits in words, with every value of a limit that changes.
export function aims(panel, question) {
  const sides = [question.left, question.right];
  const i = question.panels.indexOf(panel);
  const taken = (k, limit) => {
    const values = sides.flatMap((side) => side.limits[i]?.[k]?.y ?? []).filter((v) => v !== null);
    const all = values.length ? [...new Set(values)].sort((a, b) => a - b) : [limit];
    return all.length > 4 ? `${written(all[0])}…${written(all.at(-1))}` : all.map(written).join(" or ");
  };
  const words = [];
  if (panel.target !== null) words.push(`target ${written(panel.target)}${panel.band ? ` ± ${panel.band}` : ""}`);
  else if (sides.some((side) => side.references[i])) words.push("reference dotted");
  if (panel.low !== null && panel.high !== null) words.push(`limits ${taken(0, panel.low)} to ${taken(1, panel.high)}`);
  else if (panel.high !== null) words.push(`limit ${taken(1, panel.high)}`);
  else if (panel.low !== null) words.push(`at least ${taken(0, panel.low)}`);
  return words.length ? ` · ${words.join(" · ")}` : "";
}
