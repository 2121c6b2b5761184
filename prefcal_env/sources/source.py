"""Whatever turns θ into an experiment, behind the same calls."""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from functools import partial
from math import inf
from types import MappingProxyType
from typing import Any, Literal, cast

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import ScenarioError
from prefcal_env.experiments.experiment import Channels, Experiment, KPIs
from prefcal_env.experiments.formula import formula_of
from prefcal_env.knobs.space import KnobSpace

from .run import Given, Run, Whole

Asks = Literal["", "record", "confirm"]
"""What a run asks of a person: nothing, the record of a run that they did, or a confirmation."""
KPIsOf = Callable[[Channels | None], KPIs]
"""Function of channels, None if they are not known yet, that returns a function of experiments: all
KPIs of one that has its own."""


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
        stops: Whether a run can be stopped.
        limit: Time limit of a run in seconds; None if it has none that is known.
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
    stops: bool = False
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
            raise ScenarioError(_ONLY_A_PERSON.get(self.asks, "this run waits: say for what with asks"))

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

    def measured(self, kpis_of: KPIsOf) -> "Source":
        """Return the same source, whose experiments have more KPIs than their own."""
        return WithKPIs(self, kpis_of(self.channels))

    @property
    def elsewhere(self) -> "Source":
        """Return the same source for the workers of a pool, which pickles it."""
        return self

    @property
    def here(self) -> "Source":
        """Return the same source, loaded in this process."""
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
        if self.channels is not None and self.signals is not None:
            yield from formula_problems(kpis, self.channels, self.signals)

    def close(self) -> None:
        """Release what the source holds, such as a connection."""


_DECLARED = (
    "asks",
    "channels",
    "signals",
    "controller",
    "stops",
    "limit",
    "recovers",
    "columns",
    "instructions",
    "duration",
    "afterward",
)
"""What a source says of itself, and is the same with more KPIs."""


class WithKPIs(Source):
    """A source whose experiments have more KPIs than their own.

    Args:
        source: Source that does the runs.
        kpis: Function that returns all KPIs of an experiment that has its own.
    """

    def __init__(self, source: Source, kpis: KPIs) -> None:
        self.source, self.kpis = source, kpis
        for name in _DECLARED:
            setattr(self, name, getattr(source, name))

    def begin(self, theta: Float[np.ndarray, " n"], seed: int = 0) -> Run:
        """Return the source's run of θ, physical, shape (n,), which adds the KPIs at its end."""
        run = self.source.begin(theta, seed=seed)
        advance = run.advance
        run.advance = lambda: self._with_kpis(advance())  # type: ignore[method-assign]
        return run

    def run(self, theta: Float[np.ndarray, " n"], seed: int = 0) -> Experiment:
        """Run θ, physical, shape (n,); what is no experiment is returned as it is."""
        return cast(Experiment, self._with_kpis(self.source.run(theta, seed=seed)))

    def _with_kpis(self, made: Experiment | None) -> Experiment | None:
        return made.with_kpis(self.kpis) if isinstance(made, Experiment) else made

    @property
    def left(self) -> Mapping[str, float] | None:
        """Old values that an interrupted run of the source left."""
        return self.source.left

    def recovery(self) -> Run:
        """Return the source's run that restores them."""
        return self.source.recovery()

    def close(self) -> None:
        """Release what the source holds."""
        self.source.close()

    def within(self, space: KnobSpace) -> Source:
        """Return the same for the ranges of `space`, if the source takes them."""
        return WithKPIs(self.source.within(space), self.kpis)

    def measured(self, kpis_of: KPIsOf) -> Source:
        """Return the same source with more KPIs; those of the same type take the place of these."""
        kpis = kpis_of(self.channels)
        return WithKPIs(self.source if type(kpis) is type(self.kpis) else self, kpis)


def with_own(own: KPIs | None, kpis: KPIs) -> KPIs:
    """Return a function that first computes an experiment's `own` KPIs, and then all `kpis`."""
    return kpis if own is None else lambda made: kpis(made.with_kpis(own))


def formula_problems(kpis: Iterable[Any], channels: Channels, signals: Collection[str]) -> Iterator[str]:
    """Yield which formulas of KPIs name what channels and keys of signals lack."""
    for kpi in kpis:
        for find in formula_of(kpi.formula).names if kpi.formula else ():
            try:
                find(channels, signals)
            except ScenarioError as error:
                yield f"formula of KPI {kpi.name!r}: {error}"
