"""A first-order lag with PI control: the scenario of a kept study, which never changes."""

import numpy as np

from prefcal_env import Experiment, Knob, KnobSpace, recorded
from prefcal_scenarios import KPI, Scenario


def run(theta: np.ndarray, *, seed: int = 0) -> Experiment:
    """Fill an empty tank to 1 m in 20 s, with a move every 0.5 s."""
    gain, T_i = theta
    t, level, valve, total = np.arange(41) * 0.5, np.zeros(41), np.zeros(41), 0.0
    for k in range(40):
        error = 1.0 - level[k]
        total += 0.5 * error / T_i
        valve[k] = np.clip(gain * (error + total), 0.0, 3.0)
        level[k + 1] = level[k] + 0.5 * (valve[k] - level[k]) / 4.0
    valve[-1] = valve[-2]
    return recorded(
        theta,
        t,
        {"level": level},
        {"valve": valve},
        {"level": 1.0},
        {"level": "m", "valve": "%"},
        kpis=lambda e: {
            "error": float(np.abs(1.0 - level).sum() * 0.5),
            "moves": float(np.abs(np.diff(valve)).sum()),
        },
    )


scenario = Scenario(
    name="first-order",
    title="First-order lag with PI control",
    run=run,
    space=KnobSpace([Knob("K_p", 0.1, 10, "%/m", scale="log10"), Knob("T_i", 0.5, 20, "s")]),
    kpis=(KPI("error", "integrated error", "m s"), KPI("moves", "total move", "%")),
    cost=lambda experiment: experiment.kpis["error"] + 0.2 * experiment.kpis["moves"],
)
