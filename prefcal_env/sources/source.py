"""Whatever turns θ into an experiment, one run of it, and the sources that are functions of θ."""

import threading
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import partial
from inspect import signature
from math import inf, nan
from types import MappingProxyType
from typing import Any, Literal, Protocol, cast

import numpy as np
from jaxtyping import Float

from prefcal_env.arrays import is_number
from prefcal_env.errors import ExperimentError, PrefcalError, ScenarioError, StaleError
from prefcal_env.experiments.experiment import Channel, Channels, Experiment, KPIs
from prefcal_env.experiments.kpis import conversion_of
from prefcal_env.experiments.panels import MEAN, check_channels, check_name, combined, named
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.plants.plant import Plant

from .varied import CHANGE, Factor, LeftOut, Unheld, Values


class Stage(Enum):
    """What a run on a plant is doing."""

    CONNECTING = "connecting"
    WRITING = "writing the new values"
    WAITING = "waiting for the start condition"
    RECORDING = "recording"
    RESTORING = "restoring the old values"
    LOST = "connection lost: waiting to restore the old values"


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a run is.

    Args:
        stage: What it is doing.
        elapsed: Recorded time so far, in seconds.
        duration: Longest time that is recorded, in seconds.
        values: Latest values by "role name", such as "output level"; NaN for bad quality.
        problem: What went wrong so far, as a sentence; empty if nothing did.
    """

    stage: Stage
    elapsed: float
    duration: float
    values: Mapping[str, float] = field(default_factory=dict)
    problem: str = ""


@dataclass(frozen=True, slots=True)
class Change:
    """A value that a run is to write to a plant, for a person to confirm.

    Args:
        quantity: What has the value, with the limits of what may be written: a knob, for example.
        new: Value to write, in the unit of `quantity`.
        old: Value on the plant now; NaN if it is not known.
        rate: Largest rate of change, in the unit of `quantity` per second.
    """

    quantity: Knob | Channel
    new: float
    old: float = nan
    rate: float = inf

    @property
    def name(self) -> str:
        """Name of the quantity."""
        return self.quantity.name

    @property
    def unit(self) -> str:
        """Unit of the values."""
        return self.quantity.unit

    @property
    def seconds(self) -> float:
        """Shortest duration of the change, in seconds."""
        return abs(self.new - self.old) / self.rate


@dataclass(frozen=True, slots=True)
class RunCurve:
    """An output that is recorded, as far as it is known.

    Args:
        channel: Channel of the output.
        values: Values at the recorded instants; NaN for bad quality.
        reference: Values of its reference; empty if it has none.
    """

    channel: Channel
    values: tuple[float, ...]
    reference: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class Table:
    """A record that a person supplies.

    Args:
        content: Content of a file.
        unsafe: Whether the run became unsafe and was stopped.
    """

    content: bytes
    unsafe: bool = False


Given = Table | tuple[Change, ...]  # what a person supplies: a record, or the changes that they confirm


class Run:
    """One experiment under way. One thread advances it; any may look at it, supply it or stop it.

    Attributes:
        waits: Whether a person must supply something before the run can be advanced.
        moves_plant: Whether a plant is being changed, so that nothing else may be done meanwhile.
        stopping: Whether the run was told to stop.
        progress: How far the run is; None if that is not known.
        changed: Function that tells front ends, from the thread of the run. Call it after each change of
            these fields: front ends see nothing of it before.
        changes: What would be written to a plant, for a person to confirm; None if that is not
            known or nothing is.
        problem: Why the run waits, or what remains to be done after it, as a sentence.
        partial: What was recorded before the run failed; None if nothing was.
    """

    waits: bool = False
    moves_plant: bool = False
    stopping: bool = False
    progress: Progress | None = None
    changed: Callable[[], None] = staticmethod(lambda: None)
    changes: tuple[Change, ...] | None = None
    problem: str = ""
    partial: Experiment | None = None

    @property
    def recorded(self) -> tuple[tuple[float, ...], tuple[RunCurve, ...]]:
        """Return instants in seconds, and the curves recorded so far."""
        return (), ()

    def advance(self) -> Experiment | None:
        """Do the next part of the run, however long it takes; return its experiment at the end.

        Raises:
            Exception: If there is no experiment: whatever the user's code raised, or a RunError.
        """
        raise NotImplementedError

    def supply(self, given: Given) -> None:
        """Supply what the run asks for: a record, or the changes that a person confirms."""
        raise ScenarioError("this run asks for nothing")

    def stop(self, why: str, within: float = 0.0) -> None:
        """Stop the run in `within` seconds, if it can be: "stopped" by a person, or "given up"."""


class PlantTrial:
    """Which of several θ a person wants on a plant, and which it has, until one is confirmed.

    The run of a trial moves the plant in one thread, and the person presses keys in another: what both
    decide is decided here, by one after the other.

    Args:
        sides: θ by number, physical, shape (n,); the first one is wanted first.
        mark: What tells this trial apart from every other one, also after a crash.
        confirmed: Function that returns whether the record says that one of them was confirmed.
    """

    def __init__(
        self, sides: Mapping[int, Float[np.ndarray, " n"]], mark: str, confirmed: Callable[[], bool]
    ) -> None:
        self.sides, self.mark, self.confirmed = sides, mark, confirmed
        self.wanted: int = next(iter(sides))
        self.shown: int | None = None  # number of the θ that the plant shows
        self._ended, self._lock = False, threading.Lock()

    def want(self, number: int) -> None:
        """Want this θ on the plant. Raises StaleError if the trial is over."""
        with self._lock:
            if self._ended or self.confirmed():
                raise StaleError("the trial has ended: nothing was written")
            self.shown = self.shown if number == self.wanted else None
            self.wanted = number

    def turn(self) -> int | None:
        """Return the number of the θ that must be written; None if the plant shows what is wanted."""
        with self._lock:
            return None if self.shown is not None or self.confirmed() else self.wanted

    def has(self, number: int) -> None:
        """Take note that the plant shows this θ, unless another one is wanted by now."""
        with self._lock:
            self.shown = number if number == self.wanted else None

    @contextmanager
    def confirming(self, number: int) -> Iterator[None]:
        """Let the plant be as it is inside the block, which records that this θ stays.

        Raises:
            StaleError: If the plant does not have it now, or one was confirmed; nothing may be recorded then.
        """
        with self._lock:
            if self.confirmed():  # the values from before are forgotten by the mark of one confirmation
                raise StaleError("one of them was confirmed already: nothing more was recorded")
            if self.shown != number:
                raise StaleError("the plant does not have these values now: nothing was confirmed")
            yield

    def leave(self) -> bool:
        """End the trial; return whether nothing was confirmed, so that the plant gets back what it had."""
        with self._lock:
            self._ended, self.shown = True, None
            return not self.confirmed()


class Whole(Run):
    """A run that a single call does from its start to its end."""

    def __init__(self, run: Callable[[], Experiment]) -> None:
        self._run = run

    def advance(self) -> Experiment:
        """Return the experiment. Raises whatever the call raises."""
        return self._run()


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


class KnownLoop(Protocol):
    """A closed loop that is known as equations, so that it has margins."""

    @property
    def plant(self) -> Plant:
        """Plant of the study."""

    @property
    def task(self) -> Any:
        """`Task` of the study."""

    @property
    def controller(self) -> Callable[[Float[np.ndarray, " n"]], Any]:
        """Function of a physical θ, shape (n,), that makes the controller."""


@dataclass(frozen=True, slots=True)
class Varied:
    """What can be varied of a source, and the source with other values."""

    factors: tuple[Factor, ...]  # what can be varied, by how much, and where the range comes from
    left_out: tuple[LeftOut, ...]  # what cannot be, and why
    at: "Callable[[Values], Source]"  # function of values; the controller stays as it is designed
    loop: KnownLoop | None = None  # the loop without variation; None if it is not known as equations
    # Function of values that returns where no input can hold the plant with them; None if that is not known
    unheld: "Callable[[Values], Unheld | None] | None" = None


RIG = "it runs on a rig or a live plant, which cannot be varied: verify a model of it"


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
        function: Function of θ that does the runs, here or elsewhere; None if there is none.
        maneuvers: Sources of the maneuvers by name; empty for a single run.
        stops: Whether a run can be stopped.
        limit: Time limit of a run in seconds; None if it has none that is known.
        recovers: Whether an interrupted run may have left a plant changed; see `recovery`.
        tries: Whether several θ can be tried in turn, by `trial`.
        columns: Headings of the record that a person supplies.
        instructions: What a person is told before they run or confirm an experiment.
        duration: Longest recorded time in seconds, if the run is followed live.
        afterward: What becomes of the values that a run wrote, as a part of a sentence.
        candidates: The only θ that there are, physical, shape (m, n), such as rows of a table, whose
            order means nothing; None if any θ can run.
    """

    asks: Asks = ""
    channels: Channels | None = None
    signals: tuple[str, ...] | None = None
    computes_kpis: bool = True
    controller: Callable[..., Any] | None = None
    function: Callable[..., Any] | None = None
    maneuvers: "Mapping[str, Source]" = MappingProxyType({})
    stops: bool = False
    limit: float | None = None
    recovers: bool = False
    tries: bool = False
    columns: tuple[str, ...] = ()
    instructions: str = ""
    duration: float = inf
    afterward: str = "the new values stay"
    candidates: Float[np.ndarray, "m n"] | None = None

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

    def trial(self, trial: PlantTrial) -> Run:
        """Return the run of a trial: it reads the plant, asks a person, and has what they want on it."""
        raise NotImplementedError

    def settle(self, mark: str) -> None:
        """Forget the values from before a trial, if its mark is this: what it left was confirmed."""

    def example(self, theta: Float[np.ndarray, " n"]) -> Experiment | None:
        """Return a made-up experiment of θ, physical, shape (n,), if only people can do a real one."""
        return None

    def problems(self, kpis: Iterable[Any]) -> Iterator[str]:
        """Yield what keeps a scenario with these KPIs from using the source, as sentences."""
        if self.channels is not None and self.signals is not None:
            yield from formula_problems(kpis, self.channels, self.signals)

    def varied(self) -> Varied:
        """Return what can be varied of the source, by how much, and what cannot be, and why.

        Raises:
            ScenarioError: If nothing can; the message says what to add.
        """
        raise ScenarioError(
            RIG
            if self.asks
            else "nothing of it can be varied, since it is only a function of θ: give the parameters of its "
            "plant as arguments with a default, such as run(theta, seed=0, mass=1.2), or run it as a "
            "ClosedLoop"
        )

    def close(self) -> None:
        """Release what the source holds, such as a connection."""


_DECLARED = (
    "asks",
    "channels",
    "signals",
    "controller",
    "function",
    "stops",
    "limit",
    "recovers",
    "tries",
    "columns",
    "instructions",
    "duration",
    "afterward",
    "candidates",
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

    def trial(self, trial: PlantTrial) -> Run:
        """Return the source's run of a trial."""
        return self.source.trial(trial)

    def settle(self, mark: str) -> None:
        """Let the source forget the values from before a trial that was confirmed."""
        self.source.settle(mark)

    def close(self) -> None:
        """Release what the source holds."""
        self.source.close()

    def varied(self) -> Varied:
        """Return what can be varied of the source; KPIs with a function `around(env)` go with its plant."""
        found = self.source.varied()
        return replace(found, at=partial(self._at, found.at))

    def _at(self, at: Callable[[Values], Source], values: Values) -> Source:
        made = at(values)
        env, around = getattr(function_of(made), "env", None), getattr(self.kpis, "around", None)
        return WithKPIs(made, around(env) if env is not None and around is not None else self.kpis)

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
    """Yield which formulas of KPIs name what channels and keys of signals lack, or have another unit."""
    for kpi in kpis:
        try:
            if kpi.formula:
                conversion_of(kpi.formula, kpi.unit, channels, signals)
        except ScenarioError as error:
            yield f"formula of KPI {kpi.name!r}: {error}"


class Function(Source):
    """A function of θ, or a callable object, which may declare what a `Source` does.

    Args:
        function: Function `run(theta, seed=0)` that returns an experiment.
        varied: Function that returns what can be varied of it, and takes an argument `space` if
            `function` does; None for its own `varied`, or its arguments with a default.
    """

    def __init__(
        self, function: Callable[..., Experiment], varied: Callable[..., Varied] | None = None
    ) -> None:
        self.function: Callable[..., Experiment] = function
        own = getattr(owner_of(function), "varied", None)
        self._varied = varied or (own if callable(own) else None)
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
        return Function(with_space(self.function, space), with_space(self._varied, space))

    def varied(self) -> Varied:
        """Return what it says, or the numbers that it takes with a default, besides θ and the seed.

        A whole one may be a count, which cannot change a little.
        """
        if self._varied is not None:
            return self._varied()
        given = signature(self.function).parameters.values()
        found = {p.name: p.default for p in given if p.name not in _OURS and is_number(p.default)}
        numbers = {name: float(value) for name, value in found.items() if isinstance(value, float)}
        if not numbers:
            return super().varied()
        factors = (Factor.around(name, "parameter", CHANGE, value) for name, value in numbers.items())
        said = [("sensors, actuators and the task", "they are in the code of the run, whose arguments vary")]
        if whole := ", ".join(name for name in found if name not in numbers):
            said += [(f"whole numbers ({whole})", "they may be counts: write 2.0 for 2 where they are not")]
        return Varied(tuple(factors), tuple(said), self._with_arguments)

    def _with_arguments(self, values: Values) -> Source:
        return Function(partial(self.function, **values))


_OURS = ("theta", "seed", "space")


def owner_of(function: Any) -> Any:
    """Return the object whose method a run is, such as `loop` of `loop.run`; else the run itself."""
    bare = function.func if isinstance(function, partial) else function
    return getattr(bare, "__self__", bare)


def with_space(function: Any, space: KnobSpace) -> Any:
    """Return a function for the knobs of `space`, if it takes them as an argument `space`."""
    takes = callable(function) and "space" in signature(function).parameters
    return partial(function, space=space) if takes else function


def source_of(run: Any) -> Source:
    """Return a source as it is, and a function of θ as a source."""
    return run if isinstance(run, Source) else Function(run)


def function_of(run: Any) -> Any:
    """Return the function of θ behind a run or its source; None if there is none."""
    return run.function if isinstance(run, Source) else run


def env_of(source: Source) -> Any:
    """Return the environment of a closed loop, of maneuvers that of the first one; else something else."""
    loop = owner_of(function_of(next(iter(source.maneuvers.values()), source)))
    return getattr(loop, "env", loop)


def plant_of(source: Source) -> Plant | None:
    """Return the plant of a source that is a closed loop, the nominal one; None for any other source."""
    found: Plant | None = getattr(env_of(source), "plant", None)
    if found is None:
        with suppress(PrefcalError):  # what cannot be varied has no plant that is known
            loop = source.varied().loop  # of a function that makes its environment anew for each run
            return None if loop is None else loop.plant
    return found


class Maneuvers(Source):
    """A source that lets the same θ perform several maneuvers, and combines them.

    Args:
        runs: Maps the name of each maneuver to its run: a function `run(theta, seed=0)` that
            returns an `Experiment`, such as a `ClosedLoop` with another `Task`.
        higher_is_better: Names of the KPIs whose smallest value is the worst.
        targets: Names of the KPIs whose worst value is the one farthest from a target, and that
            target in the KPI's unit.

    Raises:
        ExperimentError: If there is no run, a name is empty or "mean", something is not a
            function, or the runs declare channels with different names.
    """

    def __init__(
        self,
        runs: Mapping[str, Callable[..., Experiment]],
        *,
        higher_is_better: Collection[str] = (),
        targets: Mapping[str, float] | None = None,
    ) -> None:
        if not isinstance(runs, Mapping) or not runs:
            raise ExperimentError(
                f'maneuvers must map names to runs, such as {{"step": run_1, "load": run_2}}, got {runs!r}'
            )
        for name, run in runs.items():
            check_name(name)
            if not callable(run):
                raise ExperimentError(f"maneuver {name!r} must be a function of θ, got {run!r}")
        if isinstance(higher_is_better, str):
            raise ExperimentError(f"higher_is_better must hold names of KPIs; write ({higher_is_better!r},)")
        self.maneuvers = {name: source_of(run) for name, run in runs.items()}
        self.higher_is_better = tuple(higher_is_better)
        self.targets = dict(targets or {})
        parts = list(self.maneuvers.values())
        check_channels({n: p.channels for n, p in self.maneuvers.items() if p.channels is not None})
        self.channels = parts[0].channels
        found = [part.signals for part in parts if part.signals is not None]
        if len(found) == len(parts):  # those that all of them have
            self.signals = tuple(key for key in found[0] if all(key in signals for signals in found))

    def _each(self, change: Callable[[Source], Source]) -> "Maneuvers":
        parts = {name: change(part) for name, part in self.maneuvers.items()}
        return Maneuvers(parts, higher_is_better=self.higher_is_better, targets=self.targets)

    def within(self, space: KnobSpace) -> "Maneuvers":
        """Return the same maneuvers for the ranges of `space`."""
        return self._each(lambda part: part.within(space))

    def measured(self, kpis_of: KPIsOf) -> "Maneuvers":
        """Return the same maneuvers, each of which has more KPIs than its own."""
        return self._each(lambda part: part.measured(kpis_of))

    def run(self, theta: Float[np.ndarray, " n"], seed: int = 0) -> Experiment:
        """Run all maneuvers of a physical θ, shape (n,), each with the same seed.

        Raises:
            ExperimentError: If a run returns something else than an experiment, or the
                experiments cannot be combined.
        """
        done = [_run(name, part, theta, seed) for name, part in self.maneuvers.items()]
        return combined(done, higher_is_better=self.higher_is_better, targets=self.targets)

    def varied(self) -> Varied:
        """Return what varies in all maneuvers together; margins are those of the first one.

        A value that differs from its nominal one does so by the same share in each maneuver.
        """
        parts = {name: part.varied() for name, part in self.maneuvers.items()}
        first = {f.name: f for part in reversed(parts.values()) for f in part.factors}
        # What varies in one maneuver does vary, even if another one lacks it.
        said = dict.fromkeys(row for p in parts.values() for row in p.left_out if row[0] not in first)
        at = partial(self._at, parts, first)
        return Varied(tuple(first.values()), tuple(said), at, next(iter(parts.values())).loop)

    def _at(self, parts: Mapping[str, Varied], first: Mapping[str, Factor], values: Values) -> "Maneuvers":
        def own(factors: Iterable[Factor]) -> Iterator[tuple[str, float]]:
            for f in (f for f in factors if f.name in values):
                nominal = first[f.name].nominal
                yield f.name, (f.nominal / nominal if nominal else 1.0) * values[f.name]

        made = {name: part.at(dict(own(part.factors))) for name, part in parts.items()}
        return Maneuvers(made, higher_is_better=self.higher_is_better, targets=self.targets)

    def problems(self, kpis: Iterable[Any]) -> Iterator[str]:
        """Yield the KPIs whose worst maneuver would be one of the better ones."""
        yield from super().problems(kpis)
        asking = [name for name, part in self.maneuvers.items() if part.asks]
        if asking:
            yield f"maneuver {asking[0]!r} must not be a rig, whose experiments a person runs one by one"
        parts = tuple(named("", part) for part in (*self.maneuvers, MEAN))
        for kpi in kpis:
            if kpi.name.endswith(parts):  # of one maneuver alone
                continue
            if kpi.goal == "higher" and kpi.name not in self.higher_is_better:
                yield (
                    f"KPI {kpi.name!r} is better when higher, so its worst maneuver has the "
                    f"smallest value: write Maneuvers(..., higher_is_better=({kpi.name!r},))"
                )
            if kpi.goal == "target" and kpi.name not in self.targets:
                middle = (kpi.at_least + kpi.at_most) / 2
                yield (
                    f"KPI {kpi.name!r} has a target, from which its worst maneuver is "
                    f"farthest: write Maneuvers(..., targets={{{kpi.name!r}: {middle:g}}})"
                )


def _run(name: str, part: Source, theta: Float[np.ndarray, " n"], seed: int) -> Experiment:
    found: object = part.run(theta, seed=seed)
    if not isinstance(found, Experiment):
        forgotten = ": is a return missing?" if found is None else ""
        raise ExperimentError(
            f"maneuver {name!r} must return an Experiment, got {type(found).__name__}{forgotten}"
        )
    return replace(found, maneuver=name)
