"""Evaluate θ in several overtaking scenes, of which the worst counts; beyond the paper."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.envs.overtake import Course, Obstacle, OvertakeOptions, slipping_car
from prefcal_env.errors import ScenarioError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.experiments.rollout import rollout
from prefcal_env.experiments.worst_case import worst_of
from prefcal_env.knobs.knob import KnobSpace
from prefcal_env.mpc import EstimatorSettings
from prefcal_scenarios.scenario import Scenario

from . import wording as words
from .controller import ESTIMATOR, PAPER, SPACE, Fixed, controller, settings
from .kpis import indicators
from .scenario import overtake
from .supervisor import Supervisor

HIGHER_IS_BETTER = ("lateral_distance", "clearance")
"""KPIs whose smallest value is the worst; for all others it is the largest."""

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
        ScenarioError: `variants` is empty.
    """
    if not variants:
        raise ScenarioError("overtake_variants needs one or more variants")
    return replace(
        Scenes(tuple(variants.values()), estimator, PAPER).of(overtake),
        name=name,
        title="Lane keeping and overtaking, the worst of several runs",
        brief=words.ROBUST,
    )


@dataclass(frozen=True, slots=True)
class Scenes:
    """The scenes, estimator and fixed settings that a scenario runs with.

    Args:
        options: Options of one or more scenes; the worst counts.
        estimator: Estimator of the controller; None trusts the measurement.
        fixed: MPC settings that are not tuned.
    """

    options: tuple[OvertakeOptions, ...]
    estimator: EstimatorSettings | None
    fixed: Fixed

    def run(
        self, theta: Float[np.ndarray, " 5"], seed: int = 0, space: KnobSpace = SPACE
    ) -> Experiment:
        """Run every scene once; noise and random traffic of scene i follow from (seed, i).

        Raises:
            KnobError: θ of the wrong shape, NaN or outside `space`.
        """
        theta = space.check(theta)
        runs = []
        for i, options in enumerate(self.options):
            of_run = int(np.random.SeedSequence([seed, i]).generate_state(1)[0])
            driver = self.controller(theta, space)
            runs.append(rollout(Course(options), driver, theta, seed=of_run, kpis=indicators))
        return runs[0] if len(runs) == 1 else worst_of(runs, HIGHER_IS_BETTER)

    def controller(self, theta: Float[np.ndarray, " 5"], space: KnobSpace = SPACE) -> Supervisor:
        """Create the controller of θ. Raises like `run`."""
        return controller(theta, self.fixed, self.estimator, space)

    def settings(self, theta: Float[np.ndarray, " 5"], space: KnobSpace = SPACE) -> dict[str, Any]:
        """Return the settings of the MPCs, and of the estimator if there is one."""
        found = settings(theta, space, self.fixed)
        return found if self.estimator is None else found | {"estimator": asdict(self.estimator)}

    def of(self, scenario: Scenario) -> Scenario:
        """Return `scenario` with these scenes instead of its own."""
        return replace(
            scenario, run=self.run, controller=self.controller, settings=self.settings
        )  # fmt: skip


def _configured(config: Mapping[str, Any]) -> Scenario:
    from .configured import configured  # which needs this module

    return configured(overtake_robust, ESTIMATOR, len(VARIANTS), config)


overtake_robust = replace(overtake_variants(), configured=_configured)
