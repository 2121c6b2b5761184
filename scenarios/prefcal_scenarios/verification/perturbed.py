"""The perturbed runs of a candidate in a robust study: which there are, and how many keep the limits."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

from prefcal_env.experiments.experiment import Experiment, returned
from prefcal_env.preferences.kpis import Outcome
from prefcal_env.preferences.reading import Reading
from prefcal_env.sources.source import Source
from prefcal_scenarios.scenario import Scenario

from .cases import subject_of
from .factor import drawn
from .subject import Subject

STEPS = (2, 8, 32, 100, 300)
"""Numbers of runs after which those of a candidate end that has not kept the limits."""
_PLANT = ("parameter", "dead time")
"""Kinds of factors that vary, in their usual ranges."""
_APART = 2**40
"""Distance of the seed of the variations: `verify` draws others, so that it can judge what is found."""
Theta = Float[np.ndarray, " n"]


class Perturbed(Source):
    """A source whose θ may end with the number of a perturbed run, 1 or more: other plant, other noise.

    Without one, θ runs as it does in the scenario.

    Args:
        scenario: Scenario.
        seed: Seed of the variations.
    """

    def __init__(self, scenario: Scenario, seed: int) -> None:
        self._space, self._seed = scenario.space, seed
        self._source = scenario.source.elsewhere  # in a worker, that of the user's file
        self._cases: dict[int, tuple[Source, int]] = {}

    def run(self, theta: Theta, seed: int = 0) -> Experiment:
        """Run θ, physical, shape (n,), or a perturbed run of it, shape (n + 1,)."""
        n = len(self._space)
        if len(theta) == n:
            return self._source.run(theta, seed=seed)
        changed, noise = self._case(int(theta[n]))
        return replace(returned(changed.run(theta[:n].copy(), seed=noise)), theta=theta)

    def _case(self, k: int) -> tuple[Source, int]:
        """Return the source of run k and the seed of its noise; candidates share them."""
        if k not in self._cases:
            factors = [each for each in self._subject.factors if each.kind in _PLANT]
            seed = self._seed + _APART
            noise = int(np.random.default_rng([seed, k, 1]).integers(2**31))
            self._cases[k] = self._subject.at(drawn(factors, seed, k)), noise
        return self._cases[k]

    @cached_property
    def _subject(self) -> Subject:
        return subject_of(self._source.here, self._space)


def runs_kept(
    many: Callable[[Sequence[Theta]], Sequence[Outcome]], reading: Reading, thetas: Sequence[Theta], most: int
) -> list[int]:
    """Return how many perturbed runs of each θ keep the limits before one does not, at most `most`.

    A run keeps them that ends safely, meets the objectives that the nominal run meets, and reaches
    what that reaches: no KPI is infinite that is finite nominally.

    Args:
        many: Function that returns the `screened` KPIs of each θ of a `Perturbed`.
        reading: How people read them.
        thetas: Physical θ, each of shape (n,).
        most: Largest number of runs.
    """
    nominal, found, left, done = many(thetas), [0] * len(thetas), list(range(len(thetas))), 0
    for step in [step for step in STEPS if step < most] + [most]:
        made = many([np.append(thetas[row], k) for row in left for k in range(done + 1, step + 1)])
        for place, row in enumerate(left):
            runs = made[place * (step - done) : (place + 1) * (step - done)]
            found[row] = done + _first_bad(reading, nominal[row], runs)
        left, done = [row for row in left if found[row] == step], step
    return found


def _first_bad(reading: Reading, nominal: Outcome, runs: Sequence[Outcome]) -> int:
    """Return the number of runs before the first that loses what the nominal one has; or of all.

    It is 0 if that was interrupted, or failed.
    """
    names = list(nominal)
    rows = [[run.get(name, nominal[name]) if run else np.inf for name in names] for run in runs]
    values = reading.table(names, np.array([list(nominal.values()), *rows]))
    lost = values > [reading.limits.get(name, np.finfo(float).max) for name in names]
    bad = (lost[1:] & ~lost[0]).any(axis=1)
    if not np.isfinite(values[0]).any():
        return 0
    return int(bad.argmax()) if bad.any() else len(runs)
