"""What every agent shares: settings, start, saved state, the record, and what is asked after it."""

from collections.abc import Collection, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, fields, replace
from functools import cache
from typing import Any, ClassVar, Generic, NamedTuple, Self, TypeVar, overload

import numpy as np
from jaxtyping import Float

from prefcal_env.arrays import integer
from prefcal_env.errors import KnobError, ProtocolError, SettingsError
from prefcal_env.knobs import KnobSpace, theta_key
from prefcal_env.plain import from_plain, to_plain
from prefcal_env.preferences.answer import Answer, Query, Suggestion
from prefcal_env.preferences.history import History, Sample, find_undominated, representative

from .lessons import Remembered
from .search import Tried, capacity

# --- Check and save settings; each error says the name, the value and what was expected.


@dataclass(frozen=True)
class Settings:
    """Base of an agent's settings, which are a frozen dataclass; this one has none."""

    __slots__ = ()

    def pairs(self) -> tuple[tuple[str, Any], ...]:
        """Return name and value of every setting, for an `AgentState`."""
        return tuple((f.name, getattr(self, f.name)) for f in fields(self))

    @classmethod
    def of(cls, saved: Mapping[str, Any]) -> Self:
        """Create settings from saved ones; a missing setting gets its default.

        Raises:
            SettingsError: If a setting is unknown or a value is not valid.
        """
        unknown = set(saved) - {f.name for f in fields(cls)}
        if unknown:
            agent = cls.__name__.removesuffix("Settings")
            raise SettingsError(f"{agent} has no settings called {sorted(unknown)}")
        return cls(**saved)


def choice(name: str, value: Any, options: Collection[str]) -> None:
    """Raise SettingsError unless `value` is one of `options`."""
    if not isinstance(value, str) or value not in options:
        raise SettingsError(f"{name} must be one of {sorted(options)}, got {value!r}")


# --- Use θ that a person already has, such as the current tuning, as the first samples.

Points = tuple[tuple[float, ...], ...]  # points of the cube, each of length n
Start = Sequence[Float[np.ndarray, " n"]] | Sequence[Sequence[float]] | Sequence[float] | np.ndarray
"""One physical θ, shape (n,), or several."""


def start_points(space: KnobSpace, start: Start | None, n_max: int) -> Points:
    """Return the θ in `start` as points of the cube, in order, each of length n.

    They replace the first samples of the initial design.

    Args:
        start: One physical θ, shape (n,), or several; None or empty for no warm start.

    Raises:
        KnobError: If a θ is not in `space`; the message names the knob, the value and its unit.
        SettingsError: If a θ is given twice, or there are more θ than experiments.
    """
    if start is None:
        return ()
    if isinstance(start, str) or not isinstance(start, (Sequence, np.ndarray)):
        raise SettingsError(f"start must be one or more physical θ, got {start!r}")
    if len(start) == 0:
        return ()
    thetas = [start] if isinstance(start[0], (int, float, np.number)) else list(start)
    if len(thetas) > n_max:
        raise SettingsError(f"start must not hold more θ than n_max {n_max}, got {len(thetas)}")
    points: dict[bytes, tuple[float, ...]] = {}
    for number, theta in enumerate(thetas, start=1):
        try:
            z = space.encode(space.check_allowed(np.array(theta, dtype=float)))
        except (TypeError, ValueError, KnobError) as error:
            which = f"start θ {number}" if len(thetas) > 1 else "start"
            raise KnobError(f"{which}: {error}") from error
        key = theta_key(space.decode(z))
        if key in points:
            raise SettingsError(
                f"start must not hold one θ twice: number {number} is {space.decode(z)} again"
            )
        points[key] = tuple(map(float, z))
    return tuple(points.values())


SettingsT = TypeVar("SettingsT")


@dataclass(frozen=True, slots=True)
class Setup(Generic[SettingsT]):
    """Everything that an agent's proposals follow from, besides the record.

    Raises:
        SettingsError: If a value is not valid.
    """

    space: KnobSpace  # knobs to tune
    n_init: int  # number of samples of the space-filling start, 1 or more
    seed: int  # seed of all randomness, 0 or more; sample i draws from `(seed, i)`
    settings: SettingsT  # further settings of the agent
    n_max: int = 50  # number of experiments asked for, 2 or more, and not below `n_init`
    start: Points = ()  # points of the cube that replace the first proposed samples, each of length n

    def __post_init__(self) -> None:
        if not isinstance(self.space, KnobSpace):
            raise SettingsError(f"space must be a KnobSpace, got {self.space!r}")
        for name, low in (("n_init", 1), ("n_max", 2), ("seed", 0)):
            # numpy's integers are taken, too, but JSON and the state of an agent know those of Python only.
            value: Any = getattr(self, name)
            integer(name, value, low=low)
            object.__setattr__(self, name, int(value))
        if self.n_max < self.n_init:
            raise SettingsError(f"n_max must not be below n_init, got {self.n_max} below {self.n_init}")


# --- Save the whole state of an agent as plain data that JSON keeps exactly.

_SAME_PLACE = 1e-6  # maximum difference of θ and the θ of z in a saved sample, as a share of a knob's range


@dataclass(frozen=True, slots=True)
class AgentState:
    """Everything that determines an agent's next query, apart from the knob space.

    Args:
        agent: Name of its class.
        version: Version of its algorithm. A newer version keeps the samples and continues.
        n_init: Number of samples of the space-filling start.
        n_max: Number of experiments after which the agent is done.
        seed: Seed of all its randomness.
        history: Answers and stored samples, including the sample of the open query.
        settings: Name and value of each further setting.
        start: Points of the cube, for θ that were given as the first samples.
    """

    agent: str
    version: int
    n_init: int
    n_max: int
    seed: int
    history: History
    settings: tuple[tuple[str, Any], ...] = ()
    start: tuple[tuple[float, ...], ...] = ()

    @classmethod
    def of_setup(cls, agent: str, version: int, setup: Setup[Any], history: History) -> "AgentState":
        """Return the state of an agent with this setup after `history`."""
        counts = setup.n_init, setup.n_max, setup.seed
        return cls(agent, version, *counts, history, setup.settings.pairs(), setup.start)

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON, which restores every float exactly."""
        return {**self.configuration(), "history": to_plain(self.history)}

    def configuration(self) -> dict[str, Any]:
        """Return the parts that do not change with samples and answers, as plain data for JSON."""
        kept = ("agent", "version", "n_init", "n_max", "seed")
        return {
            **{name: getattr(self, name) for name in kept},
            "settings": {name: _plain(value) for name, value in self.settings},
            **({"start": _plain(self.start)} if self.start else {}),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> "AgentState":
        """Read the data that `to_dict` returned.

        Raises:
            SettingsError: If something is missing or malformed.
        """
        if "history" not in data:
            raise SettingsError("the state of an agent lacks its history: resume the study's file instead")
        history = from_plain(data["history"], History, SettingsError, "the state of an agent")
        return cls.of(data, history)

    @classmethod
    def of(cls, configuration: Mapping[str, Any], history: History) -> "AgentState":
        """Return the state of an agent from what `configuration` returned, after `history`.

        Raises:
            SettingsError: If something is missing or malformed.
        """
        try:
            return cls(
                agent=configuration["agent"],
                version=configuration["version"],
                n_init=configuration["n_init"],
                n_max=configuration["n_max"],
                seed=configuration["seed"],
                history=history,
                settings=tuple((k, _frozen(v)) for k, v in configuration["settings"].items()),
                start=tuple(tuple(map(float, z)) for z in configuration.get("start", ())),
            )
        except (KeyError, TypeError, AttributeError, ValueError) as error:
            words = f"{type(error).__name__} {error}"
            raise SettingsError(f"the state of an agent cannot be read: {words}") from error


def check_record(history: History, space: KnobSpace, most: int, *, by_value: bool) -> None:
    """Raise SettingsError unless `history` can be that of an agent of up to `most` experiments."""
    answered, stored = history.answered, len(history.samples)
    for h, c in enumerate(history.comparisons):
        alone = h == 0 or by_value
        if c.challenger != h:
            raise SettingsError(f"answer {h} of a state cannot be about sample {c.challenger}")
        if (c.incumbent is None) != alone or not -1 < (c.incumbent or 0) < max(h, 1):
            raise SettingsError(f"answer {h} of a state cannot be against sample {c.incumbent}")
    for c in history.follow_ups:
        pair, after = {c.challenger, c.incumbent}, range(c.after or 0)
        if len(after) > answered or by_value or len(pair) < 2 or not pair <= {*after}:
            raise SettingsError(f"a follow-up answer of a state cannot be {c}")
    for lead in history.leads:
        if not (0 <= lead.index < answered and 0 < lead.after <= history.given):
            raise SettingsError(f"the best one of a state cannot be {lead}")
    for index, sample in enumerate(history.samples):
        _check_sample(index, sample, space)
        # A sample cannot follow from more answers than were given, or than samples came before.
        if not 0 <= (sample.after or 0) <= min(index, answered):
            raise SettingsError(f"sample {index} of a state cannot be after {sample.after} answers")
    if not answered <= stored <= most:
        raise SettingsError(
            f"a state of up to {most} experiments cannot hold {stored} samples and {answered} answers"
        )


def _check_sample(index: int, sample: Sample, space: KnobSpace) -> None:
    try:
        theta = space.check_allowed(np.array(sample.theta))
        there = space.decode(np.array(sample.z))
    except KnobError as error:
        raise SettingsError(f"sample {index} of a state: {error}") from error
    # A state has both z and θ, and decoding rounds, so a share of the range is allowed.
    span = np.array([knob.high - knob.low for knob in space])
    if np.any(np.abs(there - theta) > _SAME_PLACE * span):
        raise SettingsError(f"sample {index} of a state: z and theta are not the same place, got {sample}")


def _plain(value: Any) -> Any:
    return [_plain(v) for v in value] if isinstance(value, tuple) else value


def _frozen(value: Any) -> Any:
    return tuple(_frozen(v) for v in value) if isinstance(value, list) else value


# --- What is asked after a record.

Pair = tuple[int, int]
"""Two known samples to compare: the later one, which is the challenger, and the earlier one."""


class Turn(NamedTuple):
    """What is decided after a record, before anything new is proposed."""

    history: History  # the record with the sample that the agent holds for the best
    pair: Pair | None  # known samples to compare now; None if there are none
    best: int | None  # index of the best sample; None before the first answer
    queries: tuple[Query, ...]  # a query for each pending sample, which is compared with the best one
    over: bool  # whether all experiments are answered and it is clear which one is the best


class Strategy:
    """What is asked after a record: a function of space, settings, seed and the record alone.

    A kind of agent defines `propose`, a function of the record and of `setup` (space, seed,
    settings), so nothing else has to be saved; linear algebra runs on one thread there. It may
    define more functions of the record: `question`, about two known samples, and `_leader`, the
    best one. What they return is remembered by the record: memory only saves time.

    Arguments and errors are those of `Agent`.
    """

    version: ClassVar[int]
    """Version of the algorithm, raised when the same answers lead to another next sample."""
    options: ClassVar[type[Settings]] = Settings  # class of its further settings
    by_value: ClassVar[bool] = False
    """Whether the agent learns from scores, not preferences; then no query has an incumbent."""
    paced: ClassVar[bool] = False
    """Whether it can ask several comparisons for each experiment, see `GLISp.with_questions`."""

    def __init__(
        self,
        space: KnobSpace,
        *,
        n_init: int = 10,
        n_max: int = 50,
        seed: int = 0,
        start: Start | None = None,
        settings: Any = None,
    ) -> None:
        # A class of settings is the agent's own: those of another would silently lack what it reads.
        given = self.options() if settings is None else settings
        if not isinstance(given, self.options):
            raise SettingsError(f"settings must be {self.options.__name__}, got {settings!r}")
        setup = Setup(space, n_init, seed, given, n_max)
        self._begin(replace(setup, start=start_points(space, start, setup.n_max)))

    def _begin(self, setup: Setup[Any]) -> None:
        """Take over a setup; all else follows from it."""
        self.setup = setup
        self._capacity = capacity(setup.space)
        self._forget()
        self._prepare()

    def _forget(self) -> None:
        """Forget what followed from records, since it would be something else now."""
        self.turn = Remembered(self._decide)
        """What is decided after a record, see `Turn`."""
        self._next = Remembered(self._new_sample)

    # What an agent defines: functions of a record.

    def propose(self, history: History) -> Float[np.ndarray, " n"]:
        """Return the next sample, a point of the unit cube, shape (n,).

        It is rounded to what can be dialed in. If its θ ran already or is not allowed, a random one
        takes its place.
        """
        raise NotImplementedError

    def question(self, history: History) -> Pair | None:
        """Return known samples to compare before anything new is proposed; None if none."""
        return rematch(history)

    def _leader(self, history: History) -> int | None:
        """Return the sample to hold for the best; None if the answers alone say which it is."""
        return None

    def remember(self, history: History) -> bytes:
        """Return what took long to learn from `history`, for `recall`; empty if nothing does."""
        return b""

    def recall(self, learned: bytes) -> None:
        """Use what `remember` of the same settings returned, as far as the record is the same."""

    def _prepare(self) -> None:
        """Load what proposals need, and make what remembers them."""

    # What is open after a record: pure functions, remembered.

    def _decide(self, history: History) -> Turn:
        """Say which sample is the best, and which known ones to compare.

        Once the next sample is proposed, its rival stays and nothing else is asked: it may be on
        show, and simulating for it would make a person wait.
        """
        if self.by_value or not history.answered or history.waits:
            return self._turn_of(history, None)
        with one_thread():
            leader = self._leader(history)
            history = history if leader is None else history.with_best(leader)
            pair = self.question(history)
        if pair is not None and history.cut_short & {*pair}:
            pair = None  # half a run cannot be compared with a whole one
        return self._turn_of(history, pair)

    def _turn_of(self, history: History, pair: Pair | None) -> Turn:
        best = self._learned(history).incumbent
        # An agent that learns from scores compares nothing, so nobody is asked.
        rival = None if best is None or self.by_value else _suggestion(history, best)
        waiting = range(history.answered, len(history.samples))
        queries = tuple(Query(_suggestion(history, index), rival) for index in waiting)
        return Turn(history, pair, best, queries, pair is None and history.answered >= self._most(history))

    def _new_sample(self, history: History) -> Sample:
        """Return a given θ unchanged, a proposed one rounded to values that can be dialed in."""
        space, count = self.setup.space, len(history.samples)
        if count < len(self.setup.start):
            return Sample.of(space, np.array(self.setup.start[count]))
        past = suppose(self._learned(history))
        with one_thread():
            z, tried = self.propose(past), Tried(space, past)
            sample = Sample.of(space, space.snap(z))
            # Rounding can bring a new point to a θ that ran, or across a constraint.
            if tried.is_free(np.array(sample.theta)):
                return sample
            rng = np.random.default_rng([self.setup.seed, past.answered])
            return Sample.of(space, space.snap(tried.fresh(z, rng)))

    def knows(self, history: History) -> bool:
        """Return whether it is remembered what is asked after `history`, so that it takes no time."""
        if history.pending is not None or history not in self.turn:
            return history.pending is not None
        turn = self.turn(history)
        return turn.over or turn.pair is not None or turn.history in self._next

    def _learned(self, history: History) -> History:
        """Return what is learned from: a study file also has what each score was compared with."""
        return history.scores_alone() if self.by_value else history

    def has_enough(self, history: History) -> bool:
        """Return whether a person may as well stop after `history`; no if the agent cannot tell."""
        return False

    def open(self, turn: Turn, n: int = 1) -> tuple[History, list[Query]]:
        """Return what is asked at a `turn`: the record with all it is asked about, and queries.

        The same record gives the same, whatever was asked before. See `ask`.

        Raises:
            ProtocolError: If all experiments are answered.
        """
        history, most = turn.history, self._most(turn.history)
        if turn.pair is not None:
            new, old = (_suggestion(history, index) for index in turn.pair)
            return history, [Query(new, old, further=True), *turn.queries]
        if turn.over:
            why = f"all {most} experiments are answered"
            if most < self.setup.n_max:
                why = f"every one of the {most} θ of the space has been tried"
            raise ProtocolError(f"there is no open query: {why}")
        # One after the other: each pending sample keeps the next ones away from it.
        for _ in range(len(history.samples), min(history.answered + n, most)):
            history = history.with_another(self._next(history))
        return history, list((turn if history is turn.history else self.turn(history)).queries)

    def _most(self, history: History) -> int:
        """Return the number of experiments; fewer than asked for if the space holds fewer θ."""
        most, asked_for = self._capacity, self.setup.n_max
        if most >= asked_for:
            return asked_for
        # θ that ran count even if they are no longer searched.
        most += sum(not self.space.searches(np.array(s.theta)) for s in history.samples)
        return int(min(asked_for, most))

    @property
    def space(self) -> KnobSpace:
        """Return the knobs to tune."""
        return self.setup.space

    @property
    def configuration(self) -> dict[str, Any]:
        """Return the settings as plain data, without what was learned; it proposes nothing."""
        return self._state(History()).configuration()

    def _state(self, history: History) -> AgentState:
        return AgentState.of_setup(type(self).__name__, self.version, self.setup, history)


class Agent(Strategy):
    """A strategy with the record of a study, which is all that changes; the same for all agents.

    Sample h is proposed when it is first needed, from the record after answer h - 1. From then on
    it is stored and stays, even if an earlier answer is retracted, since its experiment may have
    run already. Only the incumbent that it is compared with may then change. `undo` reopens the
    last closed query and drops the sample proposed after it.

    Several experiments can be pending, see `ask`. Each is proposed as if nobody could tell how good
    the ones before it are; that they were tried keeps them apart. They can be answered in any
    order, which is the order of their numbers in the record.

    Args:
        space: Knobs to tune.
        n_init: Number of samples of the space-filling start, 1 or more.
        n_max: Number of experiments asked for, not below `n_init`.
        seed: Seed of all randomness, 0 or more.
        start: Physical θ to start from, such as the current tuning, shape (n,), or several. They
            replace the first proposed samples.
        settings: All other settings, of the class `options`; None for its defaults.

    Raises:
        SettingsError: If a value is not valid, or a θ is in `start` twice.
        KnobError: If a θ of `start` is outside the space.
    """

    history = History()
    """Samples and answers; a change replaces it by another one."""

    @property
    def n_max(self) -> int:
        """Return the number of experiments; fewer than asked for if the space holds fewer θ."""
        return self._most(self.history)

    @property
    def done(self) -> bool:
        """Return whether all experiments are answered and it is clear which one is the best."""
        return self.turn(self.history).over

    @property
    def best(self) -> Float[np.ndarray, " n"]:
        """Return θ of the best sample, physical, shape (n,). Raises ProtocolError without one."""
        index = self.best_index
        if index is None:
            raise ProtocolError("there is no best θ before the first answer")
        return np.array(self.history.samples[index].theta)

    @property
    def best_index(self) -> int | None:
        """Return the index of the best sample; None before any answer. It may take simulations."""
        return self.turn(self.history).best

    @property
    def samples(self) -> Float[np.ndarray, "N n"]:
        """Return θ of all answered queries, physical, in the order tried, shape (N, n)."""
        tried = [sample.theta for sample in self.history.samples[: self.history.answered]]
        return np.array(tried, dtype=float).reshape(-1, len(self.space))

    @overload
    def ask(self) -> Query: ...

    @overload
    def ask(self, n: int) -> list[Query]: ...

    def ask(self, n: int | None = None) -> Query | list[Query]:
        """Return the open query, the same until it is answered, or all, to run several at once.

        Args:
            n: Number of experiments that should be pending, 1 or more; fewer if fewer are left.
                The list has a query for each of them, and any of them can be answered next. A
                query about two experiments that have run comes first; nothing new is proposed
                until it is answered. Ask again after each answer, since the best one may change.

        Raises:
            ProtocolError: When done.
            SettingsError: If `n` is not valid.
        """
        if n is not None:
            integer("n", n, low=1)
        self.history, queries = self.open(self.turn(self.history), 1 if n is None else int(n))
        return queries[0] if n is None else queries

    def tell(self, query: Query, answer: Any, /) -> None:
        """Close `query`.

        Args:
            query: An open query.
            answer: -1 if the challenger is better, 1 if the incumbent is, 0 for a tie, None for
                "can't tell", or an `Answer`; for a value-based agent the score of the experiment,
                lower is better, or None if it has none.

        Raises:
            ProtocolError: If it is not open.
            PreferenceError: If the answer is not valid.
        """
        given = Answer.scored(answer) if self.by_value else Answer.of(answer)
        try:
            # An agent that was just restored has not asked yet; the same record gives the same query.
            history, queries = self.open(self.turn(self.history))
        except ProtocolError as over:
            raise ProtocolError(f"told {query}, but all {self.n_max} experiments are answered") from over
        if query not in queries:
            others = f", or one of {len(queries) - 1} others" if queries[1:] else ""
            raise ProtocolError(f"told {query}, but the open query is {queries[0]}{others}")
        new, old = query.challenger.index, query.incumbent
        if query.further and old is not None:
            self.history = history.with_follow_up(given, new, old.index)
        else:
            history = history.arranged(history.taken(new))
            self.history = history.with_answer(given, None if old is None else old.index)

    def undo(self) -> None:
        """Take the last answer back and open its query again. Raises ProtocolError if none."""
        self.history = self.history.undone()

    def retract(self, index: int, *, further: bool = False) -> None:
        """Stop learning from answer `index` (from 0); all samples stay, including the open one.

        Answers to follow-up questions (`further`) are numbered separately.

        Raises:
            ProtocolError: If there is no such answer, or it is already retracted.
        """
        changed = self.history.retracted(index, follow_up=further)  # before anything is proposed
        if self.history.answered < self.n_max:
            # The open sample is fixed first: its experiment may be running, and must not become another one.
            changed = self._settle().retracted(index, follow_up=further)
        self.history = changed

    def replace_pending(self, theta: Float[np.ndarray, " n"]) -> None:
        """Try physical `theta`, shape (n,), next instead of the proposed θ, which is free again.

        The next query compares it with the best sample; follow-up questions wait until then.

        Raises:
            ProtocolError: If all experiments are answered, or `theta` was tried before.
            KnobError: If the space does not hold it, or a constraint forbids it.
        """
        theta, answered = self.space.check_allowed(theta), self.history.answered
        if answered >= self.n_max:
            raise ProtocolError(f"nothing can be tried: all {self.n_max} experiments are answered")
        same = np.flatnonzero(self.space.close(theta, self.samples))
        if len(same):
            raise ProtocolError(f"experiment {same[0] + 1} of {answered} was run with this θ")
        # The first pending sample is the one that is replaced; the others keep theirs.
        others = [s.theta for s in self.history.samples[answered + 1 :]]
        if others and self.space.close(theta, np.array(others)).any():
            raise ProtocolError("another pending experiment has this θ")
        z = self.space.encode(theta)
        sample = Sample(tuple(map(float, z)), tuple(map(float, theta)))
        self.history = self.history.with_pending(sample)

    # Saved states and copies.

    @property
    def state(self) -> AgentState:
        """Return everything that has to be saved, including the sample of the open query."""
        self.history = self._settle()
        return self._state(self.history)

    def _settle(self) -> History:
        """Return the record with what is decided after it, so that it no longer changes."""
        turn = self.turn(self.history)
        return turn.history if turn.over or turn.pair is not None else self.open(turn)[0]

    @classmethod
    def restore(cls, space: KnobSpace, state: AgentState) -> Self:
        """Restore an agent from its saved `state`, with the identical next query.

        Raises:
            SettingsError: If it is the state of another agent, does not fit the space, or holds
                settings that the agent does not have.
        """
        if state.agent != cls.__name__:
            raise SettingsError(f"expected the state of {cls.__name__}, got that of {state.agent!r}")
        setup = Setup(space, state.n_init, state.seed, cls.options.of(dict(state.settings)), state.n_max)
        try:
            thetas = [space.decode(np.array(z)) for z in state.start]
        except KnobError as error:
            raise SettingsError(f"the start of a state: {error}") from error
        # Not by the constructor: its arguments differ between agents, and the state has what became of them.
        agent = object.__new__(cls)
        agent._begin(replace(setup, start=start_points(space, thetas, setup.n_max)))
        agent.history = state.history
        check_record(agent._learned(agent.history), space, agent.n_max, by_value=cls.by_value)
        return agent

    def copy(self) -> Self:
        """Return an independent copy, used to prepare the next sample for each likely answer.

        Both share all that they hold, also what one of them works out later: records are frozen, and
        the rest follows from a record.
        """
        twin = object.__new__(type(self))
        vars(twin).update(vars(self))
        return twin

    def __getstate__(self) -> dict[str, Any]:
        """Pickle setup, record and simulations: all else follows, solvers of others included."""
        kept = ("setup", "history", "_simulations")
        return {name: vars(self)[name] for name in kept if name in vars(self)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._begin(self.setup)


def _suggestion(history: History, index: int) -> Suggestion:
    return Suggestion(index, np.array(history.samples[index].theta))


def suppose(history: History) -> History:
    """Return the record as if nobody could tell how good pending experiments are.

    It is the record itself if none is pending. Other suppositions, such as the constant liar of
    Ginsbourger, Le Riche and Carraro (2010), are worse: docs/research/archive.md.
    """
    if history.pending is None:
        return history
    best = history.incumbent
    while history.pending is not None:
        history = history.with_answer(Answer(None), None)  # nobody looked at it
    return history if best is None else history.with_best(best)


def rematch(history: History) -> Pair | None:
    """Return the best sample and another unbeaten one; None if there is no other.

    As long as every new sample is compared with the best, only one stays unbeaten. A retraction or
    "can't tell" can leave two, which the next question then compares. A pair that the person
    cannot tell apart is not asked again; a pair whose answer was retracted is.
    """
    best, verdicts = history.by_answers, history.verdicts()
    if best is None:
        return None
    for group in find_undominated(verdicts, history.unsafe):
        rival = representative(verdicts, group)
        if best not in group and not history.asked(best, rival, standing=True):
            return max(best, rival), min(best, rival)
    return None


@cache
def _threads() -> Any:
    # It inspects all loaded libraries, so run it once, after numpy's and scipy's are loaded.
    import scipy.linalg  # noqa: F401
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


def one_thread() -> AbstractContextManager[Any]:
    """Return a context in which linear algebra of numpy and scipy uses one thread.

    With 50 samples, two threads take 3 to 4 times as long.
    """
    limit: AbstractContextManager[Any] = _threads().limit(limits=1, user_api="blas")
    return limit
