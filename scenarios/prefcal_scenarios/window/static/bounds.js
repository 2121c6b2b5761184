// What a panel states besides curves: its target with the band, and its limits.

export const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

// As plotly's shapes, across the whole panel of the axis `yref`.
export function bounds(panel, yref) {
  const across = { xref: "paper", x0: 0, x1: 1, yref };
  const level = (y, line) => ({ type: "line", ...across, y0: y, y1: y, line });
  const shapes = [];
  if (panel.target !== null && panel.band) {
    shapes.push({ type: "rect", ...across, y0: panel.target - panel.band, y1: panel.target + panel.band,
      fillcolor: css("--band"), line: { width: 0 }, layer: "below" });
  }
  if (panel.target !== null) shapes.push(level(panel.target, { color: css("--good"), width: 1.3, dash: "dot" }));
  for (const limit of [panel.low, panel.high]) {
    if (limit !== null) shapes.push(level(limit, { color: css("--bad"), width: 1.3, dash: "dash" }));
  }
  return shapes;
}
