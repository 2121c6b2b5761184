"""Watch a run on a live plant: work out, while it records, whether it can still win."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from jaxtyping import Float

from prefcal_env.live import LiveRig
from prefcal_scenarios.cutting import CHECKS, Chances
from prefcal_scenarios.own.own_line import in_words

from .state import Live

_FEWEST = 2
"""Smallest number of samples that have KPIs."""


@contextmanager
def watched(
    live: Live, rig: LiveRig, theta: Float[np.ndarray, " n"], chances: Chances | None, *, cuts: bool
) -> Iterator[None]:
    """Set `live.hopeless` once the run in progress can no longer win.

    While that cannot be told, for example since the person's own KPIs fail, `live.unwatched` says
    why, and the run goes on.

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

    def is_hopeless() -> bool:
        samples = live.recorded()
        if len(samples) < _FEWEST:
            return False
        record = rig.so_far(theta, samples)
        return len(record.t) >= _FEWEST and chances.is_hopeless(record)

    def watch() -> None:
        while not over.wait(max(rig.period, rig.duration / CHECKS)):
            try:
                hopeless, unwatched = is_hopeless(), ""
            except (Exception, SystemExit) as error:
                hopeless, unwatched = False, in_words(error)
            if live.unwatched != unwatched:
                live.unwatched = unwatched
                live.changed()
            if not hopeless:
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
