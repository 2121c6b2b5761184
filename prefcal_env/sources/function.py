"""A function of θ as a source."""

from collections.abc import Callable
from functools import partial
from inspect import signature
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.experiments.experiment import Channels, Experiment
from prefcal_env.knobs.space import KnobSpace

from .source import Source, WithKPIs


class Function(Source):
    """A function of θ, or a callable object, which may declare what a `Source` does.

    Args:
        function: Function `run(theta, seed=0)` that returns an experiment.
    """

    def __init__(self, function: Callable[..., Experiment]) -> None:
        self.function = function
        channels = getattr(function, "channels", None)
        self.channels = channels if isinstance(channels, Channels) else None
        self.signals = getattr(function, "signals", None)
        self.computes_kpis = getattr(function, "kpis", ...) is not None
        self.controller = getattr(function, "controller", None)

    def run(self, theta: Float[np.ndarray, " n"], seed: int = 0) -> Experiment:
        """Run θ, physical, shape (n,)."""
        return self.function(theta, seed=seed)

    def within(self, space: KnobSpace) -> Source:
        """Return the same function for the ranges of `space`, if it takes an argument `space`."""
        return Function(with_space(self.function, space))


def with_space(function: Any, space: KnobSpace) -> Any:
    """Return a function for the knobs of `space`, if it takes them as an argument `space`."""
    takes = callable(function) and "space" in signature(function).parameters
    return partial(function, space=space) if takes else function


def source_of(run: Any) -> Source:
    """Return a source as it is, and a function of θ as a source."""
    return run if isinstance(run, Source) else Function(run)


def function_of(run: Any) -> Any:
    """Return the function of θ behind a run or its source; None if there is none."""
    if isinstance(run, WithKPIs):
        return function_of(run.source)
    if isinstance(run, Function):
        return run.function
    return None if isinstance(run, Source) else run
