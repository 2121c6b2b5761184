"""The ask/tell protocol of every agent: its record, and the open query, made on demand."""

from contextlib import AbstractContextManager
from functools import cache
from typing import Any, ClassVar, Self, overload

import numpy as np
from jaxtyping import Float

from prefcal_agents.history.agent_state import AgentState, check_record
from prefcal_agents.optimize.search import Tried
from prefcal_agents.space.capacity import capacity
from prefcal_agents.space.start import Start, start_points
from prefcal_agents.support.checks import Settings
from prefcal_env.arrays import integer
from prefcal_env.errors import KnobError, ProtocolError, SettingsError
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.answer import Answer, Query, Suggestion
from prefcal_env.preferences.best import representative, undominated
from prefcal_env.preferences.history import History, Sample

Pair = tuple[int, int]
"""Two known samples to compare: the later one, which is the challenger, and the earlier one."""


class Agent:
    """An agent with its record of samples and answers, and the open query.

    A subclass defines what to try next in `_propose`, a function of the record (its seed and
    settings are fixed), so nothing else has to be saved. Linear algebra runs on one thread there.

    Sample h is proposed when it is first needed, from the record after answer h - 1. From then
    on it is stored and stays, even if an earlier answer is retracted, since its experiment may
    have run already. Only the incumbent that it is compared with may then change. `undo` reopens
    the last closed query and drops the sample proposed after it.

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

    version: ClassVar[int]
    """Version of the algorithm, raised when the same answers lead to another next sample."""
    options: ClassVar[type[Settings]] = Settings
    """Class of its further settings."""
    pickled: ClassVar[tuple[str, ...]] = ("_given", "history")
    """Names of what is pickled, besides the settings."""
    by_value = False
    """Whether the agent learns from scores, not preferences; then no query has an incumbent."""
    asks_further: ClassVar[bool] = True
    """Whether it asks questions about two known samples."""

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
        if not isinstance(space, KnobSpace):
            raise SettingsError(f"space must be a KnobSpace, got {space!r}")
        self._options: Any = self.options() if settings is None else settings
        if not isinstance(self._options, self.options):
            raise SettingsError(f"settings must be {self.options.__name__}, got {settings!r}")
        integer("n_init", n_init, low=1)
        integer("n_max", n_max, low=2)
        integer("seed", seed, low=0)
        if n_max < n_init:
            raise SettingsError(f"n_max must not be below n_init, got {n_max} below {n_init}")
        self.space, self.n_init, self._seed = space, int(n_init), int(seed)
        self._asked_for, self._capacity = int(n_max), capacity(space)
        self._given = start_points(space, start, self._asked_for)
        self._known_best: tuple[History, int | None] | None = None
        self._judged: History | None = None
        self._thought: tuple[History, Pair | None] | None = None
        self.history = History()

    # What a subclass defines.

    def _propose(self, history: History) -> Float[np.ndarray, " n"]:
        """Return the next sample, a point of the unit cube, shape (n,)."""
        raise NotImplementedError

    def _leader(self, history: History) -> int | None:
        """Return the sample to hold for the best; None if the answers alone say which it is."""
        return None

    def _follow_up(self, history: History) -> Pair | None:
        """Return known samples to compare before the next one is proposed; None if none."""
        return None

    def _final(self, history: History) -> Pair | None:
        """Return known samples to compare after the last experiment; None if none."""
        return None

    # What people and programs use.

    @property
    def n_max(self) -> int:
        """Return the number of experiments; fewer than asked for if the space holds fewer θ."""
        return self._most(self.history)

    def _most(self, history: History) -> int:
        most = self._capacity
        if most >= self._asked_for:
            return self._asked_for
        # θ that ran count even if they are no longer searched.
        most += sum(not self.space.searches(np.array(s.theta)) for s in history.samples)
        return int(min(self._asked_for, most))

    @property
    def done(self) -> bool:
        """Return whether all experiments are answered and it is clear which one is the best."""
        return self._all_answered and self._known_pair() is None

    @property
    def _all_answered(self) -> bool:
        return self.history.answered >= self.n_max

    @property
    def best(self) -> Float[np.ndarray, " n"]:
        """Return θ of the best sample, physical, shape (n,). Raises ProtocolError without one."""
        if self.best_index is None:
            raise ProtocolError("there is no best θ before the first answer")
        return self._theta_of(self.best_index)

    @property
    def best_index(self) -> int | None:
        """Return the index of the best sample; None before any answer. It may take simulations."""
        self._judge()
        return self.incumbent

    @property
    def incumbent(self) -> int | None:
        """Return the index of the best sample as far as it is known without simulations."""
        history = self.history
        if self._known_best is None or self._known_best[0] != history:
            self._known_best = (history, history.incumbent)
        return self._known_best[1]

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
        if n is None:
            return self._open(1)[0]
        integer("n", n, low=1)
        return self._open(int(n))

    def _open(self, n: int) -> list[Query]:
        """Return all open queries, with `n` experiments pending if a new one may be proposed."""
        if self.done:
            why = f"all {self.n_max} experiments are answered"
            if self.n_max < self._asked_for:
                why = f"every one of the {self.n_max} θ of the space has been tried"
            raise ProtocolError(f"there is no open query: {why}")
        pair, queries = self._known_pair(), []
        if pair is None:
            self._store(n)
        else:
            queries = [Query(self._suggestion(pair[0]), self._suggestion(pair[1]), further=True)]
        rival = None if self._rival is None else self._suggestion(self._rival)
        waiting = range(self.history.answered, len(self.history.samples))
        return [*queries, *(Query(self._suggestion(index), rival) for index in waiting)]

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
        if self.done:
            raise ProtocolError(f"told {query}, but all {self.n_max} experiments are answered")
        queries = self._open(1)
        if query not in queries:
            others = f", or one of {len(queries) - 1} others" if queries[1:] else ""
            raise ProtocolError(f"told {query}, but the open query is {queries[0]}{others}")
        new, old = query.challenger.index, query.incumbent
        if query.further:
            assert old is not None
            self.history = self.history.with_follow_up(given, new, old.index)
        else:
            self.take(new)
            self.history = self.history.with_answer(given, self._rival)

    def take(self, index: int) -> None:
        """Make pending sample `index` the next one; see `History.taken`.

        Raises:
            ProtocolError: If it is not pending.
        """
        self.history = self.history.arranged(self.history.taken(index))

    def undo(self) -> None:
        """Take the last answer back and open its query again. Raises ProtocolError if none."""
        self.history = self.history.undone()

    def retract(self, index: int, *, further: bool = False) -> None:
        """Stop learning from answer `index` (from 0); all samples stay, including the open one.

        Answers to follow-up questions (`further`) are numbered separately.

        Raises:
            ProtocolError: If there is no such answer, or it is already retracted.
        """
        changed = self.history.retracted(index, follow_up=further)
        if not self._all_answered:
            self.settle()
            changed = self.history.retracted(index, follow_up=further)
        self.history = changed

    def replace_pending(self, theta: Float[np.ndarray, " n"]) -> None:
        """Try physical `theta`, shape (n,), next instead of the proposed θ, which is free again.

        The next query compares it with the best sample; follow-up questions wait until then.

        Raises:
            ProtocolError: If all experiments are answered, or `theta` was tried before.
            KnobError: If the space does not hold it, or a constraint forbids it.
        """
        theta, answered = self.space.check_allowed(theta), self.history.answered
        if self._all_answered:
            raise ProtocolError(f"nothing can be tried: all {self.n_max} experiments are answered")
        same = np.flatnonzero(self.space.close(theta, self.samples))
        if len(same):
            raise ProtocolError(f"experiment {same[0] + 1} of {answered} was run with this θ")
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
        self.settle()
        return self._snapshot()

    @property
    def configuration(self) -> dict[str, Any]:
        """Return the settings as plain data, without what was learned; it proposes nothing."""
        return self._snapshot().configuration()

    @classmethod
    def restore(cls, space: KnobSpace, state: AgentState) -> Self:
        """Restore an agent from its saved `state`, with the identical next query.

        Raises:
            SettingsError: If it is the state of another agent, does not fit the space, or holds
                settings that the agent does not have.
        """
        agent = cls._made(space, state)
        history = state.history.bare()
        history = history.scores_alone() if agent.by_value else history
        check_record(history, space, agent._most(history), by_value=agent.by_value)
        try:
            thetas = [space.decode(np.array(z)) for z in state.start]
        except KnobError as error:
            raise SettingsError(f"the start of a state: {error}") from error
        agent._given = start_points(space, thetas, agent._asked_for)
        agent.history = history
        return agent

    def copy(self) -> Self:
        """Return an independent copy, used to prepare the next sample for each likely answer.

        Both share all that they hold: records are frozen, and the rest follows from a record.
        """
        twin = object.__new__(type(self))
        vars(twin).update(vars(self))
        return twin

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle settings, samples and answers: all else follows, solvers of others included."""
        kept = {name: getattr(self, name) for name in self.pickled}
        return type(self)._made, (self.space, self._snapshot()), kept

    def _settings(self) -> dict[str, Any]:
        """Return name and value of each further setting, plain data."""
        return dict(self._options.pairs())

    @classmethod
    def _arguments(cls, saved: dict[str, Any]) -> dict[str, Any]:
        """Return the constructor's arguments for what `_settings` returned."""
        settings = cls.options.of(saved)
        return {"settings": settings} if settings.pairs() else {}

    @classmethod
    def _made(cls, space: KnobSpace, state: AgentState) -> Self:
        """Return an agent with the settings of `state`, without its samples and answers."""
        if state.agent != cls.__name__:
            wanted = f"expected the state of {cls.__name__}"
            raise SettingsError(f"{wanted}, got that of {state.agent!r}")
        given = cls._arguments(dict(state.settings))
        return cls(space, n_init=state.n_init, n_max=state.n_max, seed=state.seed, **given)

    def _snapshot(self) -> AgentState:
        return AgentState(
            agent=type(self).__name__,
            version=self.version,
            n_init=self.n_init,
            n_max=self._asked_for,
            seed=self._seed,
            history=self.history,
            settings=tuple(self._settings().items()),
            start=self._given,
        )

    # How queries are made.

    def settle(self) -> None:
        """Find the best sample, and store that of the open query, unless none is needed now."""
        self._judge()
        # Asked first, since finding a pair may take simulations.
        if not self._all_answered and self._known_pair() is None:
            self._store()

    def _judge(self) -> None:
        """Let the agent say which sample it holds for the best, once after each answer.

        Once the next sample is proposed, its rival stays: it may be on show, and simulating for it
        would make a person wait.
        """
        history = self.history
        settled = history.waits or self._judged == history
        if self.by_value or not history.answered or settled:
            return
        with one_thread():
            leader = self._leader(history)
        if leader is not None:
            self.history = history.with_best(leader)
        self._judged = self.history

    def _store(self, n: int = 1) -> None:
        while len(self.history.samples) < min(self.history.answered + n, self.n_max):
            self.history = self.history.with_another(Sample.of(self.space, self._next()))

    def _known_pair(self) -> Pair | None:
        """Return the known samples to compare now; None once a new one is proposed.

        Open questions about the best sample come first, also after the last experiment.
        """
        self._judge()
        history = self.history
        known = history.answered and not history.waits
        if self.by_value or not self.asks_further or not known:
            return None
        if self._thought is None or self._thought[0] != history:
            with one_thread():
                pair = rematch(history)
                if pair is None:
                    ask = self._final if self._all_answered else self._follow_up
                    pair = ask(history)
            if pair is not None and history.cut_short() & {*pair}:
                pair = None  # half a run cannot be compared with a whole one
            self._thought = (history, pair)
        return self._thought[1]

    @property
    def _rival(self) -> int | None:
        return None if self.by_value else self.incumbent

    def _next(self) -> Float[np.ndarray, " n"]:
        """Return a given θ unchanged, a proposed one rounded to values that can be dialed in."""
        if len(self.history.samples) < len(self._given):
            return np.array(self._given[len(self.history.samples)])
        with one_thread():
            return self.space.snap(self._propose(self._supposed()))

    def _supposed(self) -> History:
        """Return the record as if nobody could tell how good pending experiments are.

        It is the record itself if none is pending. Other suppositions, such as the constant liar of
        Ginsbourger, Le Riche and Carraro (2010), are worse: docs/research/archive.md.
        """
        history, best = self.history, self.incumbent
        while history.pending is not None:
            history = history.with_answer(Answer(None), None)  # nobody looked at it
        return history if best is None else history.with_best(best)

    def _fresh(self, history: History, z: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Return `z`, shape (n,), or a random point if its θ ran already or is not allowed."""
        rng = np.random.default_rng([self._seed, history.answered])
        return Tried(self.space, history).fresh(z, rng)

    def _suggestion(self, index: int) -> Suggestion:
        return Suggestion(index, self._theta_of(index))

    def _theta_of(self, index: int) -> Float[np.ndarray, " n"]:
        return np.array(self.history.samples[index].theta)


class PreferenceBased(Agent):
    """An agent that learns from preferences."""


class ValueBased(Agent):
    """An agent that sees the score of every experiment: its queries have no incumbent."""

    by_value = True


def rematch(history: History) -> Pair | None:
    """Return the best sample and another unbeaten one; None if there is no other.

    As long as every new sample is compared with the best, only one stays unbeaten. A retraction or
    "can't tell" can leave two, which the next question then compares. A pair that the person
    cannot tell apart is not asked again; a pair whose answer was retracted is.
    """
    best, verdicts = history.by_answers, history.verdicts()
    if best is None:
        return None
    for group in undominated(verdicts, history.unsafe()):
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
