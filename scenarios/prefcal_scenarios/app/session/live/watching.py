"""Watch a run on a live plant: work out, while it records, whether it can still win."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from jaxtyping import Float

from prefcal_env.live import LiveRig
from prefcal_scenarios.cutting import CHECKS, Chances

from .state import Live

_FEWEST = 2
"""Smallest number of samples that have KPIs."""


@contextmanager
def watched(
    live: Live, rig: LiveRig, theta: Float[np.ndarray, " n"], chances: Chances | None, *, cuts: bool
) -> Iterator[None]:
    """Set `live.hopeless` once the run in progress can no longer win.

    This takes a thread of its own, so that samples and abort limits never wait for it.

    Args:
        live: State of the live plant.
        rig: Rig that runs.
        theta: θ of the run, physical, shape (n,).
        chances: What decides whether a run can win; None if nothing does.
        cuts: Whether to cut the run short then.
    """
    if chances is None:
        yield
        return
    over = threading.Event()

    def watch() -> None:
        while not over.wait(max(rig.period, rig.duration / CHECKS)):
            samples = live.recorded()
            if len(samples) < _FEWEST or not chances.is_hopeless(rig.so_far(theta, samples)):
                continue
            live.hopeless.set()
            if cuts:
                live.cut.set()
            live.changed()
            return

    thread = threading.Thread(target=watch, name="prefcal-watch", daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
