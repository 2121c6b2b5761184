"""Evaluate θ in several overtaking scenes, of which the worst counts; beyond the paper."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from prefcal_env.envs.overtake import Obstacle, OvertakeOptions, slipping_car
from prefcal_env.errors import ScenarioError
from prefcal_env.mpc import EstimatorSettings
from prefcal_scenarios.scenario import Scenario

from . import wording as words
from .configured import configured
from .controller import ESTIMATOR, PAPER
from .scenario import overtake
from .scenes import Scenes

VARIANTS: Mapping[str, OvertakeOptions] = {
    "nominal": OvertakeOptions(),
    "measurement noise": OvertakeOptions(noise=(0.1, 0.05, 0.01)),
    "braking obstacle": OvertakeOptions(traffic=(Obstacle(deceleration=1.0, brakes_at=4.0),)),
    "slipping car": OvertakeOptions(car=slipping_car()),
    "two obstacles": OvertakeOptions(traffic=(Obstacle(x=22.0), Obstacle(x=36.0))),
}
"""Scenes by name, the paper's first. Noise in m, m and rad; the obstacle brakes with 1 m/s² after
4 s; the slipping car is highway-env's, whose speed reacts slowly; two obstacles are nearer, so that
the car can pass them within 15 s."""


def overtake_variants(
    variants: Mapping[str, OvertakeOptions] = VARIANTS,
    estimator: EstimatorSettings | None = ESTIMATOR,
    name: str = "overtake-robust",
) -> Scenario:
    """Return the overtaking with several runs per experiment, of which the worst counts.

    `Experiment.runs` are in the order of `variants`; arrays are those of the first run, KPIs and
    end the worst (`worst_of`). The measurement noise of variant i follows from (seed, i).

    Args:
        variants: Scenes by name, one or more.
        estimator: Estimator of the controller; None trusts the measurement.
        name: Name of the scenario.

    Raises:
        ScenarioError: If `variants` is empty.
    """
    if not variants:
        raise ScenarioError("overtake_variants needs one or more variants")
    return replace(
        Scenes(tuple(variants.values()), estimator, PAPER).of(overtake),
        name=name,
        title="Lane keeping and overtaking, the worst of several runs",
        brief=words.ROBUST,
        simulated=False,
    )


def _configured(config: Mapping[str, Any]) -> Scenario:
    return configured(overtake_robust, ESTIMATOR, len(VARIANTS), config)


overtake_robust = replace(overtake_variants(), configured=_configured)
