"""Own code that does what own code can do: the seed chooses. Loaded as own.py:NAME."""

import os
import sys
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np

from prefcal_scenarios.catalog import load

TOY = load(str(Path(__file__).parents[1] / "scenarios" / "toy_scenario.py") + ":toy")
LOCK = threading.Lock()  # nothing of this file could be pickled
GAIN = 40.0
"""Above it `hanging` never returns."""


def spin():
    while True:
        pass


WILD = {
    1: spin,
    2: lambda: os._exit(3),
    3: lambda: sys.exit("bye"),
    4: lambda: 1 / 0,
    5: lambda: np.ones(1 << 50),
}


def run(theta, seed=0):
    with LOCK:
        if seed in WILD:
            WILD[seed]()
        if seed == 6:
            return None
        return TOY.run(theta, seed)


def hanging(theta, seed=0):
    """Endless where the gain is high."""
    if theta[2] > GAIN:
        spin()
    return TOY.run(theta, seed)


def widened(theta, seed=0, space=None):
    """Says what it may run."""
    made = TOY.run(theta, seed)
    kpis = {**made.kpis, "largest": 0.0 if space is None else float(space.knobs[0].high)}
    return replace(made, kpis=kpis)


plant = replace(TOY, name="wild", run=run)
hangs = replace(TOY, name="hangs", run=hanging)
takes_space = replace(TOY, name="takes space", run=widened)
