"""The family of rough loops, called "rough-SEED": some θ fail, and some KPIs have plateaus."""

from dataclasses import replace
from functools import lru_cache

import numpy as np

from prefcal_env.errors import ScenarioError
from prefcal_env.experiments.end import End
from prefcal_env.experiments.experiment import Experiment
from prefcal_scenarios.cases.loops.acceptance import is_worth_tuning
from prefcal_scenarios.cases.loops.family import LOOPS, judged, varied
from prefcal_scenarios.cases.loops.loop import Loop
from prefcal_scenarios.cases.loops.vary import random
from prefcal_scenarios.scenario import Scenario

from .roughness import roughened, usual_of

_TRIES = 30
"""How often a rough loop is drawn at most."""
_FAIL = (0.05, 0.4)
"""Share of random θ that fail."""
_WANTED = (0.09, 0.34)
"""The same where it can be chosen, so that it is kept with other random θ."""
_CALM = (0.5, 0.7)
"""Share of the safe θ that never cause an alarm."""
_SAMPLE = 128
_PREDICTIVE = "mpc-"


def rough_loop(seed: int) -> Scenario:
    """Return the rough loop with this seed as a scenario, called "rough-SEED".

    The seed determines the kind, uniform over the loops without an MPC, the parameters as those of
    `loop`, and what is rough: actuators that stick, have play or stand at steps; sensors with
    a resolution; a second set point; an input in stages; how often the controller acts. Limits
    of safe operation are such that 5 to 40 % of random θ fail, and there is an alarm that more
    than half of the others never cause. All are drawn again until the loop `is_worth_tuning`, at
    most 30 times.

    Raises:
        ScenarioError: If the seed is not an integer of 0 or more, or no draw is worth tuning.
    """
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise ScenarioError(f"the seed of a loop must be an integer of 0 or more, got {seed!r}")
    return judged(accepted(int(seed)))


@lru_cache(maxsize=256)  # the check takes up to a second
def accepted(seed: int) -> Loop:
    """Return the first draw with this seed that is worth tuning."""
    rng = np.random.default_rng([seed, 1])
    makers = [make for name, make in LOOPS.items() if not name.startswith(_PREDICTIVE)]
    for _ in range(_TRIES):
        smooth = varied(makers[int(rng.integers(len(makers)))], random(rng))
        found = _drawn(smooth, rng)
        if found is not None and is_worth_tuning(found):
            title = f"{found.title}, rough (variant {seed})"
            return replace(found, name=f"rough-{seed}", title=title)
    raise ScenarioError(f"none of {_TRIES} draws of the rough loop {seed} is worth tuning")


def _drawn(smooth: Loop, rng: np.random.Generator) -> Loop | None:
    """Return a rough loop around a smooth one; None if too many or too few of its θ fail."""
    wanted, calm = rng.uniform(*_WANTED), rng.uniform(*_CALM)
    safe = [run for run in _runs(smooth) if run.end is End.TIME_UP]
    if not safe:
        return None
    rough = roughened(smooth, usual_of(smooth, safe), rng)
    beyond = np.array([_beyond(rough, run) for run in _runs(rough)])
    room = float(np.quantile(beyond, 1.0 - wanted, method="lower"))
    if 0 < room < np.inf:  # else so many fail as it is, or the targets themselves would be unsafe
        rough = _within(rough, room)
        beyond[beyond > room] = np.inf
    failed = np.isinf(beyond)
    if not _FAIL[0] <= failed.mean() <= _FAIL[1]:
        return None
    level = float(np.quantile(beyond[~failed], calm))
    low, high = _targets(rough)
    return replace(rough, alarm=(low - level, high + level))


def _runs(loop: Loop) -> list[Experiment]:
    """Return experiments of random θ, the same ones each time."""
    points = np.random.default_rng(0).random((_SAMPLE, len(loop.space)))
    space = loop.space
    return [loop.run(space.decode(z)) for z in space.snap_all(space.scaled(points))]


def _targets(loop: Loop) -> tuple[float, float]:
    """Return the lowest and the highest value between start and targets."""
    wanted = (loop.task.x0[loop.measured[0]], loop.task.target[0])
    values = (*wanted, *(value for _, value in loop.task.program))
    return min(values), max(values)


def _beyond(loop: Loop, run: Experiment) -> float:
    """Return how far the output goes beyond its targets; infinite if the run was interrupted."""
    if run.end is not End.TIME_UP:
        return float("inf")
    (low, high), y = _targets(loop), run.x[:, loop.measured[0]]
    return float(max(low - y.min(), y.max() - high, 0.0))


def _within(loop: Loop, room: float) -> Loop:
    """Return the loop in which the output must stay within `room` of its targets to be safe."""
    (low, high), first = _targets(loop), loop.measured[0]
    states = list(loop.states)
    states[first] = replace(
        states[first],
        low=max(states[first].low, low - room),
        high=min(states[first].high, high + room),
    )
    return replace(loop, states=tuple(states))
