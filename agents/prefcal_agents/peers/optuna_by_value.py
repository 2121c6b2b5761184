"""Provide Optuna's samplers that are told values as agents: yardsticks for agents that are not."""

from functools import partial
from typing import Any, ClassVar, final

import numpy as np
from jaxtyping import Float

from prefcal_agents.optimize.search import Tried
from prefcal_agents.protocol.agent import ValueBased
from prefcal_agents.protocol.replay import Replay
from prefcal_agents.space.design import latin_hypercube
from prefcal_agents.support.extras import load
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.history import History

from .alone import torch_seeded
from .optuna_session import OptunaSession

_LARGEST = 1e100
"""Scores beyond this size count as this, since their squares overflow."""


class _OptunaByValue(ValueBased):
    """A sampler of Optuna with its default settings.

    The first `n_init` samples are a Latin hypercube. Then an Optuna study is told every score, and
    its sampler proposes the next sample. Experiments without a score are left out; infinite scores
    are refused, as by every agent. The sampler keeps what it learned while scores are added, and
    replays all of them after an undo, a retraction or a restart.
    """

    _sampler: ClassVar[str]
    """Name of the sampler's class in `optuna.samplers`."""

    def __init__(
        self, space: KnobSpace, *, n_init: int = 10, n_max: int = 50, seed: int = 0
    ) -> None:
        super().__init__(space, n_init=n_init, n_max=n_max, seed=seed)
        for module in ("optuna", "torch"):
            load(module, "peers")
        self._replay = Replay(self._start, self._feed)

    def _propose(self, history: History) -> Float[np.ndarray, " n"]:
        index = history.answered
        rng = np.random.default_rng([self._seed, index])
        if index < self.n_init:
            z = latin_hypercube(self.space, self.n_init, self._seed)[index]
        else:
            proposal = self._replay.at(history).proposal
            z = rng.random(len(self.space)) if proposal is None else np.clip(proposal, 0.0, 1.0)
        return Tried(self.space, history).fresh(z, rng)

    def _start(self) -> OptunaSession:
        optuna = load("optuna", "peers")
        make: Any = getattr(optuna.samplers, self._sampler)
        # `ask` is first called after n_init experiments; without any score it is random.
        sampler = partial(make, n_startup_trials=1)
        with torch_seeded(self._seed) as seed:
            return OptunaSession(
                len(self.space),
                lambda sampler: optuna.create_study(sampler=sampler),
                lambda seed: sampler(seed=seed),
                seed,
            )

    def _feed(self, session: OptunaSession, history: History) -> None:
        with torch_seeded(self._seed, history.answered) as seed:
            score = history.comparisons[-1].value
            if score is not None:
                z = np.array(history.samples[history.answered - 1].z)
                session.run(z, float(np.clip(score, -_LARGEST, _LARGEST)))
            if history.answered >= self.n_init:
                session.ask(seed)


@final
class OptunaTPE(_OptunaByValue):
    """Optuna's tree-structured Parzen estimator (`TPESampler`), told the score of each experiment.

    Source: package `optuna`, after Bergstra et al. 2011.
    Deviation: the start is a Latin hypercube of `n_init` samples, not 10 random ones; it searches
    the unit cube, and integers are snapped afterwards; scores beyond ±1e100 count as ±1e100.

    Args:
        space: Knobs to tune.
        n_init: Number of samples of the start, 1 or more.
        n_max: Number of experiments.
        seed: Seed of all randomness, 0 or more.

    Raises:
        SettingsError: If a value is not valid.
        MissingExtraError: If the extra `peers` is not installed.
    """

    version: ClassVar[int] = 1
    _sampler = "TPESampler"


@final
class OptunaGP(_OptunaByValue):
    """Optuna's Gaussian process with expected improvement (`GPSampler`), told each score.

    Source: package `optuna`.
    Deviation: as `OptunaTPE`. A fit that diverges starts from scratch; if it diverges again, the
    next sample is random.

    Args:
        space: Knobs to tune.
        n_init: Number of samples of the start, 1 or more.
        n_max: Number of experiments.
        seed: Seed of all randomness, 0 or more.

    Raises:
        SettingsError: If a value is not valid.
        MissingExtraError: If the extra `peers` is not installed.
    """

    version: ClassVar[int] = 1
    _sampler = "GPSampler"
