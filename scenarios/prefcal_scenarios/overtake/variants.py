"""Beyond the paper: the overtaking of a θ that must do in several scenes. The worst one counts."""

from collections.abc import Mapping
from dataclasses import asdict, replace
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.envs.overtake import Obstacle, OvertakeEnv, OvertakeOptions, slipping_car
from prefcal_env.errors import ScenarioError
from prefcal_env.experiment import Experiment
from prefcal_env.mpc import EstimatorSettings
from prefcal_env.rollout import rollout
from prefcal_env.variants import worst_of
from prefcal_scenarios.overtake.indicators import indicators
from prefcal_scenarios.overtake.room import overtake
from prefcal_scenarios.overtake.supervisor import Supervisor
from prefcal_scenarios.overtake.tuning import ESTIMATOR, PAPER, SPACE, controller, settings
from prefcal_scenarios.scenario import Scenario

HIGHER_IS_BETTER = ("lateral_distance", "clearance")
"""Of the KPIs; of the others the largest is the worst."""

VARIANTS: Mapping[str, OvertakeOptions] = {
    "nominal": OvertakeOptions(),
    "measurement noise": OvertakeOptions(noise=(0.1, 0.05, 0.01)),
    "braking obstacle": OvertakeOptions(obstacles=(Obstacle(deceleration=1.0, brakes_at=4.0),)),
    "slipping car": OvertakeOptions(car=slipping_car()),
    "two obstacles": OvertakeOptions(obstacles=(Obstacle(x=22.0), Obstacle(x=36.0))),
}
"""By name, the paper's first. Noise in m, m and rad; the obstacle brakes with 1 m/s² after 4 s; the
car is highway-env's, its speed needs time; two obstacles are nearer, to be passed within 15 s."""


def overtake_variants(
    variants: Mapping[str, OvertakeOptions] = VARIANTS,
    estimator: EstimatorSettings | None = ESTIMATOR,
    name: str = "overtake-robust",
) -> Scenario:
    """The overtaking with one experiment a θ made of several runs, judged by the worst.

    `Experiment.runs` are in the order of `variants`; arrays are those of the first, KPIs and end
    the worst (`worst_of`). The measurement noise of variant i follows from (seed, i).

    Args:
        variants: Scenes by name, one or more.
        estimator: Of the controller; None: it believes what it measures.
        name: Of the scenario.

    Raises:
        ScenarioError: no variant.
    """
    if not variants:
        raise ScenarioError("overtake_variants needs one or more variants")
    return replace(
        overtake,
        name=name,
        title="Lane keeping and overtaking, the worst of several runs",
        run=partial(_run, tuple(variants.values()), estimator),
        controller=partial(controller, fixed=PAPER, estimator=estimator),
        settings=partial(_settings, estimator),
    )


def _run(
    variants: tuple[OvertakeOptions, ...],
    estimator: EstimatorSettings | None,
    theta: Float[np.ndarray, " 5"],
    seed: int = 0,
) -> Experiment:
    """Every variant once, 15 s each. Raises KnobError as `SPACE.check`."""
    theta = SPACE.check(theta)
    runs = []
    for i, options in enumerate(variants):
        of_run = int(np.random.SeedSequence([seed, i]).generate_state(1)[0])
        driver: Supervisor = controller(theta, estimator=estimator)
        runs.append(rollout(OvertakeEnv(options), driver, theta, seed=of_run, kpis=indicators))
    return worst_of(runs, HIGHER_IS_BETTER)


def _settings(
    estimator: EstimatorSettings | None, theta: Float[np.ndarray, " 5"]
) -> dict[str, Any]:
    """Those of the MPCs, and of the estimator."""
    return settings(theta) | {"estimator": None if estimator is None else asdict(estimator)}


overtake_robust = overtake_variants()
