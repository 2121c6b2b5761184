"""Run a user's own scenario in any worker process: each loads the user's file itself."""

import faulthandler
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.experiments.experiment import Experiment, returned
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.sources.source import Source
from prefcal_env.study import space_of
from prefcal_env.study.codec import encode
from prefcal_env.study.spaces import knobs_as_dicts, within_as_dict
from prefcal_scenarios.catalog import load
from prefcal_scenarios.scenario import Scenario, with_ranges

_BEYOND = 30.0
"""Seconds after the time limit when the process ends itself, in case prefcal is gone."""
_LONGEST = 1e6
"""Longest time limit in seconds that the process can watch itself."""

Ranges = dict[str, Any] | None
"""Ranges of a study as plain data; None for those of the scenario."""


class OwnSource(Source):
    """The source of a user's own scenario; when it is unpickled, the user's file is loaded.

    Args:
        path: Source of the scenario, path/to/own.py:NAME.
        ranges: Ranges of the study; None for those of the scenario.
    """

    def __init__(self, path: str, ranges: Ranges) -> None:
        self._path, self._ranges = path, ranges

    def run(self, theta: Float[np.ndarray, " n"], seed: int = 0) -> Experiment:
        """Run θ, physical, shape (n,), in this process."""
        return _loaded(self._path, self._ranges).run(theta, seed=seed)

    @property
    def here(self) -> Source:
        """Return the user's source, loaded in this process."""
        return _loaded(self._path, self._ranges)

    def __reduce__(self) -> tuple[Any, ...]:
        return _loaded, (self._path, self._ranges)


def ranges_of(space: KnobSpace | None) -> Ranges:
    """Return the ranges of a study as plain data; None for those of the scenario."""
    if space is None:
        return None
    return {"knobs": knobs_as_dicts(space), "within": within_as_dict(space)}


def work_of(source: str, limit: float) -> Callable[[tuple[Any, int, Ranges]], bytes]:
    """Return, in a worker, what runs θ with a seed in ranges: the bytes of its experiment.

    Args:
        source: Source of the scenario, path/to/own.py:NAME.
        limit: Maximum number of seconds of a run.
    """
    name = source.partition("{")[0].strip()
    sys.argv = [name.rpartition(":")[0] or name]
    scenario = load(source)

    def run(request: tuple[Any, int, Ranges]) -> bytes:
        theta, seed, ranges = request
        if limit < _LONGEST:
            faulthandler.dump_traceback_later(limit + _BEYOND, exit=True)
        try:
            return encode(returned(_source_of(scenario, ranges).run(theta, seed=seed)))
        finally:
            faulthandler.cancel_dump_traceback_later()

    return run


def _loaded(path: str, ranges: Ranges) -> Source:
    """Return the source of the scenario, with the ranges of the study."""
    return _source_of(load(path), ranges)


def _source_of(scenario: Scenario, ranges: Ranges) -> Source:
    if ranges is None:
        return scenario.source
    by_now = space_of(ranges)
    within = dict(zip(by_now.names, by_now.within, strict=True))
    constraints = scenario.space.constraints
    return with_ranges(scenario, KnobSpace(by_now.knobs, constraints, within=within)).source
