"""The perturbed runs of a candidate in a robust study: which there are, and how many keep the limits."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

from prefcal_env.experiments.experiment import Experiment, returned
from prefcal_env.preferences.reading import Reading
from prefcal_env.sources.source import Source
from prefcal_scenarios.scenario import Scenario

from .factor import chosen, drawn
from .subject import Subject, named, subject_of, varied

STEPS = (2, 8, 32, 100, 300)
"""Numbers of runs after which those of a candidate end that has not kept the limits."""
_PLANT = ("parameter", "dead time")
"""Kinds of factors that vary, in their usual ranges."""
_APART = 2**40
"""Distance of the seed of the variations: `verify` draws others, so that it can judge what is found."""
Theta = Float[np.ndarray, " n"]
Outcomes = Sequence[Mapping[str, float]]


class Perturbed(Source):
    """A source whose θ may end with the number of a perturbed run, 1 or more: other plant, other noise.

    Without one, θ runs as it does in the scenario.

    Args:
        scenario: Scenario.
        seed: Seed of the variations.
    """

    def __init__(self, scenario: Scenario, seed: int) -> None:
        self._name, self._space, self._seed = scenario.name, scenario.space, seed
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
            factors, seed = chosen(self._subject.factors, None, _PLANT), self._seed + _APART
            noise = int(np.random.default_rng([seed, k, 1]).integers(2**31))
            changed = self._subject.at(named(factors, drawn(factors, seed, k)))
            self._cases[k] = varied(self._source.here, changed), noise
        return self._cases[k]

    @cached_property
    def _subject(self) -> Subject:
        return subject_of(Scenario(self._name, self._name, self._space, self._source.here, kpis=()))


def runs_kept(
    many: Callable[[Sequence[Theta]], Outcomes], reading: Reading, thetas: Sequence[Theta], most: int
) -> list[int]:
    """Return how many perturbed runs of each θ keep the limits before one does not, at most `most`.

    A run keeps them that ends safely, meets all objectives, and has no infinite KPI, such as the time
    to settle of one that never does. A θ whose nominal run does not has 0.

    Args:
        many: Function that returns the `screened` KPIs of each θ of a `Perturbed`.
        reading: How people read them.
        thetas: Physical θ, each of shape (n,).
        most: Largest number of runs.
    """
    left = [row for row, kpis in enumerate(many(thetas)) if _keeps(reading, kpis)]
    found, done = np.zeros(len(thetas), dtype=np.int64), 0
    for step in [step for step in STEPS if step < most] + [most]:
        numbers = range(done + 1, step + 1)
        made = many([np.append(thetas[row], k) for row in left for k in numbers])
        for place, row in enumerate(left):
            runs = made[place * len(numbers) : (place + 1) * len(numbers)]
            kept = [_keeps(reading, kpis) for kpis in runs]
            found[row] = done + (kept.index(False) if False in kept else len(numbers))
        left, done = [row for row in left if found[row] == step], step
    return found.tolist()


def _keeps(reading: Reading, kpis: Mapping[str, float]) -> bool:
    """Return whether a run keeps the limits, by its KPIs as people read them; one without failed."""
    read = reading.table(list(kpis), np.array([list(kpis.values())]))
    return bool(kpis) and not reading.missed(list(kpis), read)[0]
