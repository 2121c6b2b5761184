"""What all agents share that simulate θ unseen."""

from collections.abc import Mapping
from typing import Any, Self

from prefcal_agents.history.agent_state import AgentState
from prefcal_agents.protocol.agent import PreferenceBased
from prefcal_agents.space.start import Start
from prefcal_agents.support.checks import integer
from prefcal_env.errors import SettingsError
from prefcal_env.knobs.space import KnobSpace

from .simulations import Simulate, Simulations


class Simulating(PreferenceBased):
    """An agent that is given a simulation, and shows only some of what it simulates.

    Copies share the simulations. A restored agent has none until `with_simulations`.

    Args:
        space: Knobs to tune.
        simulate: Function of a physical θ, shape (n,), that returns KPIs by name, lower is better;
            see `Simulate`. Without it, the agent can only be inspected.
        n_simulated: Number of θ to simulate, 1 or more.
        n_init: Required of all agents, without effect here; 1 or more.
        n_max: Number of experiments shown.
        seed: Seed of all randomness, 0 or more.
        start: Physical θ to show first, such as the current tuning, shape (n,), or several.

    Raises:
        SettingsError: If a value is not valid.
        KnobError: If a θ of `start` is outside the space.
    """

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
    ) -> None:
        super().__init__(space, n_init=n_init, n_max=n_max, seed=seed, start=start)
        integer("n_simulated", n_simulated, low=1)
        self._n_simulated = int(n_simulated)
        self._simulations: Simulations | None = None
        if simulate is not None:
            self._begin(Simulations(simulate))

    def _begin(self, simulations: Simulations) -> None:
        """Simulate by `simulations` from now on, forgetting what was simulated before."""
        self._simulations = simulations

    def with_simulations(self, simulate: Simulate) -> Self:
        """Return a copy that simulates by `simulate`, for example one restored from a file."""
        twin = self.copy()
        twin._begin(Simulations(simulate))
        return twin

    @property
    def n_simulated(self) -> int:
        """Return the number of θ that the agent may simulate."""
        return self._n_simulated

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
            raise self._unable()
        return self._simulations

    def _unable(self) -> SettingsError:
        name = type(self).__name__
        return SettingsError(f"{name} needs simulate, a function of θ that returns KPIs")

    def _settings(self) -> dict[str, Any]:
        return {"n_simulated": self._n_simulated}

    def _twin(self, state: AgentState) -> Self:
        twin = super()._twin(state)
        twin._simulations = self._simulations
        return twin

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the simulations, too, if their function can be pickled."""
        *how, kept = super().__reduce__()
        return *how, {**kept, "_simulations": self._simulations}

    def __setstate__(self, kept: Mapping[str, Any]) -> None:
        """Take what `__reduce__` kept."""
        vars(self).update(kept)
        if self._simulations is not None:
            self._begin(self._simulations)
