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


@final
class OptunaPreferential(Stored, PreferenceBased):
    """Gaussian process of preferences, hallucination believer (`PreferentialGPSampler`).

    The first `n_init` samples are a Latin hypercube. Then an Optuna study is set up from the
    stored samples and the answers that stand, and its sampler asked for one more. It knows no
    ties: those teach it nothing, as abstentions.

    Source: package `optuna-dashboard`, after Takeno et al. 2023.
    Deviation: a sampler that lives on starts its fit, and its chain of Gibbs samples, where the
    last one ended; here both start afresh, so that a proposal depends on the answers alone.

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
        index = ledger.answered
        rng = np.random.default_rng([self._seed, index])
        lessons = ledger.preferences()
        strict = lessons.subset(np.flatnonzero(lessons.b))
        if index < self.n_init:
            z = latin_hypercube(self.space, self.n_init, self._seed)[index]
        elif not len(strict):
            z = rng.random(len(self.space))
        else:
            z = self._ask(ledger)
        return Tried(self.space, ledger).fresh(np.clip(z, 0.0, 1.0), rng)

    def _ask(self, ledger: Ledger) -> Float[np.ndarray, " n"]:
        names = [f"z{k}" for k in range(len(self.space))]
        knobs = {name: self._optuna.distributions.FloatDistribution(0.0, 1.0) for name in names}
        with seeded(self._seed, ledger.answered) as seed, _quiet(self._optuna), _one_thread():
            sampler = self._sampler.PreferentialGPSampler(seed=seed)
            study = self._preferential.create_study(n_generate=1, sampler=sampler)
            for z in ledger.cube():
                params = dict(zip(names, map(float, z), strict=True))
                trial = self._optuna.trial.create_trial(
                    params=params, distributions=knobs, value=0.0
                )
                study.add_trial(trial)
            trials = study.get_trials(deepcopy=False)
            lessons = ledger.preferences()
            for b, i, j in zip(lessons.b, lessons.first, lessons.second, strict=True):
                if b:
                    better, worse = (i, j) if b < 0 else (j, i)
                    study.report_preference(trials[better], trials[worse])
            proposed = study.ask(knobs).params
        return np.array([proposed[name] for name in names])


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
