"""Run simulations for an agent, each θ once, keep their KPIs, and what all such agents share."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from threading import Lock
from typing import Any, Protocol, Self, TypeVar

import numpy as np
from jaxtyping import Float, Int

from prefcal_agents.protocol.agent import Agent
from prefcal_agents.space.start import Start
from prefcal_agents.support.checks import Settings
from prefcal_env.arrays import integer
from prefcal_env.errors import PreferenceError, SettingsError, SimulationError
from prefcal_env.knobs.key import theta_keys
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.kpis import numbers
from prefcal_env.preferences.reading import Reading

Theta = Float[np.ndarray, " n"]
Simulate = Callable[[Theta], Mapping[str, float] | None]
"""Function of a physical θ, shape (n,), that returns KPIs by name, lower is better.

KPIs may be infinite (never), or missing or NaN (unknown). None, no KPIs or an exception: the
simulation failed, which keeps the agent away from its θ. If the function has an attribute `many`,
that is called with a list of θ instead and returns their KPIs in the same order, for example from
several processes; see `SimulateMany`. An attribute `reading` says how people read these KPIs.
An attribute `holds` makes a study robust; see `Holds`.
"""
Holds = Callable[[Sequence[Theta], int], Sequence[int]]
"""Function of θ and a number of perturbed runs that returns how many of these runs of each θ keep the
limits before one does not."""

ENOUGH = 300
"""Number of perturbed runs that all keep the limits of what is shown in a robust study: then fewer
than 1 % of such runs do not, with 95 % confidence."""
_JUDGED = 10
"""Number of simulations from which it is judged whether the names of KPIs change."""

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
        self._known: dict[bytes, dict[str, float]] = {}
        self._error: Exception | None = None
        self._learned: dict[Callable[..., Any], Any] = {}
        self._one_at_a_time = Lock()

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the function and what it returned; a lock belongs to the threads of a process."""
        known = dict(self._known)  # another thread may add to it
        return Simulations, (self.simulate,), {"_known": known, "_error": self._error}

    def learned(self, learn: Callable[..., Learned], *given: Any) -> Learned:
        """Return what `learn(simulations, *given)` returns, the same object for all copies."""
        if learn not in self._learned:
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
        return sum(not outcome for outcome in list(self._known.values()))

    def __call__(self, thetas: Float[np.ndarray, "m n"]) -> list[dict[str, float]]:
        """Return the KPIs of each row of `thetas`; none for a simulation that failed.

        Raises:
            SimulationError: If no simulation has worked so far, or `simulate` does not return what
                it should: KPIs by name, the same names for every θ.
        """
        keys = theta_keys(thetas)
        if any(key not in self._known for key in keys):
            self._run(dict(zip(keys, thetas, strict=True)))
            self._check_names()
        if keys:
            self._check_any()
        return [self._known[key] for key in keys]

    def runs_kept(self, thetas: Float[np.ndarray, "m n"], most: int = ENOUGH) -> Int[np.ndarray, " m"]:
        """Return how many perturbed runs of each θ keep the limits before one does not, shape (m,).

        They are `most` at most, and where the study is not robust, which judges by no such run.
        """
        if self.holds is None:
            return np.full(len(thetas), most)
        return np.array(self.holds(list(thetas), most), dtype=np.int64)

    def _run(self, wanted: Mapping[bytes, Theta]) -> None:
        """Simulate those of `wanted` that are not known; a function of one θ by one thread."""
        with nullcontext() if self._many else self._one_at_a_time:
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
        """Keep the KPIs that the first of `new` returned; none where a simulation failed."""
        found = [{} if result is None else result for result in results]
        try:
            kpis = list(map(numbers, found))
        except PreferenceError:
            return self._keep_until_refused(new, found)
        return self._known.update(zip(new, kpis, strict=False))

    def _keep_until_refused(self, new: Mapping[bytes, Theta], found: Sequence[Any]) -> None:
        """Keep the KPIs before the first of `found` that are none; raise SimulationError about it."""
        for (key, theta), each in zip(new.items(), found, strict=False):
            try:
                self._known[key] = numbers(each)
            except PreferenceError as error:
                raise SimulationError(
                    f"simulate must return a mapping from names of KPIs to numbers, or None if it failed, "
                    f"got {each!r} at θ = {theta}"
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
        worked = [outcome for outcome in list(self._known.values()) if outcome]
        if len(worked) < _JUDGED:
            return
        names = Counter(name for outcome in worked for name in outcome)
        name, most = names.most_common(1)[0]
        if most <= len(worked) // _JUDGED:
            raise SimulationError(
                "simulate must return KPIs of the same names for every θ, but the most common of "
                f"{len(names)} names, {name!r}, came with {most} of {len(worked)} θ"
            )


@dataclass(frozen=True, slots=True)
class Budget(Settings):
    """Number of θ that an agent may simulate, 1 or more."""

    n_simulated: int = 1000

    def __post_init__(self) -> None:
        integer("n_simulated", self.n_simulated, low=1)


class Simulating(Agent):
    """An agent that is given a simulation, and shows only some of what it simulates.

    Copies share the simulations. A restored agent has none until `with_simulations`. Arguments and
    errors are those of `Agent`, but `n_init` has no effect, and two are added:

    Args:
        simulate: Function of a physical θ, shape (n,), that returns KPIs by name, lower is better;
            see `Simulate`. Without it, the agent can only be inspected.
        n_simulated: Number of θ to simulate, 1 or more.
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
    ) -> None:
        budget = Budget(n_simulated)
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
