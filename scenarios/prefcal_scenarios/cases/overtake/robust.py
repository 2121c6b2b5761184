"""Beyond the paper: the overtaking of a θ that must do in several scenes. The worst one counts."""

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
"""Of the KPIs; of the others the largest is the worst."""

VARIANTS: Mapping[str, OvertakeOptions] = {
    "nominal": OvertakeOptions(),
    "measurement noise": OvertakeOptions(noise=(0.1, 0.05, 0.01)),
    "braking obstacle": OvertakeOptions(traffic=(Obstacle(deceleration=1.0, brakes_at=4.0),)),
    "slipping car": OvertakeOptions(car=slipping_car()),
    "two obstacles": OvertakeOptions(traffic=(Obstacle(x=22.0), Obstacle(x=36.0))),
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
        Scenes(tuple(variants.values()), estimator, PAPER).of(overtake),
        name=name,
        title="Lane keeping and overtaking, the worst of several runs",
        brief=words.ROBUST,
    )


@dataclass(frozen=True, slots=True)
class Scenes:
    """What a scenario runs that has other scenes, another estimator or other limits.

    Args:
        options: One or more scenes; of several the worst counts.
        estimator: Of the controller; None: it believes what it measures.
        fixed: What the tuning leaves alone.
    """

    options: tuple[OvertakeOptions, ...]
    estimator: EstimatorSettings | None
    fixed: Fixed

    def run(
        self, theta: Float[np.ndarray, " 5"], seed: int = 0, space: KnobSpace = SPACE
    ) -> Experiment:
        """Every scene once; the noise and the random traffic of scene i follow from (seed, i).

        Raises:
            KnobError: θ of the wrong shape, NaN or outside of `space`.
        """
        theta = space.check(theta)
        runs = []
        for i, options in enumerate(self.options):
            of_run = int(np.random.SeedSequence([seed, i]).generate_state(1)[0])
            driver = self.controller(theta, space)
            runs.append(rollout(Course(options), driver, theta, seed=of_run, kpis=indicators))
        return runs[0] if len(runs) == 1 else worst_of(runs, HIGHER_IS_BETTER)

    def controller(self, theta: Float[np.ndarray, " 5"], space: KnobSpace = SPACE) -> Supervisor:
        """A fresh controller of θ. Raises as `run`."""
        return controller(theta, self.fixed, self.estimator, space)

    def settings(self, theta: Float[np.ndarray, " 5"], space: KnobSpace = SPACE) -> dict[str, Any]:
        """Those of the MPCs, and of the estimator if there is one."""
        found = settings(theta, space, self.fixed)
        return found if self.estimator is None else found | {"estimator": asdict(self.estimator)}

    def of(self, scenario: Scenario) -> Scenario:
        """`scenario` with these scenes in place of its own."""
        return replace(
            scenario, run=self.run, controller=self.controller, settings=self.settings
        )  # fmt: skip


def _configured(config: Mapping[str, Any]) -> Scenario:
    from .configured import configured  # which needs this module

    return configured(overtake_robust, ESTIMATOR, len(VARIANTS), config)


overtake_robust = replace(overtake_variants(), configured=_configured)
