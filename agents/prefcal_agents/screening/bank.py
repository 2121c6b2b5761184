"""Simulations for an agent, each θ once, and how its bank of them grows from answer to answer."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from hashlib import sha256
from itertools import pairwise
from threading import Lock
from typing import Any, Protocol, Self, TypeVar

import numpy as np
from jaxtyping import Bool, Float, Int

from prefcal_agents.agent import Agent, Settings, Start, one_thread
from prefcal_agents.lessons import Remembered, Stages, every_tenth
from prefcal_agents.people import (
    DRAWS,
    Bank,
    Lessons,
    Measured,
    Posterior,
    Scale,
    Utilities,
    draw_on_plant,
    explains,
    learn,
    worth,
)
from prefcal_agents.result import DrawPool, limit
from prefcal_agents.search import Region, latin_hypercube
from prefcal_agents.taste import Told, lessons_of
from prefcal_env.arrays import holds_more, integer
from prefcal_env.errors import PreferenceError, SettingsError, SimulationError
from prefcal_env.knobs import KnobSpace, theta_keys
from prefcal_env.preferences.answer import Outcome, Reading
from prefcal_env.preferences.history import History, KPIValues, Sample

# --- Run simulations for an agent, each θ once, keep their KPIs, and what all such agents share.

Theta = Float[np.ndarray, " n"]
Simulate = Callable[[Theta], Mapping[str, float] | None]
"""Function of a physical θ, shape (n,), that returns KPIs by name, lower is better.

KPIs may be infinite (never), or missing or NaN (unknown). None, no KPIs or an exception: the
simulation failed, which keeps the agent away from its θ. If the function has an attribute `many`,
that is called with a list of θ instead and returns their KPIs in the same order, for example from
several processes; see `SimulateMany`. An attribute `reading` says how people read these KPIs.
An attribute `holds` makes a study robust, see `Holds`, and `losses`, see `Losses`, says why some θ does not
hold. An attribute `candidates`, shape (m, n), lists the
only θ that there are, in an order that means nothing: all are simulated before the first question.
"""
Holds = Callable[[Sequence[Theta], range], Bool[np.ndarray, "m r"]]
"""Function of θ and numbers of perturbed runs, from 1 on, that returns which of these runs of each θ keep the
limits, shape (m, r)."""
Losses = Callable[[Theta, range], Mapping[str, int]]
"""Function of a θ and numbers of perturbed runs that returns in how many of these each KPI is lost that is
kept nominally, by its name; "" is the name of runs without any finite KPI, which lose all."""

ENOUGH = 300
"""Number of perturbed runs that all keep the limits of what is shown in a robust study: then fewer
than 1 % of such runs do not, with 95 % confidence."""
_STEPS = (2, 8, 32, 100, ENOUGH)
"""Numbers of perturbed runs after which those of some θ end."""
_SEARCHED = 120  # number of θ in a search for those that keep the limits in most runs
_LEFT, _LEAST = 3, (12, 12, 8, 4, 1)  # of these, one of three runs on after each step, and at least so many
_JUDGED = 10  # number of simulations from which it is judged whether the names of KPIs change

Learned = TypeVar("Learned")


class SimulateMany(Protocol):
    """A `Simulate` that runs many θ at once, such as on all cores.

    Copies of an agent that work in several threads may call it at the same time. What it raises
    is raised by the agent: report the failure of a single simulation as None. If it has an
    attribute `failure`, a text, that is how the last one failed.
    """

    def __call__(self, theta: Theta) -> Mapping[str, float] | None:
        """Simulate one θ, physical, shape (n,)."""

    def many(self, thetas: Sequence[Theta]) -> Iterable[Mapping[str, float] | None]:
        """Return the KPIs of each θ, in order; None for a simulation that failed."""


class Simulations:
    """The simulations of a study, shared by an agent and its copies; it only saves repeating them.

    Copies may work in several threads: a plain function runs one θ at a time, and none twice.

    Args:
        simulate: Function that simulates one θ.

    Raises:
        SettingsError: If it is not a function.
    """

    def __init__(self, simulate: Simulate) -> None:
        many: Any = getattr(simulate, "many", None)
        if not callable(simulate) or not (many is None or callable(many)):
            raise SettingsError(f"simulate must be a function of θ, got {simulate!r}")
        self.simulate = simulate
        self.reading: Reading = getattr(simulate, "reading", None) or Reading()
        self._many: Callable[[Sequence[Theta]], Iterable[Any]] | None = many
        self.holds: Holds | None = getattr(simulate, "holds", None)
        self.losses: Losses = getattr(simulate, "losses", None) or (lambda theta, runs: {})
        self.candidates: Float[np.ndarray, "m n"] | None = getattr(simulate, "candidates", None)
        self._known: dict[bytes, Outcome] = {}
        self._error: Exception | None = None
        self._learned: dict[Callable[..., Any], Any] = {}
        self._one_at_a_time = Lock()

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the function and what it returned; a lock belongs to the threads of a process."""
        known = dict(self._known)  # another thread may add to it
        return Simulations, (self.simulate,), {"_known": known, "_error": self._error}

    def learn_once(self, learn: Callable[..., Learned], *given: Any) -> Learned:
        """Return what `learn(simulations, *given)` returns, the same object for all copies."""
        if learn not in self._learned:
            # Two threads may work it out at the same time; all get the one that came first.
            self._learned.setdefault(learn, learn(self, *given))
        found: Learned = self._learned[learn]
        return found

    @property
    def count(self) -> int:
        """Return the number of simulated θ."""
        return len(self._known)

    @property
    def failed(self) -> int:
        """Return the number of simulations that failed."""
        # A copy, since another thread may add to it meanwhile.
        return sum(not outcome for outcome in list(self._known.values()))

    def __call__(self, thetas: Float[np.ndarray, "m n"]) -> list[Outcome]:
        """Return the KPIs of each row of `thetas`; none for a simulation that failed.

        Raises:
            SimulationError: If no simulation has worked so far, or `simulate` does not return what
                it should: KPIs by name, the same names for every θ.
        """
        keys = theta_keys(thetas)
        if not self._known.keys() >= {*keys}:
            self._run(dict(zip(keys, thetas, strict=True)))
            self._check_names()
        if keys:
            self._check_any()
        return [self._known[key] for key in keys]

    def runs_kept(self, theta: Theta) -> Bool[np.ndarray, " r"]:
        """Return which of `ENOUGH` perturbed runs of a θ keep the limits: all if the study is not robust."""
        return (
            np.ones(ENOUGH, np.bool_) if self.holds is None else self.holds([theta], range(1, ENOUGH + 1))[0]
        )

    def held(self, bank: Bank, rows: Int[np.ndarray, " r"]) -> Bool[np.ndarray, " r"]:
        """Return which rows of a bank hold, shape (r,): all do unless robust: Screening, rule 14.

        They keep in all perturbed runs what they keep nominally, and no row misses fewer stated limits: or
        the more a θ missed, the less it would have to hold.
        """
        if self.holds is None:
            return np.ones(len(rows), dtype=np.bool_)
        held: Bool[np.ndarray, " r"] = self.eligible(bank)[rows]
        for done, step in pairwise((0, *_STEPS)):
            held[held] = self.holds(list(bank.thetas[rows[held]]), range(done + 1, step + 1)).all(axis=1)
        return held

    def steadiest(self, bank: Bank, rows: Int[np.ndarray, " r"]) -> Int[np.ndarray, " r"]:
        """Return how many of `ENOUGH` perturbed runs are kept by those rows that keep most, shape (r,).

        0 for the others: they keep fewer beyond chance, miss more stated limits nominally, fell behind in the
        few runs that most θ get, or come behind the first ones, which alone are searched. Source: Jamieson,
        Talwalkar (2016), Non-stochastic best arm identification and hyperparameter optimization, AISTATS;
        successive halving.
        """
        counts = np.zeros(len(rows), dtype=np.int64)
        if self.holds is None or not len(rows):
            return counts
        kept, missed = np.zeros((len(rows), ENOUGH), dtype=np.bool_), self._count_missed(bank)[rows]
        going = left = np.flatnonzero(missed == missed.min())[:_SEARCHED]
        for (done, step), least in zip(pairwise((0, *_STEPS)), _LEAST, strict=True):
            kept[going, done:step] = self.holds(list(bank.thetas[rows[going]]), range(done + 1, step + 1))
            left = going[np.argsort(-kept[going].sum(axis=1), kind="stable")]
            left = left[[not holds_more(kept[left[0]], kept[row]) for row in left]]
            going = left[: max(-(-len(left) // _LEFT), least)]
        counts[left] = kept[left].sum(axis=1)
        return counts

    def eligible(self, bank: Bank) -> Bool[np.ndarray, " m"]:
        """Return which θ of a bank miss the fewest stated limits nominally, shape (m,): none if one can."""
        missed = self._count_missed(bank)
        return np.asarray(missed == missed.min())

    def _count_missed(self, bank: Bank) -> Int[np.ndarray, " m"]:
        """Return how many stated limits each θ of a bank misses nominally, shape (m,)."""
        missed = self.list_missed(bank)
        counts = missed.sum(axis=1)
        counts[bank.hopeless] = missed.shape[1] + 1
        return np.asarray(counts)

    def list_missed(self, bank: Bank) -> Bool[np.ndarray, "m l"]:
        """Return which of the stated limits each θ of a bank misses nominally, shape (m, l)."""
        limits = [self.reading.limits.get(name) for name in bank.names]
        limited = [k for k, most in enumerate(limits) if most is not None]
        return np.asarray(bank.kpis[:, limited] > [limits[k] for k in limited])

    def _run(self, wanted: Mapping[bytes, Theta]) -> None:
        """Simulate those of `wanted` that are not known; a function of one θ by one thread."""
        with nullcontext() if self._many else self._one_at_a_time:
            # Inside the lock: while this thread waited, another one may have run them.
            new = {key: theta for key, theta in wanted.items() if key not in self._known}
            if self._many is None:
                self._one_by_one(new)
            else:
                self._keep(new, self._all_at_once(self._many, list(new.values())))

    def _one_by_one(self, new: Mapping[bytes, Theta]) -> None:
        found: list[Any] = []
        try:
            for theta in new.values():
                found.append(self._one(theta))
                if not isinstance(found[-1], Mapping | None):
                    break  # no KPIs: what follows would be refused, too
        finally:  # the person may have stopped it
            self._keep(new, found)

    def _one(self, theta: Theta) -> Any:
        try:
            return self.simulate(theta.copy())  # it may write into θ
        except Exception as error:  # people's code may raise anything
            self._error = error
            return None

    @staticmethod
    def _all_at_once(many: Callable[[Sequence[Theta]], Iterable[Any]], thetas: Sequence[Theta]) -> list[Any]:
        found = many([theta.copy() for theta in thetas])
        if not isinstance(found, Iterable):
            raise SimulationError(f"simulate.many must return the KPIs of each θ, got {found!r}")
        found = list(found)
        if len(found) != len(thetas):
            raise SimulationError(
                f"simulate.many must return the KPIs of all {len(thetas)} θ in order, "
                f"got {len(found)} results"
            )
        return found

    def _keep(self, new: Mapping[bytes, Theta], results: Sequence[Any]) -> None:
        """Keep the KPIs that the first of `new` returned, up to what are none; {} where one failed."""
        for (key, theta), result in zip(new.items(), results, strict=False):
            try:
                self._known[key] = Outcome({} if result is None else result)
            except PreferenceError as error:
                raise SimulationError(
                    f"simulate must return a mapping from names of KPIs to numbers, or None if it failed, "
                    f"got {result!r} at θ = {theta}"
                ) from error

    def _check_any(self) -> None:
        """Raise SimulationError if all failed: then the function is wrong, not some θ."""
        if not any(list(self._known.values())):
            why = "returned no KPI that is a number" if self._error is None else repr(self._error)
            why = getattr(self.simulate, "failure", "") or why
            raise SimulationError(
                f"simulate worked for none of {self.count} θ; the last one: {why}"
            ) from self._error

    def _check_names(self) -> None:
        """Raise SimulationError if hardly any two θ have a KPI of the same name."""
        # A name that depends on θ, such as one that holds a number, makes as many KPIs as θ, each known once.
        worked = [outcome for outcome in list(self._known.values()) if outcome]
        if len(worked) < _JUDGED:
            return
        names = Counter([name for outcome in worked for name in outcome])
        name, most = names.most_common(1)[0]
        if most <= len(worked) // _JUDGED:
            raise SimulationError(
                "simulate must return KPIs of the same names for every θ, but the most common of "
                f"{len(names)} names, {name!r}, came with {most} of {len(worked)} θ"
            )


@dataclass(frozen=True, slots=True)
class Budget(Settings):
    """What an agent that simulates may use.

    Args:
        n_simulated: Number of θ that it may simulate, 1 or more.
        taste: Answers of the same person in an earlier study, as `Told` or its plain data.
    """

    n_simulated: int = 1000
    taste: tuple[Told, ...] = ()

    def __post_init__(self) -> None:
        integer("n_simulated", self.n_simulated, low=1)
        object.__setattr__(self, "taste", tuple(map(Told.of, self.taste)))

    def pairs(self) -> tuple[tuple[str, Any], ...]:
        """Return name and value of every setting, for an `AgentState`."""
        taste = tuple(each.plain for each in self.taste)
        return (("n_simulated", self.n_simulated), *((("taste", taste),) if taste else ()))


class Simulating(Agent):
    """An agent that is given a simulation, and shows only some of what it simulates.

    Copies share the simulations. A restored agent has none until `with_simulations`. Arguments and
    errors are those of `Agent`, but `n_init` has no effect, and two are added:

    Args:
        simulate: Function of a physical θ, shape (n,), that returns KPIs by name, lower is better;
            see `Simulate`. Without it, the agent can only be inspected.
        n_simulated: Number of θ to simulate, 1 or more.
        taste: Answers of the same person in an earlier study, by `Told.all_of`.
    """

    options = Budget
    _simulations: Simulations | None = None

    def __init__(
        self,
        space: KnobSpace,
        *,
        simulate: Simulate | None = None,
        n_simulated: int = 1000,
        n_init: int = 1,
        n_max: int = 11,
        seed: int = 0,
        start: Start | None = None,
        taste: Sequence[Told] = (),
    ) -> None:
        budget = Budget(n_simulated, tuple(taste))
        super().__init__(space, n_init=n_init, n_max=n_max, seed=seed, start=start, settings=budget)
        self._simulations = None if simulate is None else Simulations(simulate)

    def with_simulations(self, simulate: Simulate) -> Self:
        """Return a copy that simulates by `simulate`, for example one restored from a file."""
        twin = self.copy()
        twin._simulations = Simulations(simulate)
        twin._forget()
        twin._prepare()
        return twin

    @property
    def n_simulated(self) -> int:
        """Return the number of θ that the agent may simulate."""
        return int(self.setup.settings.n_simulated)

    @property
    def simulate(self) -> Simulate | None:
        """Return the function that simulates a θ; None for an agent that was restored without."""
        return None if self._simulations is None else self._simulations.simulate

    @property
    def simulations(self) -> Simulations:
        """Return the simulations so far: how many, and how many failed.

        Raises:
            SettingsError: If the agent has no `simulate`.
        """
        if self._simulations is None:
            name = type(self).__name__
            raise SettingsError(f"{name} needs simulate, a function of θ that returns KPIs")
        return self._simulations


# --- How the bank of a screening agent grows from answer to answer.

_FIRST, _SECOND, _LATER = (0.2, 0.08), (0.2, 0.12), (0.0, 0.04)
"""Shares of the simulations, over the whole space and near the leaders: before the first question,
which must come soon; after the first answer; and after each later one."""
_ANSWERS = 10  # number of later answers that are followed by simulations; then all are used up
_ROUND = 50  # number of θ near the leaders after which leaders are chosen again
_JUDGES, _GUIDES = 256, 64  # numbers of draws that judge the whole bank, and that say where to simulate next
_LEADERS = 20  # number of the best θ of a draw that span the step
_BASES = 3  # number of the best θ of a draw from which a step starts
_STEP = (0.2, 0.8)  # smallest and largest multiple of the difference of two leaders
_MOVED = 0.8  # probability that a knob moves along
_JITTER = 0.01  # standard deviation of a random step, in units of the cube, where all leaders agree
_LEARN = 0  # first stream of random numbers; the next ones place θ
_CORRECT = 1000  # stream that draws how the plant differs from the simulation
_TRAVELED = 0.5  # how much an answer of an earlier study counts, where one of this study counts 1
_RECENT = 20  # number of answers of an earlier study that count, the latest ones
_POSTERIORS = 3  # number of posteriors in memory, those of likely answers; in a long study each is 8 MB
_POOL, _RECALLED = 2000, 10
"""Stream of the pool's draws before any answer, and number of the latest answers it has draws of."""


@dataclass(frozen=True, eq=False, slots=True)
class Stage:
    """What is known when a query is made.

    Args:
        bank: Simulated θ, with their measured KPIs where these are others.
        spread: Rows of the bank that fill the space, shape (r,).
        scale: How KPIs are measured.
        logs: Log distances of the KPIs that are expected, shape (m, k).
        utilities: Draws of what the person wants.
        costs: Cost of each θ in some of the draws, lower is better, shape (d, m).
        rough: Whether experiments measured other KPIs than those simulated.
    """

    bank: Bank
    spread: Int[np.ndarray, " r"]
    scale: Scale
    logs: Float[np.ndarray, "m k"]
    utilities: Utilities
    costs: Float[np.ndarray, "d m"]
    rough: bool


@dataclass(frozen=True, slots=True)
class KeptStage:
    """What a stage cannot be made from in no time, to keep it between sessions: numbers, to the last bit.

    Args:
        z: Points of the bank.
        thetas: The same, physical.
        spread: Rows that fill the space.
        names: KPIs of the scale, which is older than the last θ of the bank.
        scale: Its numbers, a row for each KPI.
        utilities: Numbers of `Utilities`.
        kpis: Digest of the KPIs of the bank: other simulations make another stage.
    """

    z: bytes
    thetas: bytes
    spread: bytes
    names: tuple[str, ...]
    scale: bytes
    utilities: bytes
    kpis: bytes

    @classmethod
    def of(cls, stage: Stage) -> "KeptStage":
        """Return what is kept of a stage."""
        scale, bank = stage.scale, stage.bank
        numbers = np.vstack([scale.good, scale.floor, scale.ranges, scale.limits, scale.quantiles])
        return cls(
            bank.z.tobytes(),
            bank.thetas.tobytes(),
            stage.spread.astype(np.int64).tobytes(),
            scale.names,
            numbers.tobytes(),
            stage.utilities.to_bytes(),
            sha256(bank.kpis.tobytes()).digest(),
        )

    @property
    def measure(self) -> Scale:
        """Return the scale."""
        good, floor, ranges, limits, *quantiles = np.frombuffer(self.scale).reshape(-1, len(self.names))
        return Scale(self.names, good, floor, np.array(quantiles), ranges, limits)


class Growth:
    """The stages of a study: a function of the record, and remembered.

    Copies of an agent share it. Nothing in it has to be saved: a restored agent simulates the same
    θ again.

    Args:
        simulations: Simulations of the study.
        space: Knobs to tune.
        n_simulated: Largest number of θ to simulate.
        seed: Seed of all randomness.
        taste: Answers of the same person in an earlier study.
    """

    def __init__(
        self,
        simulations: Simulations,
        space: KnobSpace,
        n_simulated: int,
        seed: int,
        taste: tuple[Told, ...] = (),
    ) -> None:
        self.simulations = simulations
        self._space, self._seed, self._taste = space, seed, taste[-_RECENT:]
        given = simulations.candidates
        # Given candidates are all there is: there is nothing near a leader to simulate.
        self._plan = _plan(n_simulated) if given is None else [(len(given), 0)]
        wide = sum(count for count, _ in self._plan)
        # One design for both parts, which fill the space together.
        self._design = latin_hypercube(space, wide, seed) if given is None else space.encode_all(given)
        self.stage = Stages(self._first, self._follow)
        """What is known after a record, simulating what was not simulated yet."""
        self._kept: Mapping[bytes, KeptStage] = {}
        self.worth = Remembered(lambda past: worth(self.stage(past).costs), 1)
        """Worth of each θ in each draw of the stage after a record, shape (d, m)."""
        self.posterior = Remembered(self._posterior, _POSTERIORS)
        """What the draws of the stage after a record say of each answer."""
        # The certificate and the next proposal ask the same.
        self.explains = Remembered(lambda past: explains(past, self.posterior(past)))
        self.pool = Remembered(self._pool, 1)  # the latest one: it is large
        """Draws of the study after a record, which say what other answers would teach."""

    def worth_keeping(self, history: History) -> dict[bytes, KeptStage]:
        """Return the stages at hand that later ones, and the draws of all records, follow from."""
        last = history.answered
        recent = map(history.until, range(max(last - _RECALLED, 1), last + 1))
        found = dict[bytes, KeptStage]()
        for past in (*every_tenth(history), *recent):
            if past in self.stage:
                found[past.key] = KeptStage.of(self.stage(past))
            elif past.key in self._kept:  # nobody asked for it yet, but the next session may
                found[past.key] = self._kept[past.key]
        return {key: kept for key, kept in found.items() if kept.names}

    def recall(self, kept: Mapping[bytes, KeptStage]) -> None:
        """Use what an earlier session learned, where record and simulated KPIs are still the same."""
        self._kept = kept
        self.stage.recalled = lambda past: self._restore(past, kept[past.key]) if past.key in kept else None

    def _restore(self, past: History, kept: KeptStage) -> Stage | None:
        with one_thread():
            knobs, scale = len(self._space), kept.measure
            bank = self._simulate(*(np.frombuffer(each).reshape(-1, knobs) for each in (kept.z, kept.thetas)))
            utilities = Utilities.of_bytes(kept.utilities, len(scale.names))
            if utilities is None or not {*scale.names} <= {*bank.names}:
                return None
            spread = np.frombuffer(kept.spread, dtype=np.int64)
            stage = self._stage(past, bank, spread, scale, utilities)
            return stage if sha256(stage.bank.kpis.tobytes()).digest() == kept.kpis else None

    def _pool(self, history: History) -> DrawPool:
        stage, last = self.stage(history), history.answered
        given = [(History(), self._before(history, stage.scale))]
        for count in range(max(last - _RECALLED, 1), last):
            past = history.until(count)
            earlier = self.stage(past)
            # A KPI that was the same everywhere came in later: draws without it say nothing of it.
            if earlier.scale.names == stage.scale.names:
                given.append((past, earlier.utilities))
        return DrawPool.of(stage.bank, stage.scale, stage.logs, [*given, (history, stage.utilities)])

    def _before(self, history: History, scale: Scale) -> Utilities:
        """Return draws before any answer of this study, for the pool after `history`."""
        if self._taste:  # to learn it again would take a second
            first = self.stage(History())
            if first.scale.names == scale.names:
                return first.utilities
        return self._draw(scale, self._rng(history, _POOL))

    def due(self, history: History) -> int:
        """Return how many θ are simulated by the time of the query after `history`."""
        turn = max(history.answered - 1, 0)
        return sum(wide + near for wide, near in self._plan[: turn + 1])

    def works(self, z: Float[np.ndarray, " n"], bank: Bank) -> bool:
        """Simulate the θ of a point of the cube, shape (n,); return whether it can be shown.

        It has a finite KPI and, in a robust study, holds, also beside the θ of `bank`.
        """
        bank = self.extend(bank, *self._space.proposals(z[None]))
        last = len(bank) - 1
        return bool(not bank.hopeless[last] and self.simulations.held(bank, np.array([last]))[0])

    def _first(self) -> Stage:
        """Return the stage before the first answer: leaders by what anybody may want."""
        with one_thread():
            wide, near = self._plan[0]
            bank = self._simulate(*self._space.proposals(self._design[:wide]))
            spread = np.arange(len(bank))
            scale = Scale.of(bank, spread, self._limits(bank))
            stage = self._stage(
                History(), bank, spread, scale, self._draw(scale, self._rng(History(), _LEARN))
            )
            return self._refine(History(), stage, near)

    def _limits(self, bank: Bank) -> Mapping[str, float]:
        """Return the limits that people are taken to have: all aims, or none if they cost an objective."""
        reading = self.simulations.reading
        if not reading.aims:
            return reading.limits
        aimed = replace(reading, limits={**reading.limits, **reading.aims})
        least, least_aimed = (each.missed(bank.names, bank.kpis).min() for each in (reading, aimed))
        return aimed.limits if least_aimed == least else reading.limits

    def _stage(
        self,
        past: History,
        bank: Bank,
        spread: Int[np.ndarray, " r"],
        scale: Scale,
        utilities: Utilities,
        judges: int = _JUDGES,
    ) -> Stage:
        """Return the stage after `past`, given the bank as simulated."""
        # A quarter of the draws judges the bank: costs of all θ in all draws would take four times as long.
        some = utilities.some(judges)
        logs = expected = scale(bank)
        measured = Measured.of(bank, past, self.simulations.reading)
        seen, rows = measured.on(bank), measured.rows
        if len(rows) and scale.names:
            rng = self._rng(past, _CORRECT)
            # Each judging draw has a plant of its own, so that what is unknown of the plant counts as
            # unknown.
            logs = draw_on_plant(bank.z, logs, rows, scale(seen, rows.tolist()), len(some), rng)
            expected = np.median(logs, axis=0)
        return Stage(seen, spread, scale, expected, utilities, some.costs(logs), rough=len(rows) > 0)

    def _draw(self, scale: Scale, rng: np.random.Generator) -> Utilities:
        """Return draws before any answer of this study, given those of an earlier one."""
        draws = Utilities.draw(scale, DRAWS, rng)
        return learn(draws, self._earlier_lessons(scale), scale, rng) if self._taste else draws

    def _earlier_lessons(self, scale: Scale) -> Lessons:
        return lessons_of(self._taste, scale, _TRAVELED, self.simulations.reading)

    def _follow(self, past: History, before: History, stage: Stage) -> Stage:
        """Return the stage after `past`, given the one after `before`, a step earlier."""
        with one_thread():
            if past.answered == before.answered:  # follow-ups teach, but bring no new θ
                bank = self._simulate(stage.bank.z, stage.bank.thetas)
                utilities = self._learn(past, before, bank, stage.scale, stage.utilities)
                return self._stage(past, bank, stage.spread, stage.scale, utilities)
            turn = past.answered - 1  # the first one is compared with nothing
            # Turn 0 is the bank before the first question, which `_first` has simulated.
            wide, near = self._plan[turn] if 0 < turn < len(self._plan) else (0, 0)
            bank, spread = self._widen(stage, past, turn, wide)
            scale, utilities = Scale.of(bank, spread, self._limits(bank)), stage.utilities
            if scale.names != stage.scale.names:  # a KPI was always the same before: begin again
                before, utilities = History(), self._draw(scale, self._rng(History(), _LEARN))
            # A KPI found a better value, or room to a margin costs no objective any more.
            elif not np.array_equal(scale.limits, stage.scale.limits):
                utilities = limit(scale, utilities)
            utilities = self._learn(past, before, bank, scale, utilities)
            judges = _GUIDES if near else _JUDGES
            stage = self._stage(past, bank, spread, scale, utilities, judges)
            return self._refine(past, stage, near)

    def _widen(self, stage: Stage, past: History, turn: int, wide: int) -> tuple[Bank, Int[np.ndarray, " r"]]:
        """Return the bank with the next `wide` θ of the design and all shown, and its design."""
        bank, spread, start = stage.bank, stage.spread, sum(count for count, _ in self._plan[:turn])
        if wide or stage.rough:
            bank = self.extend(bank, *self._space.proposals(self._design[start : start + wide]))
            spread = np.append(spread, np.arange(len(stage.bank), len(bank)))
        # A person may ask for any θ, also for one that the design never had: answers about it need its KPIs.
        z, thetas = _points(past.samples)
        return bank if bank.has_all(thetas) else self.extend(bank, z, thetas), spread

    def _learn(
        self, past: History, before: History, bank: Bank, scale: Scale, utilities: Utilities
    ) -> Utilities:
        """Return draws given the answers of `past`, from draws given those of `before`."""
        if not past.lessons and not past.unsafe:
            return utilities
        seen = Measured.of(bank, past, self.simulations.reading).on(bank)
        given, old = self.posterior.known(before), self._lessons(seen, scale, before)
        # KPIs may be measured otherwise now, or nobody asked for the stage before in this session.
        if given is None or given.utilities is not utilities or old.shared(given.lessons) < len(old):
            given = Posterior.of(utilities, old)
        after = given.update(self._lessons(seen, scale, past), scale, self._rng(past, _LEARN))
        return self.posterior.keep(past, after).utilities

    def _lessons(self, seen: Bank, scale: Scale, past: History) -> Lessons:
        """Return the answers of `past`, then those of an earlier study."""
        found = Lessons.of(seen, scale, past)
        return found.join(self._earlier_lessons(scale)) if self._taste else found

    def _posterior(self, past: History) -> Posterior:
        stage = self.stage(past)
        return Posterior.of(stage.utilities, self._lessons(stage.bank, stage.scale, past))

    def _refine(self, past: History, stage: Stage, count: int) -> Stage:
        """Return the stage with `count` more θ near the leaders, in rounds if they are many."""
        if not count or not stage.scale.names:
            return stage
        rounds = max(count // _ROUND, 1)
        for number, part in enumerate(np.array_split(np.arange(count), rounds)):
            rng = self._rng(past, _LEARN + 1 + number)
            points = near_leaders(self._space, stage.bank.z, stage.costs, len(part), rng)
            z, thetas = self._space.proposals(points)
            kept = np.atleast_1d(self._space.allows(thetas))  # rounding may cross an edge
            bank = self.extend(stage.bank, z[kept], thetas[kept])
            # Only the last round's costs choose what is shown; before, they only say where to look.
            judges = _GUIDES if number < rounds - 1 else _JUDGES
            stage = self._stage(past, bank, stage.spread, stage.scale, stage.utilities, judges)
        return stage

    def stage_with(self, samples: Sequence[Sample], past: History, stage: Stage) -> Stage:
        """Return the stage after `past` with the θ of more samples in its bank."""
        bank = self.extend(stage.bank, *_points(samples))
        return self._stage(past, bank, stage.spread, stage.scale, stage.utilities)

    def extend(self, bank: Bank, z: Float[np.ndarray, "j n"], thetas: Float[np.ndarray, "j n"]) -> Bank:
        """Return the bank with more θ, simulating what was not simulated yet."""
        return self._simulate(np.vstack([bank.z, z]), np.vstack([bank.thetas, thetas]))

    def _simulate(self, z: Float[np.ndarray, "j n"], thetas: Float[np.ndarray, "j n"]) -> Bank:
        """Return the bank of these θ, with their KPIs as people read them."""
        bank, reading = Bank.of(z, thetas, KPIValues.of(self.simulations(thetas))), self.simulations.reading
        return replace(bank, kpis=reading.table(bank.names, bank.kpis))

    def _rng(self, past: History, stream: int) -> np.random.Generator:
        return np.random.default_rng([self._seed, past.answered, len(past.follow_ups), stream])


def _points(samples: Sequence[Sample]) -> tuple[Float[np.ndarray, "j n"], Float[np.ndarray, "j n"]]:
    """Return the points of the cube of samples, and their physical θ."""
    return np.array([s.z for s in samples]), np.array([s.theta for s in samples])


def _plan(n_simulated: int) -> list[tuple[int, int]]:
    """Return how many θ to simulate for each answer: over the space, and near the leaders."""
    shares = np.array([_FIRST, _SECOND, *[_LATER] * _ANSWERS])
    # Rounded sums, not rounded shares, so that the counts add up to `n_simulated`.
    counts = np.diff(np.round(n_simulated * np.cumsum(shares)), prepend=0.0).reshape(shares.shape)
    plan = [(int(wide), int(near)) for wide, near in counts]
    return [(max(plan[0][0], 1), plan[0][1]), *plan[1:]]


def near_leaders(
    space: KnobSpace,
    z: Float[np.ndarray, "m n"],
    costs: Float[np.ndarray, "s m"],
    count: int,
    rng: np.random.Generator,
) -> Float[np.ndarray, "count n"]:
    """Return points of the cube near the θ with the lowest costs, shape (count, n): Screening, rule 2.

    Each point belongs to one draw: one of its best θ, plus a part of the difference of two of its
    leaders. So steps are long while leaders are far apart, and shrink with them.

    Source: R. Storn, K. Price, "Differential evolution" (1997).
    Deviation: the population is the leaders of one draw, and all simulated θ can be leaders.

    Args:
        space: Knobs to tune.
        z: Simulated points of the cube, shape (m, n).
        costs: Their costs in each draw, shape (s, m).
        count: Number of points.
        rng: Generator of the draws.
    """
    leaders = np.argsort(costs, axis=1, kind="stable")[:, :_LEADERS]
    drawn = leaders[rng.integers(len(leaders), size=count)]
    first = drawn[np.arange(count), rng.integers(min(_BASES, drawn.shape[1]), size=count)]
    # Both may be the same θ: then the step is the jitter alone.
    pair = np.array([rng.choice(row, 2) for row in drawn])
    step = rng.uniform(*_STEP, (count, 1)) * (z[pair[:, 0]] - z[pair[:, 1]])
    step *= rng.random(step.shape) < _MOVED
    low, high = space.corners
    points = z[first] + step + _JITTER * rng.standard_normal(step.shape)
    points = np.clip(points, low, high)  # many optima lie at the edge
    if not space.constraints:
        return space.snap_all(points)
    region = Region(space)
    allowed = z[region.allows(z)]
    return region.repaired(points, allowed) if len(allowed) else space.snap_all(points)
