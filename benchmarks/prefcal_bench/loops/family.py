"""Random closed loops, called "loop-SEED": the named ones with other parameters."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from prefcal_env.arrays import integer
from prefcal_env.envs.task import StepSignal
from prefcal_env.errors import ScenarioError
from prefcal_env.experiments.experiment import End, Experiment
from prefcal_scenarios.cases.loops import LOOPS
from prefcal_scenarios.cases.loops.family import Vary, judged, nominal
from prefcal_scenarios.cases.loops.loop import Loop
from prefcal_scenarios.scenario import Scenario

_FACTOR = 1.5  # random parameters lie between the nominal value divided and multiplied by this
_SAMPLE, _SLOW_SAMPLE = 128, 20
"""Number of random θ that show whether a loop is worth tuning; with an MPC, a run takes 20 ms."""
_TRIES = 10  # how often the parameters of a random loop are drawn at most
_SETTLED = 0.05  # smallest share of the runs that settle before the disturbance
_UNSAFE = 0.8  # largest share of the runs that are interrupted
_SAME = 0.95  # largest share of the safe runs that may agree in a KPI


def loop(seed: int) -> Scenario:
    """Return the random loop with this seed as a scenario, called "loop-SEED".

    The seed determines the kind, uniform over `LOOPS`, and the parameters: those of the plant,
    the size of the disturbance and of the noise. They are drawn again until the loop
    `is_worth_tuning`, at most ten times; then the nominal ones are used.

    Raises:
        ScenarioError: If the seed is not an integer of 0 or more.
    """
    return judged(_accepted(checked_seed(seed))[0])


def checked_seed(seed: int) -> int:
    """Return `seed`. Raises ScenarioError if it is not an integer of 0 or more."""
    integer("the seed of a loop", seed, low=0, error=ScenarioError)
    return int(seed)


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


def random(rng: np.random.Generator) -> Vary:
    """Return a function that draws values around the nominal one, uniform in the logarithm."""

    def vary(value: float) -> float:
        return float(value * _FACTOR ** rng.uniform(-1.0, 1.0))

    return vary


def varied(make: Callable[..., Loop], vary: Vary) -> Loop:
    """Return a loop with random parameters, disturbance and noise."""
    made = make(vary)
    (before,), ((time, (after,)),) = made.disturbance.start, made.disturbance.steps
    d = StepSignal((before,), ((time, (before + vary(1.0) * (after - before),)),))
    assert made.task.noise is not None
    noise = np.array([vary(each) for each in made.task.noise.tolist()])
    return replace(made, task=replace(made.task, d=d, noise=noise))


def is_worth_tuning(loop: Loop) -> bool:
    """Return whether random θ show that tuning `loop` is possible and matters.

    This runs random θ, the same ones each time: 128, or 20 with an MPC. At least 5 % of the runs settle
    before the disturbance, so that there is something to find; at most 80 % are interrupted, so
    that an agent is not only told what is unsafe; and no KPI has one value in more than 95 % of
    the safe runs, so that each one can decide.
    """
    rng = np.random.default_rng(0)
    count = _SLOW_SAMPLE if "N_p" in loop.space.names else _SAMPLE
    points = rng.random((count, len(loop.space)))
    return are_worth_comparing([loop.run(loop.space.decode(z)) for z in points])


def are_worth_comparing(runs: Sequence[Experiment]) -> bool:
    """Return whether runs of random θ satisfy the rules of `is_worth_tuning`."""
    safe = [run for run in runs if run.end is End.TIME_UP]
    settled = sum(bool(np.isfinite(run.kpis["settling_time"])) for run in safe)
    if settled < _SETTLED * len(runs) or len(safe) < (1 - _UNSAFE) * len(runs):
        return False
    most = (Counter(run.kpis[name] for run in safe).most_common(1)[0][1] for name in safe[0].kpis)
    return all(count <= _SAME * len(safe) for count in most)
