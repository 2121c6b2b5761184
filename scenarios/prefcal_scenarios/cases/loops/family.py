"""The named closed loops."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType

from prefcal_agents.registry import JUDGES
from prefcal_env.errors import ScenarioError
from prefcal_env.wording import did_you_mean
from prefcal_scenarios.scenario import Scenario

from .kinds import basic, motion, predictive, processes
from .loop import Loop

_MAKERS = (
    *(basic.lag, basic.integrating, basic.oscillatory, basic.unstable),
    *(processes.tank, processes.quadruple_tank, processes.distillation, processes.building),
    *(motion.servo, motion.cart_pole, motion.boost_converter, motion.steering),
)
LOOPS: Mapping[str, Callable[..., Loop]] = MappingProxyType(
    {make.__name__.replace("_", "-"): make for make in _MAKERS} | predictive.PREDICTIVE
)
"""Makers of the loops by name; each takes a `Vary`."""


def named(name: str) -> Scenario:
    """Return the loop called `name` as a scenario, with its nominal parameters.

    Raises:
        ScenarioError: If no loop has this name.
    """
    if name not in LOOPS:
        raise ScenarioError(
            f"no loop is called {name!r}.{did_you_mean(name, LOOPS)} Expected {', '.join(LOOPS)}"
        )
    return judged(LOOPS[name]())


def judged(loop: Loop) -> Scenario:
    """Return the scenario with `JUDGES` as calibrators."""
    scenario = loop.scenario()
    calibrators = {name: make for judge in JUDGES for name, make in judge(scenario).items()}
    return replace(scenario, calibrators=calibrators)
