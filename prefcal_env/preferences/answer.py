"""Questions and answers, the KPIs that agents see, and the loop: ask, run, answer, tell."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from enum import Enum, IntEnum
from queue import SimpleQueue
from typing import Any, Generic, NamedTuple, Protocol, Self, TypeVar, final, runtime_checkable

import numpy as np
from jaxtyping import Float, Int

from prefcal_env.arrays import integer, is_number
from prefcal_env.errors import PreferenceError, RunError
from prefcal_env.experiments.experiment import End, Experiment
from prefcal_env.experiments.kpis import as_read as as_read
from prefcal_env.knobs import KnobSpace, theta_key
from prefcal_env.plain import from_plain, to_plain
from prefcal_env.workers import ATTEMPTS

_NUMBERS: Mapping[Any, float] = {"inf": np.inf, "-inf": -np.inf}


class Outcome(Mapping[str, float]):
    """KPIs of an experiment by name, frozen and hashable: lower is better, infinity means never.

    Args:
        kpis: Maps a name to its value; NaN means unknown and is dropped.

    Raises:
        PreferenceError: If a name is not a string or a value is not a number.
    """

    def __init__(self, kpis: Mapping[str, float]) -> None:
        if not isinstance(kpis, Mapping):
            raise PreferenceError(f"an outcome must map names to numbers, got {kpis!r}")
        for name, value in kpis.items():
            numeric = isinstance(value, (int, float, np.integer, np.floating))
            if not isinstance(name, str) or not numeric:
                raise PreferenceError(f"a KPI must be a name and a number, got {name!r}: {value!r}")
        values = {name: _float(name, value) for name, value in kpis.items()}
        self._kpis = dict(sorted((name, value) for name, value in values.items() if not np.isnan(value)))

    def __getitem__(self, name: str) -> float:
        return self._kpis[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._kpis)

    def __len__(self) -> int:
        return len(self._kpis)

    def __hash__(self) -> int:
        return hash(tuple(self._kpis.items()))

    def __repr__(self) -> str:
        return f"Outcome({self._kpis!r})"

    @staticmethod
    def table(outcomes: "Sequence[Outcome]") -> tuple[tuple[str, ...], list[list[float]]]:
        """Return the names of all KPIs, sorted, and a row of values of each outcome; NaN is unknown."""
        told = [outcome._kpis for outcome in outcomes]
        names = tuple(sorted({*()}.union(*told)))
        # They are sorted: of a thousand θ that have all of them, names need not be looked up.
        whole = len(names)
        return names, [
            [*kpis.values()] if len(kpis) == whole else [kpis.get(name, np.nan) for name in names]
            for kpis in told
        ]

    def to_dict(self) -> dict[str, float | str]:
        """Return plain data for JSON, which has no infinity: it becomes the text "inf"."""
        return {k: v if np.isfinite(v) else str(v) for k, v in self._kpis.items()}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> "Outcome":
        """Read the data that `to_dict` returns. Raises PreferenceError for anything else."""
        if not isinstance(data, Mapping):
            return cls(data)
        words: dict[str, Any] = {k: _NUMBERS.get(v, v) if isinstance(v, str) else v for k, v in data.items()}
        return cls(words)


def _float(name: str, value: Any) -> float:
    try:
        return float(value)
    except OverflowError as error:
        raise PreferenceError(f"KPI {name!r} must be a number, got one too large") from error


# --- What people read off KPIs: numbers in steps, targets reached or not, objectives met or missed.
#
# A difference that nobody can read is none: neither for what agents learn nor for what is said.


@dataclass(frozen=True, slots=True)
class Reading:
    """How people read KPIs, given as agents know them: lower is better (Screening, rule 1)."""

    # Name of a KPI to the smallest difference that is shown, in its unit; 0 if only its four digits limit it.
    # KPIs without a row are compared exactly.
    steps: Mapping[str, float] = field(default_factory=dict)
    # Name of a KPI to the largest value that meets its objective
    limits: Mapping[str, float] = field(default_factory=dict)
    targets: frozenset[str] = frozenset()  # KPIs of which all values that meet the objective are alike
    # Name of a KPI to a value below its limit, which proposals keep if that costs no objective
    aims: Mapping[str, float] = field(default_factory=dict)

    def __call__(self, name: str, values: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
        """Return the values of KPI `name` as people read them, shape (m,)."""
        return self.table([name], values[:, None])[:, 0]

    def table(self, names: Sequence[str], kpis: Float[np.ndarray, "m k"]) -> Float[np.ndarray, "m k"]:
        """Return the KPIs `names` of m experiments as people read them, shape (m, k)."""
        known = [name in self.steps for name in names]
        if not any(known):
            return kpis
        steps = [self.steps.get(name, 0.0) for name in names]
        alike = [name in self.targets and name in self.steps for name in names]
        limits = [self.limits[n] if one else 0.0 for n, one in zip(names, alike, strict=True)]
        read = np.where(known, as_read(kpis, np.array(steps)), kpis)
        return np.where(alike & (read <= limits), 0.0, read)

    def missed(self, names: Sequence[str], kpis: Float[np.ndarray, "m k"]) -> Int[np.ndarray, " m"]:
        """Return how many objectives each experiment misses, shape (m,); never counts, too."""
        most = np.array([self.limits.get(name, np.finfo(float).max) for name in names])
        return np.asarray(np.count_nonzero(kpis > most, axis=1))


# --- Define questions and answers, which an agent and a person or program exchange.
#
# Source: the preference function is eq. pref_fun, its vector of answers eq. pref-vector.

ExperimentT = TypeVar("ExperimentT", contravariant=True)
Outcomes = tuple[Mapping[str, Any] | None, Mapping[str, Any] | None]
"""KPIs of the challenger and of the incumbent: names and numbers.

An `Answer` turns both into an `Outcome`. The values are not `float` here, since JSON has no
infinity: stored outcomes say "inf" or "-inf" instead.
"""


class Preference(IntEnum):
    """π(challenger, incumbent) of eq. pref_fun."""

    CHALLENGER = -1
    TIE = 0
    INCUMBENT = 1


class Mark(Enum):
    """Marks that a calibrator may give to one side besides the verdict.

    No calibrator gives the last one: it says that the KPIs of the challenger are lower bounds,
    because its run was cut short.
    """

    CHALLENGER_UNSAFE = "challenger unsafe"
    INCUMBENT_UNSAFE = "incumbent unsafe"
    CHALLENGER_GOOD_ENOUGH = "challenger good enough"
    INCUMBENT_GOOD_ENOUGH = "incumbent good enough"
    CHALLENGER_CUT_SHORT = "challenger cut short"

    @property
    def mirrored(self) -> "Mark":
        """The same mark on the other side."""
        side, _, what = self.value.partition(" ")
        return Mark(f"{'incumbent' if side == 'challenger' else 'challenger'} {what}")


@dataclass(frozen=True, slots=True)
class Answer:
    """An answer to a query.

    Args:
        preference: Which one is better; None is an abstention ("can't tell").
        strength: Weight c_h of eq. QP-pref, above 0, which counts where answers contradict each
            other: 1 for an ordinary verdict. That of a tie or an abstention is always 1.
        marks: Marks on either side.
        outcomes: Known KPIs of the challenger's and the incumbent's experiments by name, lower is
            better; infinite means never, NaN or no entry means unknown.
        value: Score of the challenger, lower is better, from which a value-based agent learns
            instead of a preference.
        automatic: The `marks` that no person gave, because they follow from how a run ended; see
            `completed`.

    Raises:
        PreferenceError: If the preference is none of -1, 0, 1 and None, the strength is not
            positive and finite, a mark is unknown, an automatic mark is not among the marks, or the
            value is not finite.
    """

    preference: Preference | None
    strength: float = 1
    marks: tuple[Mark, ...] = ()
    outcomes: Outcomes | None = None
    value: float | None = None
    automatic: tuple[Mark, ...] = ()

    def __post_init__(self) -> None:
        if self.preference is not None:
            object.__setattr__(self, "preference", _preference(self.preference))
        if not (is_number(self.strength) and 0 < self.strength < np.inf):
            raise PreferenceError(f"strength must be finite and above 0, got {self.strength!r}")
        if not self.preference and self.strength != 1:  # a tie or an abstention
            object.__setattr__(self, "strength", 1)
        object.__setattr__(self, "marks", tuple(self.marks))
        for mark in self.marks:
            if not isinstance(mark, Mark):
                raise PreferenceError(f"a mark must be one of {list(Mark)}, got {mark!r}")
        object.__setattr__(self, "automatic", tuple(self.automatic))
        if not set(self.automatic) <= set(self.marks):
            raise PreferenceError(f"automatic must be some of the marks {self.marks}, got {self.automatic}")
        if self.outcomes is not None:
            object.__setattr__(self, "outcomes", _outcomes(self.outcomes))
        if self.value is not None:
            object.__setattr__(self, "value", _score(self.value))

    @classmethod
    def of(cls, answer: "Answer | Preference | int | None") -> "Answer":
        """Return `answer` as an Answer; a bare -1, 0, 1 or None (abstain) is accepted.

        Raises:
            PreferenceError: If it is anything else.
        """
        return answer if isinstance(answer, cls) else cls(answer)  # type: ignore[arg-type]

    @classmethod
    def scored(cls, value: "Answer | float | None") -> "Answer":
        """Return the score `value` as an Answer; None if the experiment has no score.

        Raises:
            PreferenceError: If it is not a finite number, or an Answer that holds a preference.
        """
        answer = value if isinstance(value, cls) else cls(None, value=value)  # type: ignore[arg-type]
        if answer.preference is not None:
            raise PreferenceError(f"a value-based agent needs a score, not a preference: got {answer}")
        return answer

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON; `from_dict` reads it back."""
        plain: dict[str, Any] = to_plain(self)
        return plain

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> "Answer":
        """Read the data that `to_dict` returned; other keys are ignored.

        Raises:
            PreferenceError: If something is missing or malformed.
        """
        return from_plain(data, cls, PreferenceError, "an answer")


def _outcomes(given: Any) -> tuple[Outcome | None, Outcome | None]:
    """Return a pair of outcomes, None if unknown; a single one is the challenger's."""
    if isinstance(given, Mapping):
        given = (given, None)
    if not isinstance(given, (tuple, list)) or len(given) != 2:
        raise PreferenceError(f"outcomes must be the challenger's and the incumbent's, got {given!r}")
    challenger, incumbent = (
        o if o is None or isinstance(o, Outcome) else Outcome.from_dict(o) for o in given
    )
    return challenger, incumbent


def _score(value: Any) -> float:
    if is_number(value) and np.isfinite(value):
        return float(value)
    raise PreferenceError(f"a score must be a finite number, or None if there is none, got {value!r}")


def _preference(value: Any) -> Preference:
    if is_number(value) and value in (-1, 0, 1):  # np.sign gives a float
        return Preference(int(value))
    raise PreferenceError(
        "an answer must be -1 (challenger better), 0 (equally good), 1 (incumbent better), "
        f"None (can't tell) or an Answer, got {value!r}"
    )


@dataclass(frozen=True, eq=False)
class Suggestion:
    """Experiment number `index` (from 0), with parameters `theta`, physical, shape (n,)."""

    index: int
    theta: Float[np.ndarray, " n"]

    def __post_init__(self) -> None:
        theta = np.array(self.theta, dtype=float)
        theta.setflags(write=False)
        object.__setattr__(self, "theta", theta)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Suggestion):
            return NotImplemented
        return self.index == other.index and np.array_equal(self.theta, other.theta)

    def __hash__(self) -> int:
        return hash((self.index, (self.theta + 0.0).tobytes()))  # -0.0 is equal to 0.0


@dataclass(frozen=True, slots=True)
class Query:
    """A question: is the challenger better than the incumbent?

    The incumbent is None in the very first query (there is nothing to compare with; any answer
    closes it and teaches nothing) and in every query of a value-based agent. A `further` query
    compares two experiments that have run, and needs no new one.
    """

    challenger: Suggestion
    incumbent: Suggestion | None = None
    further: bool = False


class Agent(Protocol):
    """An agent that proposes θ and learns from preferences; the one mutable object of a study.

    `ask` is pure: asking twice changes nothing. `tell` refuses an answer to a query that is
    not the open one. The contract suite `tests/contracts/agents.py` is what an agent must pass.
    """

    @property
    def space(self) -> KnobSpace:
        """The knobs that θ is made of."""

    @property
    def n_max(self) -> int:
        """Number of experiments after which the agent is done."""

    @property
    def done(self) -> bool:
        """Whether all experiments are answered."""

    @property
    def best(self) -> Float[np.ndarray, " n"]:
        """θ of the incumbent, physical, shape (n,). Raises ProtocolError before any answer."""

    def ask(self) -> Query:
        """Return the open query. Raises ProtocolError when done."""

    def tell(self, query: Query, answer: Answer | Preference | int | None) -> None:
        """Close `query`. Raises ProtocolError if it is not open, PreferenceError if no answer."""

    def undo(self) -> None:
        """Take the last answer back and open its query again. Raises ProtocolError if none."""

    def retract(self, index: int) -> None:
        """Forget answer number `index` (from 0), keep its sample. Raises ProtocolError if none."""

    def copy(self) -> Self:
        """Return an independent copy, used to prepare the next query for each likely answer."""


@runtime_checkable
class Calibrator(Protocol[ExperimentT]):
    """A judge of two experiments: the front end of a person, or a synthetic one."""

    def prefer(self, challenger: ExperimentT, incumbent: ExperimentT) -> Answer | Preference | int | None:
        """Return which one is better: -1, 0 or 1 as in eq. pref_fun, or None to abstain."""


# --- Run the experiments of a loop: one after the other, or several at once.

R = TypeVar("R")
Theta = Float[np.ndarray, " n"]


class Executor(Protocol):
    """What runs functions elsewhere: an executor of `concurrent.futures`, or one like it."""

    def submit(self, fn: Callable[..., Any], /, *args: Any) -> Any:
        """Start `fn(*args)`, and return its future."""


@contextmanager
def runs_of(
    run: Callable[[Theta], R], at_once: int, executor: Executor | None
) -> Iterator["ExperimentPool[R]"]:
    """Yield what runs experiments for `ask_and_tell`, whose arguments these are."""
    integer("at_once", at_once, low=1)
    if executor is not None or at_once == 1:
        yield ExperimentPool(run, int(at_once), executor)
        return
    threads = ThreadPoolExecutor(int(at_once), "experiment")
    try:
        yield ExperimentPool(run, int(at_once), threads)
    finally:
        threads.shutdown(wait=False, cancel_futures=True)


def first_ready(queries: Iterable[Query], done: Mapping[int, int]) -> Query | None:
    """Return the query to answer first; None if none has all its experiments.

    One about two experiments that were compared before comes first, then the one whose challenger
    was done first.

    Args:
        done: Index of each experiment that is done, to its place in the order in which they were.
    """
    places: list[tuple[int, Query]] = []
    for query in queries:
        place = done.get(query.challenger.index)
        if place is not None and (query.incumbent is None or query.incumbent.index in done):
            places.append((-1 if query.further else place, query))
    return min(places, key=lambda found: found[0])[1] if places else None


@final
class ExperimentPool(Generic[R]):
    """The experiments of a study, `at_once` at the same time in an executor, or in this thread.

    They are known by θ, since the number of a pending sample changes until it is answered.
    """

    def __init__(self, run: Callable[[Theta], R], at_once: int, executor: Executor | None) -> None:
        self._run, self._at_once, self._executor = run, at_once, executor
        self._running: dict[bytes, Future[R]] = {}
        self._results: dict[bytes, R] = {}  # in the order in which they were ready
        self._landed: SimpleQueue[bytes] = SimpleQueue()
        self._started: Counter[bytes] = Counter()

    def next_of(self, agent: Any) -> tuple[Query, R, R | None]:
        """Return an open query and the results of both sides, after running what is missing."""
        # An agent that is run in this thread need not know of several queries.
        queries: list[Query] = [agent.ask()] if self._executor is None else agent.ask(self._at_once)
        sides = [s for q in queries for s in (q.incumbent, q.challenger) if s is not None]
        while (query := first_ready(queries, self._done(sides))) is None:
            for side in sides:
                self._start(side.theta)
            if self._running:
                self._collect(self._landed.get())
        challenger, incumbent = query.challenger, query.incumbent
        return query, self._of(challenger), None if incumbent is None else self._of(incumbent)

    def _of(self, side: Suggestion) -> R:
        return self._results[theta_key(side.theta)]

    def _done(self, sides: Iterable[Suggestion]) -> dict[int, int]:
        places = {key: place for place, key in enumerate(self._results)}
        keys = {side.index: theta_key(side.theta) for side in sides}
        return {index: places[key] for index, key in keys.items() if key in places}

    def _start(self, theta: Theta) -> None:
        key = theta_key(theta)
        if key in self._results or key in self._running:
            return
        if self._executor is None:
            self._results[key] = self._run(theta)
            return
        self._started[key] += 1
        try:
            self._running[key] = self._executor.submit(self._run, theta)
        except BrokenExecutor as error:  # it does not replace workers that died
            words = f"the workers of the experiments died: {_told(error)}"
            raise RunError(words, "died") from error
        self._running[key].add_done_callback(lambda _: self._landed.put(key))

    def _collect(self, key: bytes) -> None:
        future = self._running.pop(key)
        try:
            self._results[key] = future.result()
        except (BrokenExecutor, CancelledError) as error:
            if self._started[key] >= ATTEMPTS:
                words = f"the worker of an experiment died {ATTEMPTS} times: {_told(error)}"
                raise RunError(words, "died") from error


def _told(error: Exception) -> str:
    """Return the message of an error, or its kind if it has none."""
    return str(error) or type(error).__name__


# --- The loop of a study: ask, run, answer, tell. You can stop it after any answer.


def counts_as_unsafe(experiment: Experiment) -> bool:
    """Return whether a run was interrupted because it became unsafe; of several, one is enough.

    A failed run does not count: a broken cable, a full disk or a person who stops a run says
    nothing about θ, and a wrong mark keeps an agent away from a good place for the rest of the
    study. People who know better can mark the experiment, or enter a rig's record as unsafe.
    """
    return any(run.end is End.UNSAFE for run in (experiment, *experiment.runs))


def foregone(challenger: Experiment, incumbent: Experiment | None) -> Answer | None:
    """Return the answer that follows from the runs alone; None if somebody must be asked.

    The first experiment is compared with nothing. A run that was cut short has lost, which is why
    it was cut short.
    """
    if incumbent is None:
        return Answer(None)
    return Answer(Preference.INCUMBENT) if challenger.end is End.CUT_SHORT else None


def completed(
    answer: Answer, challenger: Experiment, incumbent: Experiment | None, outcomes: Outcomes | None = None
) -> Answer:
    """Return `answer` with `outcomes` and the marks that follow from how the two runs ended.

    Marks and outcomes that came with the answer are kept, and such marks are not automatic. Only
    "good enough" is dropped if the same side is unsafe. If the answer is undone or retracted, the
    added marks and outcomes go with it.

    Args:
        answer: Answer about the two experiments.
        challenger: Experiment of the challenger.
        incumbent: Experiment of the incumbent; None in the first query.
        outcomes: KPIs of both; None adds none.
    """
    found = tuple(mark for mark in _facts(challenger, incumbent) if mark not in answer.marks)
    if found:
        marks, automatic = (*answer.marks, *found), (*answer.automatic, *found)
        answer = replace(answer, marks=marks, automatic=automatic)
    for unsafe, good in (
        (Mark.CHALLENGER_UNSAFE, Mark.CHALLENGER_GOOD_ENOUGH),
        (Mark.INCUMBENT_UNSAFE, Mark.INCUMBENT_GOOD_ENOUGH),
    ):
        if {unsafe, good} <= {*answer.marks}:
            answer = replace(answer, marks=tuple(mark for mark in answer.marks if mark is not good))
    if outcomes is not None and answer.outcomes is None:
        answer = replace(answer, outcomes=outcomes)
    return answer


def _facts(challenger: Experiment, incumbent: Experiment | None) -> Iterator[Mark]:
    """Yield the marks that follow from how the two runs ended."""
    if counts_as_unsafe(challenger):
        yield Mark.CHALLENGER_UNSAFE
    if incumbent is not None and counts_as_unsafe(incumbent):
        yield Mark.INCUMBENT_UNSAFE
    if challenger.end is End.CUT_SHORT:
        yield Mark.CHALLENGER_CUT_SHORT


A = TypeVar("A")


class Step(NamedTuple, Generic[R, A]):
    """One turn of the loop: a closed query, the answer, and the results it is about.

    `incumbent` is None if nothing was compared: in the first query, and for an agent that
    learns from scores.
    """

    query: Query
    answer: A
    challenger: R
    incumbent: R | None

    @property
    def winner(self) -> R:
        """Preferred result; without a preference, the incumbent if there is one."""
        preferred = getattr(self.answer, "preference", None)
        if self.incumbent is None or preferred is Preference.CHALLENGER:
            return self.challenger
        return self.incumbent

    @property
    def winner_index(self) -> int:
        """Index of the winner's sample."""
        incumbent = self.query.incumbent
        wins = incumbent is None or self.winner is self.challenger
        return self.query.challenger.index if wins or incumbent is None else incumbent.index


Comparison = Step[Experiment, Answer]
"""A closed query with both experiments.

`incumbent` is None for the very first experiment, whose answer is an abstention.
"""


def ask_and_tell(
    agent: Any,
    run: Callable[[Float[np.ndarray, " n"]], R],
    answer: Callable[[R, R | None], A],
    *,
    at_once: int = 1,
    executor: Executor | None = None,
) -> Iterator[Step[R, A]]:
    """Drive any agent until it is done, yielding each step after the agent has the answer.

    With `at_once`, several experiments run while answers are given. They are asked about in the
    order in which they are ready, which alone decides what is proposed next. If a run raises an
    error, it is raised here, the agent keeps what is pending, and another loop continues with it.

    Args:
        agent: Agent of any kind, with `done`, `ask` and `tell`; it is changed. With `at_once`,
            `ask(n)` returns the open queries, as that of `Agent` does.
        run: Function that returns the result of a physical θ, shape (n,); called once for each
            experiment, but again if its worker died and the executor replaces it.
        answer: Function of the results of challenger and incumbent that returns what to tell the
            agent: an answer, or a score of the challenger.
        at_once: Number of experiments that run at the same time, 1 or more.
        executor: Executor that runs them, such as a `ProcessPoolExecutor`; it stays open. Threads
            if None, which suit runs that wait for another program.

    Raises:
        SettingsError: If `at_once` is not valid.
        RunError: If the worker of an experiment died twice, or a pool of processes broke.
    """
    with runs_of(run, at_once, executor) as runs:
        while not agent.done:
            query, challenger, incumbent = runs.next_of(agent)
            given = answer(challenger, incumbent)
            agent.tell(query, given)
            yield Step(query, given, challenger, incumbent)


def calibrate(
    agent: Agent,
    run: Callable[[Theta], Experiment],
    calibrator: Calibrator[Experiment],
    outcome: Callable[[Experiment], Mapping[str, float]] | None = None,
) -> Iterator[Comparison]:
    """Drive `agent` until it is done, yielding each comparison after the agent has the answer.

    An experiment that became unsafe is marked as unsafe, whatever the calibrator says; see
    `completed`. One that was cut short loses, and the calibrator is not asked.

    Args:
        agent: Agent that proposes θ; it is changed.
        run: Function that runs one experiment of a physical θ, shape (n,); called once for each θ.
        calibrator: Calibrator that compares challenger and incumbent.
        outcome: Function that returns the KPIs of an experiment by name, lower is better; the
            agent also learns from them. `tracking_kpis` works for any trajectory with a reference.

    Yields:
        The comparisons, `agent.n_max` of them, the first without an incumbent.
    """

    def answer(challenger: Experiment, incumbent: Experiment | None) -> Answer:
        said = foregone(challenger, incumbent)
        if said is None:
            assert incumbent is not None
            said = Answer.of(calibrator.prefer(challenger, incumbent))
        pair = None
        if outcome is not None and said.outcomes is None:
            pair = (outcome(challenger), None if incumbent is None else outcome(incumbent))
        return completed(said, challenger, incumbent, pair)

    return ask_and_tell(agent, run, answer)
