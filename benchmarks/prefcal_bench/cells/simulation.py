"""Simulate θ of a problem for an agent: KPIs as the person's agents are told them."""

import numpy as np
from jaxtyping import Float

from prefcal_bench.problems import Problem
from prefcal_env.errors import SettingsError
from prefcal_env.knobs import theta_key
from prefcal_env.preferences.answer import Outcome
from prefcal_scenarios.runs import INTERRUPTED, reading, screened

_MOST = 10_000  # number of θ whose KPIs are kept: 10 MB with 7 KPIs, 30 MB with 24
_KNOWN: dict[tuple[str, str], dict[bytes, Outcome]] = {}
"""KPIs by θ of the problem simulated last in this process: people with other tastes share them."""


class Simulation:
    """Function of a physical θ, shape (n,), that returns its KPIs, lower is better.

    Args:
        where: Problem whose experiments are simulated.
        withheld: Names of the KPIs that agents are not told.

    Its `reading` says how people read them.

    Raises:
        SettingsError: If experiments of the problem have no KPIs.
    """

    def __init__(self, where: Problem, withheld: frozenset[str] = frozenset()) -> None:
        if where.simulated is None:
            raise SettingsError(f"experiments of {where.name!r} have no KPIs to simulate")
        self._where, self.scenario, self._withheld = where, where.simulated, withheld
        self.reading = reading(where.simulated)
        self._asked: set[bytes] = set()

    @property
    def count(self) -> int:
        """Return the number of different θ that were asked for."""
        return len(self._asked)

    def __call__(self, theta: Float[np.ndarray, " n"]) -> Outcome:
        """Return the KPIs of θ. Raises KnobError if θ does not fit the space."""
        key = theta_key(theta)
        self._asked.add(key)
        known = _known(self._where)
        kpis = known.get(key)
        if kpis is None:
            experiment = self._where.outcome(theta).experiment
            assert experiment is not None  # the problem has a scenario
            kpis = screened(self.scenario, experiment)
            if len(known) >= _MOST:
                del known[next(iter(known))]
            known[key] = kpis
        return self._told(kpis)

    def _told(self, kpis: Outcome) -> Outcome:
        if not self._withheld:
            return kpis
        left = {k: value for k, value in kpis.items() if k not in self._withheld}
        if not left and kpis:  # a run that was stopped remains recognizable
            stopped = np.isinf(list(kpis.values())).all()
            left = {INTERRUPTED: np.inf if stopped else 0.0}
        return Outcome(left)


def _known(where: Problem) -> dict[bytes, Outcome]:
    key = (where.name, str(where.version))
    if key not in _KNOWN:
        _KNOWN.clear()
        _KNOWN[key] = {}
    return _KNOWN[key]
