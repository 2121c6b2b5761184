"""Own code that does what own code can do: the seed chooses. Loaded as own.py:NAME."""

import atexit
import ctypes
import multiprocessing
import os
import sys
import threading
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from prefcal_scenarios.catalog import load

TOY = load(str(Path(__file__).parents[1] / "scenarios" / "toy_scenario.py") + ":toy")
FLAG = Path(os.environ.get("PREFCAL_TEST_FLAG", os.devnull))
LOCK = threading.Lock()  # nothing of this file could be pickled
GAIN = 40.0
"""Above it `hanging` never returns."""


def spin():
    while True:
        pass


def spin_compiled():
    """As an endless compiled loop: the interpreter's lock is never given back."""
    libc = ctypes.PyDLL(None)
    while libc.usleep(1_000_000) <= 0:
        ctypes.pythonapi.PyErr_Clear()


def spin_forking():
    """With a child that holds every pipe open."""
    multiprocessing.get_context("fork").Process(target=spin, daemon=True).start()
    os._exit(3)


def spin_tidily():
    FLAG.write_text("running")
    try:
        spin()
    finally:
        FLAG.write_text("at rest")


def answer_twice():
    """A fork that is forgotten: it returns from the run, too."""
    os.fork()


def write_everywhere():
    """Into every file that is open, as code that closes and reuses descriptors may do."""
    for descriptor in range(3, 100):
        with suppress(OSError):
            os.write(descriptor, b"the level is 3 m, and the valve is open")


def interrupt(error=KeyboardInterrupt):
    raise error


WILD = {
    1: spin, 2: spin_compiled, 3: lambda: os._exit(3), 4: lambda: ctypes.string_at(0),
    5: spin_forking, 6: spin_tidily, 7: lambda: sys.exit("bye"), 8: lambda: 1 / 0,
    9: lambda: np.ones(1 << 50), 10: lambda: os.abort(),
    12: answer_twice, 13: write_everywhere, 14: interrupt, 15: lambda: interrupt(GeneratorExit),
}  # fmt: skip


def run(theta, seed=0):
    with LOCK:
        print("own code is talking")
        if seed in WILD:
            WILD[seed]()
        if seed == 11:
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


atexit.register(lambda: FLAG.write_text("left") if Path(os.devnull) != FLAG else None)
plant = replace(TOY, name="wild", run=run)
hangs = replace(TOY, name="hangs", run=hanging)
takes_space = replace(TOY, name="takes space", run=widened)
