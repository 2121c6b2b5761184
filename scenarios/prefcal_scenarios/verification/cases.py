"""What varies in the paper's case studies, whose runs are functions of their own."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

from prefcal_env.envs.closed_loop import ClosedLoop
from prefcal_env.envs.cstr import cstr_env
from prefcal_env.envs.overtake import OvertakeOptions
from prefcal_env.experiments.experiment import Experiment

from .factor import Factor, Values
from .plants import PlantSubject


def reactor(function: Any) -> PlantSubject:
    """Return what varies of the reactor; `function` is its run, perhaps for other ranges."""
    from prefcal_scenarios.cases.cstr.controller import controller
    from prefcal_scenarios.cases.cstr.kpis import compute_kpis

    given = {k: v for k, v in getattr(function, "keywords", {}).items() if k == "space"}
    return PlantSubject(ClosedLoop(cstr_env(), partial(controller, **given), compute_kpis))


class Overtaking:
    """What varies of the overtaking: the car's wheelbase, which the MPC does not know, and its start."""

    factors = (
        Factor.around("wheelbase", "parameter", 0.1, 4.5, "m"),
        Factor("start beside the center line", "task", 0.0, -0.3, 0.3, "m"),
        Factor("heading at the start", "task", 0.0, -0.03, 0.03, "rad"),
        Factor("distance at the start", "task", 0.0, -5.0, 5.0, "m"),
    )
    left_out = ("sensors and actuators of the car are ideal, and the obstacle drives as in the paper",)

    def __init__(self, function: Any) -> None:
        self.function = function
        self.options = getattr(function, "keywords", {}).get("options") or OvertakeOptions()

    def at(self, values: Values) -> Callable[..., Experiment]:
        """Return the run of the varied scene."""
        names = [factor.name for factor in self.factors[1:]]
        beside, heading, ahead = (values.get(name, 0.0) for name in names)
        x, y, angle = self.options.x0
        scene = replace(
            self.options,
            x0=(x + ahead, y + beside, angle + heading),
            wheelbase=values.get("wheelbase", self.options.wheelbase),
        )
        return partial(self.function, options=scene)


CASES: Mapping[str, Callable[[Any], Any]] = {
    "prefcal_scenarios.cases.cstr.scenario": reactor,
    "prefcal_scenarios.cases.overtake.scenario": Overtaking,
}
"""Makers of what varies, by the module of the run."""
