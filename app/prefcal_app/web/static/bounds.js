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
