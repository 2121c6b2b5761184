"""Use a cost function from a user's own file in place of a scenario's score."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from numbers import Real
from pathlib import Path
from typing import Any

from prefcal_env.errors import ScenarioError
from prefcal_env.experiments.experiment import Experiment
from prefcal_scenarios.own.own_file import module_at
from prefcal_scenarios.scenario import Scenario


@dataclass(frozen=True, slots=True)
class FileCost:
    """Cost function of an experiment, lower is better, with checked values.

    Args:
        source: Origin of the function, PATH:NAME.
        function: Function that takes an experiment and returns a number.
    """

    source: str
    function: Callable[[Experiment], Any]

    def __call__(self, experiment: Experiment) -> float:
        """Return the cost of `experiment`. Raises ScenarioError if it is not a finite number."""
        value = self.function(experiment)
        finite = isinstance(value, Real) and abs(float(value)) < float("inf")
        if not finite or isinstance(value, bool):
            raise ScenarioError(
                f"cost {self.source!r} must give a finite number, got {value!r} at θ = "
                f"{experiment.theta.tolist()}"
            )
        return float(value)


def with_cost(scenario: Scenario, source: str | None) -> Scenario:
    """Return `scenario` with the cost at PATH:NAME, or unchanged if `source` is None.

    Raises:
        ScenarioError: If the file or the name in it does not exist, or it cannot be called.
    """
    if source is None:
        return scenario
    path, _, name = source.rpartition(":")
    if not path.endswith(".py") or not name:
        raise ScenarioError(f"a cost must be path/to/own.py:NAME, got {source!r}")
    found = getattr(module_at(Path(path)), name, None)
    if not callable(found):
        got = "nothing of that name" if found is None else repr(found)
        raise ScenarioError(f"cost {source!r} must be a function of an experiment, got {got}")
    return replace(scenario, cost=FileCost(source, found))
