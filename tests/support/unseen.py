"""A scenario of quick simulations, some of which fail, for agents that simulate unseen."""

import os
import time
from typing import Any

import numpy as np

from prefcal_env.experiments.experiment import Channel, Channels, End, Experiment
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_scenarios.scenario import KPI, Scenario

LEVEL = Channel("level", "m")
CHANNELS = Channels(x=(LEVEL,), u=(Channel("valve", "%"),), y=(LEVEL,))
SPACE = KnobSpace([Knob("gain", 0.0, 1.0), Knob("delay", 0.0, 1.0, "s")])


def run(theta: Any, seed: int = 0) -> Experiment:
    """Return a response that is quick with a high gain and calm with a low one.

    A gain above 0.95 raises an error, and one below 0.05 ends the process if it is a worker. Each
    run takes PREFCAL_TEST_SECONDS until the file PREFCAL_TEST_HURRY exists.
    """
    gain, delay = theta
    if gain > 0.95:
        raise OSError("no solution")
    if gain < 0.05 and os.environ.get("PREFCAL_TEST_CRASH") and _in_worker():
        os._exit(3)
    if not os.path.exists(os.environ.get("PREFCAL_TEST_HURRY", "")):
        time.sleep(float(os.environ.get("PREFCAL_TEST_SECONDS", "0")))
    t = np.linspace(0.0, 1.0, 20)
    x = 1 - np.exp(-(1 + 5 * gain) * t)[:, None]
    return Experiment(
        theta=np.array(theta),
        t=t,
        x=x,
        u=x,
        t_control=t,
        u_control=x,
        y_ref=np.ones((20, 1)),
        iterations=np.ones(20, dtype=int),
        solve_time=np.zeros(20),
        solved=np.ones(20, dtype=bool),
        channels=CHANNELS,
        end=End.UNSAFE if delay > 0.9 else End.TIME_UP,
        kpis={"slow": 1.0 - gain + delay, "rough": gain**2, "mood": 7.0},
    )


def _in_worker() -> bool:
    import __main__

    return not hasattr(__main__, "__file__")


def cost(experiment: Experiment) -> float:
    """Prefer gains around a third, without delay."""
    return float(experiment.kpis["slow"] + 1.5 * experiment.kpis["rough"])


unseen = Scenario(
    "unseen",
    "Unseen",
    SPACE,
    run,
    cost=cost,
    simulated=True,
    kpis=(
        KPI("slow", "slowness", better="lower"),
        KPI("rough", "roughness", better="lower"),
        KPI("mood", "mood"),
    ),
)
"""KPI "mood" has no direction, so nothing is learned from it."""
