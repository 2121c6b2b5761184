"""A scenario whose runs do what θ says, each in a tenth of a millisecond unless it is told to wait.

Other processes import it by name.
"""

import ctypes
import os
import signal
import time
from typing import Any

import numpy as np

from prefcal_env.experiments.experiment import Channel, Channels, End, Experiment
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_scenarios.scenario import KPI, Scenario

LEVEL = Channel("level", "m")
CHANNELS = Channels(x=(LEVEL,), u=(Channel("valve", "%"),), y=(LEVEL,))
SPACE = KnobSpace([Knob("what", 0, 100, integer=True), Knob("gain", 0.0, 1.0)])
RUNS, RAISES, DIES, HANGS, LEAVES, NOTHING, WAITS = range(7)


def run(theta: Any, seed: int = 0) -> Experiment:
    """Do what the first knob says; the second one is the level."""
    what, gain = theta
    if what == RAISES:
        raise OSError("the pump does not answer")
    if what == DIES:
        os.kill(os.getpid(), signal.SIGKILL)
    if what == HANGS:
        ctypes.PyDLL(None).sleep(600)  # and nothing else in this process can run
    if what == LEAVES:
        raise SystemExit("bye")
    if what == NOTHING:
        return None  # type: ignore[return-value]
    if what == WAITS:
        time.sleep(0.3)
    theta[0] = 0.0  # nobody else may notice
    return _experiment(np.array([what, gain]), seed)


def _experiment(theta: Any, seed: int) -> Experiment:
    t = np.linspace(0.0, 1.0, 200)
    solved = np.arange(100) < 100 * theta[1]
    x = theta[1] * np.random.default_rng(seed).standard_normal(200)[:, None]
    return Experiment(
        theta=theta,
        t=t,
        x=x,
        u=x,
        t_control=t[::2],
        u_control=x[::2],
        y_ref=x[::2],
        iterations=np.full(100, 3),
        solve_time=np.zeros(100),
        solved=solved,
        channels=CHANNELS,
        end=End.UNSAFE if theta[1] > 0.5 else End.TIME_UP,
        kpis={"mean": x.mean(), "count": 3, "never": np.inf},
    )


many = Scenario("many", "Many", SPACE, run, kpis=(KPI("mean", "mean level", "m"),))
