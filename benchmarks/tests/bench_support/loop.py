"""Closed loops of a user's own that take microseconds. Loaded as own.py:NAME by the benchmark."""

from typing import Any

import numpy as np

from prefcal_bench.problems import Outcome, Problem, judges
from prefcal_env.calibrators import LatentCost
from prefcal_env.experiments.experiment import End, Experiment
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_scenarios.scenario import KPI, Scenario
from support.short_runs import short_run

SPACE = KnobSpace([Knob("gain", 0.0, 1.0), Knob("lead", 0.0, 1.0), Knob("filter", 0.0, 1.0)])
KPIS = (
    KPI("error", "tracking error", "m", better="lower"),
    KPI("effort", "effort", "%", better="lower"),
    KPI("margin", "margin", "dB", better="higher"),
    KPI("score", "score"),
)


def run(theta: Any, seed: int = 0) -> Experiment:
    """Fast loops cost effort; beyond a gain of 0.9 they are unstable, the later the less gain."""
    gain, lead, time = (float(v) for v in theta)
    stopped = gain > 0.9
    error = 0.1 + (gain - 0.7) ** 2 + 0.3 * (lead - 0.4) ** 2 + 0.2 * time
    kpis = {
        "error": np.inf if stopped else error,
        "effort": 1.0 + 3.0 * gain + lead**2 + (0.3 - time) ** 2,
        "margin": 12.0 - 8.0 * gain - 4.0 * abs(time - 0.5) + 2.0 * lead,
        "score": gain,
    }
    duration = 10.0 * (1.0 - gain) + 0.1 if stopped else 10.0
    end = End.UNSAFE if stopped else End.TIME_UP
    return short_run(theta, value=error, duration=duration, end=end, kpis=kpis)


SCENARIO = Scenario("tiny", "Tiny loop", SPACE, run, kpis=KPIS)
AIMLESS = Scenario("aimless", "No KPI has a direction", SPACE, run, kpis=KPIS[3:])


def _cost(outcome: Outcome) -> float:
    assert outcome.cost is not None
    return outcome.cost


def _outcome(theta: Any) -> Outcome:
    return Outcome(theta, float(np.sum((theta - 0.3) ** 2)))


_REFEREE = LatentCost(_cost)
PROBLEM = Problem("bowl", SPACE, _outcome, judges(_REFEREE, "perfect"), _REFEREE, best_known=0.0, version=7)
NUMBER = 3
