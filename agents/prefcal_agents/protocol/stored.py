"""Save, restore and copy any agent."""

from typing import Any, ClassVar, Protocol, Self

import numpy as np

from prefcal_agents.history.agent_state import AgentState
from prefcal_agents.space.start import start_points
from prefcal_env.errors import KnobError, SettingsError
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.history import History, Sample

_SAME_PLACE = 1e-6
"""Maximum difference of θ and the θ of z in a saved sample, as a share of a knob's range."""


class Stored(Protocol):
    """Give an agent `state`, `restore` and `copy`.

    The agent is made as `Agent(space, n_init=..., n_max=..., seed=..., **settings)` and names its
    further settings in `_settings`.
    """

    version: ClassVar[int]
    """Version of the algorithm, raised when the same answers lead to another next sample."""
    by_value: bool
    space: KnobSpace
    n_init: int
    history: History
    _asked_for: int
    _seed: int
    _given: tuple[tuple[float, ...], ...]

    def settle(self) -> None:
        """Store the sample of the open query, unless none is needed now."""

    def _most(self, history: History) -> int:
        """Return the number of experiments after `history`."""

    def _settings(self) -> dict[str, Any]:
        """Return name and value of each further setting, plain data; none unless overridden."""
        return {}

    @classmethod
    def _arguments(cls, saved: dict[str, Any]) -> dict[str, Any]:
        """Return the constructor's arguments for `saved` settings, themselves unless overridden."""
        return saved

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
        _check(history, agent)
        try:
            thetas = [space.decode(np.array(z)) for z in state.start]
        except KnobError as error:
            raise SettingsError(f"the start of a state: {error}") from error
        agent._given = start_points(space, thetas, agent._asked_for)
        agent.history = history
        return agent

    @classmethod
    def _made(cls, space: KnobSpace, state: AgentState) -> Self:
        """Return an agent with the settings of `state`, without its samples and answers."""
        state.check(cls.__name__)
        make: Any = cls
        counts = {"n_init": state.n_init, "n_max": state.n_max, "seed": state.seed}
        settings = cls._arguments(dict(state.settings))
        try:
            agent: Self = make(space, **counts, **settings)
        except TypeError as error:  # an argument that the agent does not have
            raise SettingsError(f"a state does not fit {cls.__name__}: {error}") from error
        return agent

    @property
    def state(self) -> AgentState:
        """Return everything that has to be saved, including the sample of the open query."""
        self.settle()
        return self._snapshot()

    @property
    def configuration(self) -> dict[str, Any]:
        """Return the settings as plain data, without what was learned; it proposes nothing."""
        return self._snapshot().configuration()

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

    def copy(self) -> Self:
        """Return an independent copy, used to prepare the next sample for each likely answer."""
        return self._twin(self._snapshot())

    def _twin(self, state: AgentState) -> Self:
        """Return an agent with the settings of `state` and the samples and answers of this one."""
        # These samples were checked before; checking them again would take most of the time.
        twin = self._made(self.space, state)
        twin._given, twin.history = self._given, self.history
        return twin

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle settings, samples and answers: all else follows, solvers of others included."""
        kept = {"_given": self._given, "history": self.history}
        return type(self)._made, (self.space, self._snapshot()), kept


def _check(history: History, agent: Stored) -> None:
    """Raise SettingsError unless `history` can be that of `agent`."""
    answered = history.answered
    for h, comparison in enumerate(history.comparisons):
        rival = comparison.incumbent
        alone = h == 0 or agent.by_value
        if (rival is None) != alone or (rival is not None and not 0 <= rival < h):
            raise SettingsError(f"answer {h} of a state cannot be against sample {rival}")
    for c in history.follow_ups:
        pair = {c.challenger, c.incumbent}
        known = c.after is not None and 0 < c.after <= answered and not agent.by_value
        if not known or len(pair) < 2 or any(i is None or not 0 <= i < c.after for i in pair):  # type: ignore[operator]
            raise SettingsError(f"a follow-up answer of a state cannot be {c}")
    for lead in history.leads:
        if not (0 <= lead.index < answered and 0 < lead.after <= history.given):
            raise SettingsError(f"the best one of a state cannot be {lead}")
    for index, sample in enumerate(history.samples):
        _check_sample(index, sample, agent.space)
        if sample.after is not None and not 0 <= sample.after <= min(index, answered):
            raise SettingsError(f"sample {index} of a state cannot be after {sample.after} answers")
    stored, most = len(history.samples), agent._most(history)
    if not answered <= stored <= most:
        raise SettingsError(
            f"a state of up to {most} experiments cannot hold {stored} samples and "
            f"{answered} answers"
        )


def _check_sample(index: int, sample: Sample, space: KnobSpace) -> None:
    try:
        theta = space.check_allowed(np.array(sample.theta))
        there = space.decode(np.array(sample.z))
    except KnobError as error:
        raise SettingsError(f"sample {index} of a state: {error}") from error
    span = np.array([knob.high - knob.low for knob in space])
    if np.any(np.abs(there - theta) > _SAME_PLACE * span):
        raise SettingsError(
            f"sample {index} of a state: z and theta are not the same place, got {sample}"
        )
