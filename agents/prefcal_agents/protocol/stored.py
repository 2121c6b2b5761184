"""Save, restore and copy any agent."""

from typing import Any, ClassVar, Protocol, Self

from prefcal_agents.history.agent_state import AgentState
from prefcal_env.errors import SettingsError
from prefcal_env.knobs.knob import KnobSpace

from .session import Session


class Stored(Protocol):
    """Give an agent `state`, `restore` and `copy`.

    The agent is made as `Agent(space, n_init=..., n_max=..., seed=..., **settings)`, keeps its
    `_session` and `_seed`, and names its further settings in `_settings`.
    """

    version: ClassVar[int]
    """Version of the algorithm, raised when the same answers would lead to another next sample."""
    _session: Session
    _seed: int

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
            SettingsError: it is the state of another agent, does not fit the space, or holds
                settings that the agent does not have.
        """
        agent = cls._made(space, state)
        agent._session.load(state.history, state.start)
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
        self._session.settle()
        return self._snapshot()

    def _snapshot(self) -> AgentState:
        pairs = tuple(self._settings().items())
        return self._session.state(type(self).__name__, self.version, self._seed, pairs)

    def copy(self) -> Self:
        """Return an independent copy, for computing ahead on each likely answer."""
        return self._twin(self._snapshot())

    def _twin(self, state: AgentState) -> Self:
        """Return an agent with the settings of `state` and the samples and answers of this one."""
        # These samples were checked before; checking them again would take most of the time.
        twin = self._made(self._session.space, state)
        twin._session.follow(self._session)
        return twin
