"""Provide Optuna's preferential sampler, a Gaussian process, as an agent."""

from typing import Any, ClassVar, final

import numpy as np
from jaxtyping import Float

from prefcal_agents.optimize.search import Tried
from prefcal_agents.protocol.agent import PreferenceBased
from prefcal_agents.protocol.replay import Replay
from prefcal_agents.space.design import latin_hypercube
from prefcal_agents.support.extras import load
from prefcal_agents.support.global_random import seeded
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.answer import Preference
from prefcal_env.preferences.history import History

from .optuna_session import OptunaSession

_GP = "optuna_dashboard.preferential.samplers.gp"


@final
class OptunaPreferential(PreferenceBased):
    """A preferential Gaussian process with hallucination believer (`PreferentialGPSampler`).

    The first `n_init` samples are a Latin hypercube. Then an Optuna study gets every answer, and
    its sampler proposes the next sample. It ignores ties and abstentions. The sampler starts each
    fit where the last one ended, so it is kept while answers are added, and replays all of them
    after an undo, a retraction or a restart.

    Source: package `optuna-dashboard`, after Takeno et al. 2023.
    Deviation: a fit that diverges, which stops the library's sampler, starts from scratch; if it
    diverges again, the next sample is random.

    Args:
        space: Knobs to tune; the sampler sees the unit cube, and integers are snapped afterwards.
        n_init: Number of samples of the start, 1 or more.
        n_max: Number of experiments, which take n_max - 1 comparisons.
        seed: Seed of all randomness, 0 or more.

    Raises:
        SettingsError: If a value is not valid.
        MissingExtraError: If the extra `peers` is not installed.
    """

    version: ClassVar[int] = 1

    def __init__(
        self, space: KnobSpace, *, n_init: int = 10, n_max: int = 50, seed: int = 0
    ) -> None:
        super().__init__(space, n_init=n_init, n_max=n_max, seed=seed)
        for module in ("optuna", _GP):
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
        with seeded(self._seed) as seed:
            return OptunaSession(len(self.space), _study, _sampler, seed)

    def _feed(self, session: OptunaSession, history: History) -> None:
        with seeded(self._seed, history.answered) as seed:
            session.run(np.array(history.samples[history.answered - 1].z))
            last = history.comparisons[-1]
            if last.teaches and last.answer.preference is not Preference.TIE:
                pair = (session.trials[last.challenger], session.trials[last.incumbent or 0])
                won = last.answer.preference is Preference.CHALLENGER
                session.study.report_preference(*(pair if won else reversed(pair)))
            if history.answered >= self.n_init and session.study.preferences:
                session.ask(seed)


def _study(sampler: Any) -> Any:
    preferential = load("optuna_dashboard.preferential", "peers")
    return preferential.create_study(n_generate=1, sampler=sampler)


def _sampler(seed: int) -> Any:
    """Return the default sampler with argument checks, so that a diverged fit stops at once.

    Without these checks it would continue for minutes.
    """
    noise = load("gpytorch.priors", "peers").GammaPrior(5.0, 50.0, validate_args=True)
    return load(_GP, "peers").PreferentialGPSampler(seed=seed, noise_prior=noise)
