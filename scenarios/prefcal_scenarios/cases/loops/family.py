"""The family of closed loops: the named ones, and random ones around them."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache
from types import MappingProxyType

import numpy as np

from prefcal_agents.registry import JUDGES
from prefcal_env.errors import ScenarioError
from prefcal_env.wording import did_you_mean
from prefcal_scenarios.scenario import Scenario

from .acceptance import is_worth_tuning
from .kinds import basic, motion, predictive, processes
from .loop import Loop
from .vary import Vary, nominal, random

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
_TRIES = 10
"""How often the parameters of a random loop are drawn at most."""


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


def loop(seed: int) -> Scenario:
    """Return the random loop with this seed as a scenario, called "loop-SEED".

    The seed determines the kind, uniform over `LOOPS`, and the parameters: those of the plant,
    the size of the disturbance and of the noise. They are drawn again until the loop
    `is_worth_tuning`, at most ten times; then the nominal ones are used.

    Raises:
        ScenarioError: If the seed is not an integer of 0 or more.
    """
    if not isinstance(seed, int | np.integer) or seed < 0:
        raise ScenarioError(f"the seed of a loop must be an integer of 0 or more, got {seed!r}")
    return judged(_accepted(int(seed))[0])


def rough_model(seed: int, off: float) -> Scenario:
    """Return a model of the random loop with this seed that knows each parameter only roughly.

    Each is too large or too small by the factor 1 + `off`; the seed decides which.

    Args:
        seed: Seed of the loop.
        off: Relative error of all parameters, 0 or more.

    Raises:
        ScenarioError: If the error is negative.
    """
    if not off >= 0:
        raise ScenarioError(f"the error of a model must be 0 or more, got {off!r}")
    rng, rejected = np.random.default_rng(seed), _accepted(seed)[1]
    make = LOOPS[list(LOOPS)[int(rng.integers(len(LOOPS)))]]
    for _ in range(rejected):
        varied(make, random(rng))  # the same draws as those of the loop
    exact, signs = random(rng), np.random.default_rng([seed, 1])
    if rejected == _TRIES:
        exact = nominal

    def vary(value: float) -> float:
        return float(exact(value) * (1.0 + off) ** signs.choice((-1, 1)))

    return judged(replace(varied(make, vary), name=f"model-of-{seed}"))


@lru_cache(maxsize=256)  # the check takes up to 0.5 s
def _accepted(seed: int) -> tuple[Loop, int]:
    """Return the loop with this seed, and how many draws of its parameters were rejected."""
    rng = np.random.default_rng(seed)
    make = LOOPS[list(LOOPS)[int(rng.integers(len(LOOPS)))]]
    drawn = (varied(make, random(rng)) for _ in range(_TRIES))
    rejected, found = next(
        ((k, each) for k, each in enumerate(drawn) if is_worth_tuning(each)), (_TRIES, make())
    )
    return replace(found, name=f"loop-{seed}", title=f"{found.title} (variant {seed})"), rejected


def judged(loop: Loop) -> Scenario:
    """Return the scenario with `JUDGES` as calibrators."""
    scenario = loop.scenario()
    calibrators = {name: make for judge in JUDGES for name, make in judge(scenario).items()}
    return replace(scenario, calibrators=calibrators)


def varied(make: Callable[..., Loop], vary: Vary) -> Loop:
    """Return a loop with random parameters, disturbance and noise."""
    made = make(vary)
    task = replace(
        made.task,
        disturbance=tuple((a, a + vary(1.0) * (b - a)) for a, b in made.task.disturbance),
        noise=tuple(vary(each) for each in made.task.noise),
    )
    return replace(made, task=task)
