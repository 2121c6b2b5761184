// Curves without cursor and zoom: an earlier question, slices of what was learned.
/* global Plotly */

const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

const axis = () => ({ gridcolor: css("--grid"), zeroline: false, linecolor: css("--grid"),
  tickfont: { color: css("--muted"), size: 11 }, titlefont: { color: css("--muted") } });

export const base = (width, height) => ({
  width, height, margin: { l: 52, r: 12, t: 8, b: 40 }, showlegend: false, hovermode: false, dragmode: false,
  paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
  font: { family: "system-ui, sans-serif", color: css("--ink"), size: 12 },
});

const STILL = { displayModeBar: false, staticPlot: true };

// Both sides of an earlier question have the same axes, as they had then.
export function miniature(div, question, name, unit) {
  const { panels } = question;
  const traces = [];
  const ranges = panels.map((panel, i) => {
    const values = [question.left, question.right].flatMap((side) => side.curves[i].flatMap((c) => c.y));
    const low = Math.min(...values), high = Math.max(...values);
    const pad = 0.06 * (high - low || 1);
    return [low - pad, high + pad];
  });
  panels.forEach((panel, i) => question[name].curves[i].forEach((curve) => traces.push({ type: "scatter",
    mode: "lines", x: curve.t, y: curve.y, yaxis: i ? `y${i + 1}` : "y",
    line: { color: css(`--${name}`), width: 1.8, shape: panel.shape === "step" ? "hv" : "linear" } })));
  const layout = base(div.clientWidth, 130 * panels.length + 30);
  layout.xaxis = { ...axis(), title: { text: `time [${unit}]` }, anchor: `y${panels.length > 1 ? panels.length : ""}` };
  panels.forEach((panel, i) => {
    layout[i ? `yaxis${i + 1}` : "yaxis"] = { ...axis(), range: ranges[i], nticks: 4,
      domain: [1 - (i + 0.92) / panels.length, 1 - i / panels.length],
      title: { text: panel.unit ? `${panel.symbol} [${panel.unit}]` : panel.symbol, font: { size: 11, color: css("--muted") } } };
  });
  Plotly.react(div, traces, layout, STILL);
}

// What was learned along one knob through the best θ: lower is better.
export function slice(div, { knob, x, y, best }) {
  const layout = base(div.clientWidth, 190);
  const title = knob.unit && knob.unit !== "-" ? `${knob.name} [${knob.unit}]` : knob.name;
  layout.xaxis = { ...axis(), title: { text: title }, type: knob.scale === "log10" ? "log" : "linear" };
  layout.yaxis = { ...axis(), title: { text: "worse →", font: { size: 11, color: css("--muted") } }, nticks: 4 };
  const at = knob.scale === "log10" ? Math.log10(best) : best;
  layout.shapes = [{ type: "line", x0: at, x1: at, yref: "paper", y0: 0, y1: 1, line: { color: css("--left"), width: 1.5, dash: "dot" } }];
  Plotly.react(div, [{ type: "scatter", mode: "lines", x, y, line: { color: css("--ink"), width: 1.8 } }], layout, STILL);
}

// All θ tried, one dot an experiment, knob against experiment.
export function tried(div, knob, k, experiments) {
  const layout = base(div.clientWidth, 170);
  const group = (test, marker, name) => {
    const kept = experiments.filter(test);
    return { type: "scatter", mode: "markers", name, x: kept.map((e) => e.number), y: kept.map((e) => e.theta[k]), marker };
  };
  const title = knob.unit && knob.unit !== "-" ? `${knob.name} [${knob.unit}]` : knob.name;
  layout.xaxis = { ...axis(), title: { text: "experiment" }, rangemode: "tozero" };
  layout.yaxis = { ...axis(), title: { text: title, font: { size: 11, color: css("--muted") } }, type: knob.scale === "log10" ? "log" : "linear", nticks: 4 };
  Plotly.react(div, [
    group((e) => !e.was_best, { color: css("--muted"), size: 6, opacity: 0.7 }, "tried"),
    group((e) => e.was_best && !e.best, { color: css("--left"), size: 7, symbol: "circle-open" }, "was the best"),
    group((e) => e.best, { color: css("--left"), size: 11, symbol: "star" }, "best"),
    group((e) => e.marks.includes("unsafe"), { color: css("--bad"), size: 9, symbol: "x-thin-open" }, "unsafe"),
  ], layout, STILL);
}
