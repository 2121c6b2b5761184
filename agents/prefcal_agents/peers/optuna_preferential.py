"""Optuna's preferential sampler, a Gaussian process, as an agent."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, ClassVar, final

import numpy as np
from jaxtyping import Float

from prefcal_env.knobs import KnobSpace

from ..checks import integer
from ..cube import Tried, latin_hypercube
from ..extras import load
from ..global_random import seeded
from ..ledger import Ledger
from ..stored import Stored
from ..turn_taking import PreferenceBased
from ..turns import Turns

_HELD_BACK = (0, 1, 2, 4, 8)
"""Lessons that a fit leaves out at first: one that starts from nothing diverges now and then."""


@final
class OptunaPreferential(Stored, PreferenceBased):
    """Gaussian process of preferences, hallucination believer (`PreferentialGPSampler`).

    The first `n_init` samples are a Latin hypercube. Then an Optuna study is set up from the
    stored samples and the answers that stand, and its sampler asked for one more. It knows no
    ties: those teach it nothing, as abstentions.

    Source: package `optuna-dashboard`, after Takeno et al. 2023.
    Deviation: a sampler that lives on starts its fit, and its chain of Gibbs samples, where the
    last one ended; here both start afresh, so that a proposal depends on the answers alone. A
    fit that diverges is started again from that of fewer answers.

    Args:
        space: The knobs; the sampler sees the unit cube, and integers are snapped afterwards.
        n_init: Samples of the start, 1 or more.
        n_max: Experiments in all, which take n_max - 1 comparisons.
        seed: Of all randomness, 0 or more.

    Raises:
        SettingsError: an impossible value.
        MissingExtraError: the extra `peers` is not installed.
    """

    version: ClassVar[int] = 1

    def __init__(
        self, space: KnobSpace, *, n_init: int = 10, n_max: int = 50, seed: int = 0
    ) -> None:
        integer("seed", seed, low=0)
        self._seed = int(seed)
        self._turns = Turns(space, n_init, n_max, self._propose)
        self._optuna = load("optuna", "peers")
        self._sampler = load("optuna_dashboard.preferential.samplers.gp", "peers")
        self._preferential = load("optuna_dashboard.preferential", "peers")

    def _propose(self, ledger: Ledger) -> Float[np.ndarray, " n"]:
        index, n = ledger.answered, len(self.space)
        rng = np.random.default_rng([self._seed, index])
        z = rng.random(n)
        if index < self.n_init:
            z = latin_hypercube(self.space, self.n_init, self._seed)[index]
        elif lessons := _strict(ledger):
            with seeded(self._seed, index) as seed, _quiet(self._optuna), _one_thread():
                for held_back in _HELD_BACK:
                    found = self._ask(ledger, lessons, max(len(lessons) - held_back, 0), seed)
                    if found is not None:
                        z = found
                        break
        return Tried(self.space, ledger).fresh(np.clip(z, 0.0, 1.0), rng)

    def _ask(
        self, ledger: Ledger, lessons: list[tuple[int, int]], first: int, seed: int
    ) -> Float[np.ndarray, " n"] | None:
        """A new sample, shape (n,); None where the fit fails.

        The sampler fits itself to the first `first` lessons, then from there to all of them.
        """
        knobs = {
            f"z{k}": self._optuna.distributions.FloatDistribution(0.0, 1.0)
            for k in range(len(self.space))
        }
        sampler = self._sampler.PreferentialGPSampler(seed=seed)
        study = self._preferential.create_study(n_generate=1, sampler=sampler)
        for z in ledger.cube():
            params = dict(zip(knobs, map(float, z), strict=True))
            study.add_trial(
                self._optuna.trial.create_trial(params=params, distributions=knobs, value=0.0)
            )
        trials = study.get_trials(deepcopy=False)
        try:
            for told in (lessons[:first], lessons[first:]):
                for better, worse in told:
                    study.report_preference(trials[better], trials[worse])
                if told:
                    proposed = study.ask(knobs).params
        except (RuntimeError, ValueError):  # the fit diverged: a covariance that is none
            return None
        z = np.array([proposed[name] for name in knobs])
        return z if np.all(np.isfinite(z)) else None


def _strict(ledger: Ledger) -> list[tuple[int, int]]:
    """The better and the worse sample of each comparison that was no tie."""
    lessons = ledger.preferences()
    rows = zip(lessons.b, lessons.first, lessons.second, strict=True)
    return [(int(i), int(j)) if b < 0 else (int(j), int(i)) for b, i, j in rows if b]


@contextmanager
def _quiet(optuna: Any) -> Iterator[None]:
    """Inside, Optuna reports nothing but errors."""
    before = optuna.logging.get_verbosity()
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    try:
        yield
    finally:
        optuna.logging.set_verbosity(before)


@contextmanager
def _one_thread() -> Iterator[None]:
    """Inside, all linear algebra keeps to one thread: the same digits on every machine."""
    from threadpoolctl import threadpool_limits  # finds the libraries that torch has loaded

    with threadpool_limits(1):
        yield
