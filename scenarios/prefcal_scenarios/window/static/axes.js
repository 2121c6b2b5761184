// The axes, which both sides share: the whole of both runs, or the window around the target.

function extent(values, into) {
  for (const value of values) {
    if (value < into[0]) into[0] = value;
    if (value > into[1]) into[1] = value;
  }
  return into;
}

function padded([low, high], share = 0.06) {
  if (!(low < high)) return [low - 1, high + 1];
  const pad = share * (high - low);
  return [low - pad, high + pad];
}

// Limits that the curves come near are part of the picture; those far away would only flatten
// it. But nothing is magnified beyond a tenth of what is allowed: that would be noise.
function framed(panel, [low, high]) {
  const limits = [panel.low, panel.high].filter((v) => v !== null);
  if (!limits.length || !(low <= high)) return [low, high];
  const span = Math.max(high - low, limits.length > 1 ? (panel.high - panel.low) / 10 : 0);
  const middle = (low + high) / 2;
  const range = [Math.min(low, middle - span / 2), Math.max(high, middle + span / 2)];
  return extent(limits.filter((v) => Math.max(low - v, v - high) <= 2 * span), range);
}

// Axes that hold both sides, and what is drawn beside the curves.
export function whole(question) {
  const x = [Infinity, -Infinity];
  const y = question.panels.map((panel, i) => {
    const range = [Infinity, -Infinity];
    for (const side of [question.left, question.right]) {
      for (const curve of [...side.curves[i], side.references[i]].filter(Boolean)) {
        extent(curve.t, x);
        extent(curve.y, range);
      }
    }
    const { target: aim, band } = panel;
    if (aim !== null) extent([aim - (band ?? 0), aim + (band ?? 0)], range);
    const seen = framed(panel, range);
    return padded(seen[0] <= seen[1] ? seen : [panel.low ?? 0, panel.high ?? 1]);
  });
  return { x: x[0] < x[1] ? x : [0, 1], y };
}

const aimed = (panel) => panel.target !== null && panel.band;

// From just before either side comes near its target until just after both stay there; where no
// panel has a band, while a reference moves.
export function target(question, all) {
  const { panels, left, right } = question;
  const spans = [left, right].flatMap((side) => panels.some(aimed)
    ? panels.flatMap((panel, i) => (aimed(panel) ? side.curves[i].map((c) => settling(panel, c)) : []))
    : side.references.filter(Boolean).map(moving));
  const [from, to] = extent(spans.flat(), [Infinity, -Infinity]);
  if (!(from <= to)) return all;
  const pad = Math.max(0.08 * (to - from), 0.03 * (all.x[1] - all.x[0]));
  const x = [Math.max(all.x[0], from - pad), Math.min(all.x[1], to + 2 * pad)];
  const y = panels.map((panel, i) => (aimed(panel)
    ? [panel.target - 8 * panel.band, panel.target + 8 * panel.band]
    : within(x, [left, right].flatMap((side) => [...side.curves[i], side.references[i]]), all.y[i])));
  return { x, y };
}

// What curves reach while `x` is shown, but not less than a quarter of the whole: beside the
// target, nobody wants noise filling a panel.
function within([from, to], curves, [low, high]) {
  const seen = [Infinity, -Infinity];
  for (const { t, y } of curves.filter(Boolean)) extent(y.filter((_, k) => t[k] >= from && t[k] <= to), seen);
  if (!(seen[0] <= seen[1])) return [low, high];
  const middle = (seen[0] + seen[1]) / 2;
  const half = Math.max((seen[1] - seen[0]) * 0.56, (high - low) / 8);
  return [Math.max(low, middle - half), Math.min(high, middle + half)];
}

// When a curve first comes near the target, and when it is in the band for good.
function settling({ target: aim, band }, { t, y }) {
  const near = y.findIndex((v) => Math.abs(v - aim) <= 8 * band);
  const out = y.findLastIndex((v) => Math.abs(v - aim) > band);
  const inside = t[Math.min(out + 1, t.length - 1)];
  return near >= 0 ? [t[near], inside] : [inside];
}

const moving = ({ t, y }) => t.filter((_, k) => k && y[k] !== y[k - 1]);
