"""Saving, restoring and copying, for agents whose settings are arguments of their constructor."""

from typing import Any, ClassVar, Protocol, Self

from prefcal_env.errors import SettingsError
from prefcal_env.knobs import KnobSpace

from .state import AgentState
from .turns import Turns


class Stored(Protocol):
    """Gives an agent `state`, `restore` and `copy`.

    The agent is made as `Agent(space, n_init=..., n_max=..., seed=..., **settings)`, keeps its
    `_turns` and `_seed`, and names its further settings in `_settings`.
    """

    version: ClassVar[int]
    """Of the algorithm: raised when the same answers would lead to another next sample."""
    _turns: Turns
    _seed: int

    def _settings(self) -> dict[str, Any]:
        """Name and value of each further argument, plain data; none unless overridden."""
        return {}

    @classmethod
    def restore(cls, space: KnobSpace, state: AgentState) -> Self:
        """Carry on from `state`, with the identical next query.

        Raises:
            SettingsError: it is the state of another agent, or does not fit the space.
        """
        state.check(cls.__name__)
        make: Any = cls
        counts = {"n_init": state.n_init, "n_max": state.n_max, "seed": state.seed}
        try:
            agent: Self = make(space, **counts, **dict(state.settings))
        except TypeError as error:  # an argument that the agent does not have
            raise SettingsError(f"a state does not fit {cls.__name__}: {error}") from error
        agent._turns.load(state.ledger)
        return agent

    @property
    def state(self) -> AgentState:
        """Everything that has to be saved; the sample of the open query is among it."""
        self._turns.settle()
        return self._snapshot()

    def _snapshot(self) -> AgentState:
        pairs = tuple(self._settings().items())
        return self._turns.state(type(self).__name__, self.version, self._seed, pairs)

    def copy(self) -> Self:
        """Return an independent twin, for running ahead on each likely answer."""
        return self.restore(self._turns.space, self._snapshot())
