"""What every source must satisfy; each is one parameter of the tests here.

A subject is a source and a θ that it can run.
"""

import numpy as np
import pytest

from prefcal_env.errors import ScenarioError
from prefcal_env.experiments.experiment import Channels, Experiment
from prefcal_env.experiments.kpis import Tracking
from prefcal_env.sources import Run, Source, Table


def begins_without_doing_anything(source: Source, theta: np.ndarray) -> None:
    run = source.begin(theta)
    assert isinstance(run, Run)
    assert not run.moves_plant
    assert not run.stopping
    assert run.partial is None


def asks_what_it_says(source: Source, theta: np.ndarray) -> None:
    run = source.begin(theta)
    made = None if run.waits else run.advance()
    assert run.waits == (made is None) == bool(source.asks)
    assert bool(run.changes) == (source.asks == "confirm")
    assert bool(source.columns) == (source.asks == "record")


def runs_what_it_was_given(source: Source, theta: np.ndarray) -> None:
    made = attended(source, theta)
    assert isinstance(made, Experiment)
    assert np.array_equal(made.theta, theta)
    if source.channels is not None:
        assert made.channels.u == source.channels.u


def repeats_itself(source: Source, theta: np.ndarray) -> None:
    first, second = attended(source, theta), attended(source, theta)
    if source.asks == "confirm":  # a plant has moved since
        assert first.kpis.keys() == second.kpis.keys()
        return
    assert first.kpis == second.kpis
    assert np.array_equal(first.t, second.t)


def runs_alone_unless_it_asks(source: Source, theta: np.ndarray) -> None:
    if source.asks:
        with pytest.raises(ScenarioError, match="person"):
            source.run(theta)
        with pytest.raises(ScenarioError, match="person"):
            source(theta)
    else:
        assert source(theta).kpis == source.run(theta).kpis


def declares_its_channels_or_none(source: Source, theta: np.ndarray) -> None:
    assert source.channels is None or isinstance(source.channels, Channels)
    assert source.signals is None or isinstance(source.signals, tuple)


def can_be_told_to_stop_at_any_time(source: Source, theta: np.ndarray) -> None:
    run = source.begin(theta)
    run.stop("given up")
    run = source.begin(theta)
    run.stop("stopped")
    assert run.partial is None


def gives_tracking_kpis_once(source: Source, theta: np.ndarray) -> None:
    tracked = source.measured(lambda channels: Tracking(("a", "b")))
    assert tracked.asks == source.asks
    assert tracked.measured(lambda channels: Tracking(("c",))).asks == source.asks
    if tracked is not source:  # others compute theirs themselves
        assert {"a", "b"} <= attended(tracked, theta).kpis.keys()


CONTRACT = (
    begins_without_doing_anything,
    asks_what_it_says,
    runs_what_it_was_given,
    repeats_itself,
    runs_alone_unless_it_asks,
    declares_its_channels_or_none,
    can_be_told_to_stop_at_any_time,
    gives_tracking_kpis_once,
)
source_contract = pytest.mark.parametrize("clause", CONTRACT, ids=lambda c: c.__name__)


def attended(source: Source, theta: np.ndarray) -> Experiment:
    """The experiment of θ, for which a person confirms everything or hands in a made-up record."""

    def supply(run: Run):
        if source.asks == "confirm":
            assert run.changes is not None, run.problem
            return run.changes
        rows = "\n".join(f"{t},{','.join(['1'] * (len(source.columns) - 1))}" for t in range(3))
        return Table(f"{','.join(source.columns)}\n{rows}\n".encode())

    return source.attend(theta, supply)
