"""Whatever turns θ into an experiment, behind the same calls."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from math import inf
from types import MappingProxyType
from typing import Any, Literal, cast

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import ScenarioError
from prefcal_env.experiments.experiment import Channels, Experiment
from prefcal_env.experiments.kpis import tracking_kpis
from prefcal_env.knobs.space import KnobSpace

from .run import Given, Run, Whole

Asks = Literal["", "record", "confirm"]
"""What a run asks of a person: nothing, the record of a run that they did, or a confirmation."""
NamesOf = Callable[[Channels | None], Sequence[str]]
"""Function that returns the tracking KPIs that channels promise; None if they are not known yet."""


_ONLY_A_PERSON: Mapping[Asks, str] = {
    "record": "this plant is a rig that only a person can run: calibrate it with the calibrator human",
    "confirm": "this is a live plant, where a person confirms each run: calibrate it with the "
    "calibrator human",
}


class Source:
    """Whatever turns θ into an experiment.

    A source of your own defines `begin`, or `run` if nothing is asked of a person, and says what is
    known beforehand.

    Attributes:
        asks: What each run asks of a person.
        channels: Channels of the experiments; None if they are not known before the first.
        signals: Keys of the experiments' signals; None if they are not known.
        computes_kpis: Whether the experiments have KPIs.
        controller: Function that builds the controller of a θ; None if there is none.
        maneuvers: Sources of the maneuvers by name; empty for a single run.
        limit: Time limit of a run in seconds; None if a run cannot be stopped.
        recovers: Whether an interrupted run may have left a plant changed; see `recovery`.
        columns: Headings of the record that a person supplies.
        instructions: What a person is told before they run or confirm an experiment.
        duration: Longest recorded time in seconds, if the run is followed live.
        afterward: What becomes of the values that a run wrote, as a part of a sentence.
    """

    asks: Asks = ""
    channels: Channels | None = None
    signals: tuple[str, ...] | None = None
    computes_kpis: bool = True
    controller: Callable[..., Any] | None = None
    maneuvers: "Mapping[str, Source]" = MappingProxyType({})
    limit: float | None = None
    recovers: bool = False
    columns: tuple[str, ...] = ()
    instructions: str = ""
    duration: float = inf
    afterward: str = "the new values stay"

    def begin(self, theta: Float[np.ndarray, " n"], seed: int = 0) -> Run:
        """Return a run of θ, physical, shape (n,), which nobody has advanced yet."""
        return Whole(partial(self.run, theta, seed=seed))

    def run(self, theta: Float[np.ndarray, " n"], seed: int = 0) -> Experiment:
        """Run θ, physical, shape (n,), from its start to its end.

        Raises:
            ScenarioError: If the run asks something of a person; `attend` lets them answer.
        """

        def refuse(run: Run) -> Given:
            raise ScenarioError(_ONLY_A_PERSON[self.asks])

        return self.attend(theta, refuse, seed=seed)

    def attend(
        self, theta: Float[np.ndarray, " n"], supply: Callable[[Run], Given], seed: int = 0
    ) -> Experiment:
        """Run θ, physical, shape (n,), and let a person supply what it asks for.

        Args:
            theta: Physical θ, shape (n,).
            supply: Function of the waiting run that returns its record, or the run's `changes` once
                they are confirmed; see `Run.supply`.
            seed: Seed of all randomness.
        """
        run = self.begin(theta, seed=seed)
        made = None if run.waits else run.advance()
        while made is None and run.waits:
            run.supply(supply(run))
            made = run.advance()
        return cast(Experiment, made)

    def __call__(self, theta: Float[np.ndarray, " n"], seed: int = 0) -> Experiment:
        """Run θ, physical, shape (n,); the same as `run`."""
        return self.run(theta, seed=seed)

    def within(self, space: KnobSpace) -> "Source":
        """Return the same source for the ranges of `space`, if they matter to it."""
        return self

    def tracked(self, names: NamesOf) -> "Source":
        """Return the same source, whose experiments get tracking KPIs in addition to their own.

        One that asks something of a person computes its KPIs itself.

        Args:
            names: Function of the channels that returns the KPIs that every complete experiment
                has, NaN if one could not be measured.
        """
        return self if self.asks else Tracked(self, tuple(names(self.channels)))

    @property
    def elsewhere(self) -> "Source":
        """Return the same source for the workers of a pool, which pickles it."""
        return self

    @property
    def hangs(self) -> bool:
        """Return whether the last run had to be ended, so that the next one may hang, too."""
        return False

    @property
    def left(self) -> Mapping[str, float] | None:
        """Old values, by name, that an interrupted run left to be restored; None if none are."""
        return None

    def recovery(self) -> Run:
        """Return the run that restores what an interrupted one left; it returns no experiment."""
        raise NotImplementedError

    def example(self, theta: Float[np.ndarray, " n"]) -> Experiment | None:
        """Return a made-up experiment of θ, physical, shape (n,), if only people can do a real one."""
        return None

    def problems(self, kpis: Iterable[Any]) -> Iterator[str]:
        """Yield what keeps a scenario with these KPIs from using the source, as sentences."""
        return iter(())

    def close(self) -> None:
        """Release what the source holds, such as a connection."""


class Tracked(Source):
    """A source whose experiments get their tracking KPIs in addition to their own.

    Args:
        source: Source that asks nothing of a person.
        names: KPIs that every complete experiment has, NaN if it could not be measured.
    """

    def __init__(self, source: Source, names: Sequence[str] = ()) -> None:
        self.source, self.names = source, tuple(names)
        self.channels, self.signals = source.channels, source.signals
        self.controller = source.controller

    def run(self, theta: Float[np.ndarray, " n"], seed: int = 0) -> Experiment:
        """Run θ, physical, shape (n,); what is no experiment is returned as it is."""
        made = self.source.run(theta, seed=seed)
        return made.with_kpis(self.kpis(made)) if isinstance(made, Experiment) else made

    def kpis(self, experiment: Experiment) -> dict[str, float]:
        """Return the KPIs of an experiment by name, its own last."""
        known = {} if experiment.end.interrupted else dict.fromkeys(self.names, np.nan)
        return {**known, **tracking_kpis(experiment), **experiment.kpis}

    def within(self, space: KnobSpace) -> Source:
        """Return the same for the ranges of `space`, if the source takes them."""
        return Tracked(self.source.within(space), self.names)

    def tracked(self, names: NamesOf) -> Source:
        """Return this: its experiments have the KPIs already."""
        return self
