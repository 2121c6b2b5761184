"""The family of closed loops: the named ones, and random ones around them."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from prefcal_env.errors import ScenarioError
from prefcal_scenarios.own.nearest import did_you_mean
from prefcal_scenarios.scenario import Scenario

from .kinds import basic, motion, predictive, processes
from .loop import Loop
from .vary import Vary, random

LOOPS: Mapping[str, Callable[..., Loop]] = MappingProxyType(
    {
        make.__name__.replace("_", "-"): make
        for make in (
            basic.lag,
            basic.integrating,
            basic.oscillatory,
            basic.unstable,
            processes.tank,
            processes.quadruple_tank,
            processes.distillation,
            processes.building,
            motion.servo,
            motion.cart_pole,
            motion.boost_converter,
            motion.steering,
            predictive.mpc_oscillatory,
            predictive.mpc_quadruple_tank,
            predictive.mpc_boost_converter,
        )
    }
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
    return LOOPS[name]().scenario()


def loop(seed: int) -> Scenario:
    """Return a random loop as a scenario: its kind and its parameters follow from `seed`."""
    rng = np.random.default_rng(seed)
    kind = list(LOOPS)[int(rng.integers(len(LOOPS)))]
    vary: Vary = random(rng)
    found = LOOPS[kind](vary)
    return replace(found, name=f"{found.name}-{seed}").scenario()
