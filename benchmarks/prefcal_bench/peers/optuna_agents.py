"""Provide samplers of Optuna as agents: a preferential one, and two that are told values."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any, ClassVar, final

import numpy as np
from jaxtyping import Float

from prefcal_agents.search import Tried
from prefcal_bench.extras import load
from prefcal_bench.global_random import seeded
from prefcal_bench.replay import Replay
from prefcal_env.preferences.answer import Preference
from prefcal_env.preferences.history import History

from .peer import Peer, alone, torch_seeded

_GP = "optuna_dashboard.preferential.samplers.gp"
_LARGEST = 1e100  # scores beyond this size count as this, since their squares overflow


@final
class OptunaSession:
    """An Optuna study that gets one experiment after another, and proposes the next.

    Args:
        n: Number of knobs.
        create: Function that returns a study that uses the given sampler.
        sampler: Function that returns a sampler for a seed below 2**32.
        seed: Seed of the first sampler.

    Raises:
        MissingExtraError: If the extra `peers` is not installed.
    """

    def __init__(
        self, n: int, create: Callable[[Any], Any], sampler: Callable[[int], Any], seed: int
    ) -> None:
        self._optuna = load("optuna", "peers")
        uniform = self._optuna.distributions.FloatDistribution(0.0, 1.0)
        self._knobs = {f"z{k}": uniform for k in range(n)}
        self._sampler = sampler
        self.trials: list[Any] = []
        self.proposal: Float[np.ndarray, " n"] | None = None
        with self._silent():
            self.study = create(sampler(seed))
        # A preferential study is wrapped around an ordinary one.
        self._plain = getattr(self.study, "_study", self.study)

    def run(self, z: Float[np.ndarray, " n"], value: float = 0.0) -> None:
        """Add the experiment at `z`, a point of the unit cube, shape (n,), with its score."""
        params = dict(zip(self._knobs, map(float, z), strict=True))
        trial = self._optuna.trial.create_trial(params=params, distributions=self._knobs, value=value)
        with self._silent():
            self._plain.add_trial(trial)
        self.trials.append(self._plain.get_trials(deepcopy=False)[-1])

    def ask(self, seed: int) -> None:
        """Set `proposal` to the next point of the unit cube, shape (n,).

        It is None if two fits diverge, the second with a new sampler seeded by `seed`.
        """
        self.proposal = None
        failed = self._optuna.trial.TrialState.FAIL
        for _ in range(2):
            try:
                with self._silent():
                    trial = self._plain.ask(self._knobs)
                    # The sample that runs is told by `run`, since it may be another one.
                    self._plain.tell(trial, state=failed)
            except (RuntimeError, ValueError):  # an invalid covariance or a noise of NaN
                self._plain.sampler = self._sampler(seed)
            else:
                self.proposal = np.array([trial.params[name] for name in self._knobs])
                return

    @contextmanager
    def _silent(self) -> Iterator[None]:
        """Let Optuna run alone and report errors only in the context."""
        logging = self._optuna.logging
        before = logging.get_verbosity()
        logging.set_verbosity(logging.ERROR)
        try:
            with alone():
                yield
        finally:
            logging.set_verbosity(before)


class _OptunaAgent(Peer):
    """An agent that keeps an Optuna study, whose sampler proposes the next sample."""

    def _prepare(self) -> None:
        super()._prepare()
        self._replay = Replay(self._start, self._feed)

    def _proposal(self, history: History, tried: Tried) -> Float[np.ndarray, " n"] | None:
        return self._replay.at(history).proposal

    def _start(self) -> OptunaSession:
        """Return a study that knows nothing."""
        raise NotImplementedError

    def _feed(self, session: OptunaSession, history: History) -> None:
        """Tell the study the last answer of `history`, and let it propose after the start."""
        raise NotImplementedError


@final
class OptunaPreferential(_OptunaAgent):
    """A preferential Gaussian process with hallucination believer (`PreferentialGPSampler`).

    The first `n_init` samples are a Latin hypercube. Then an Optuna study gets every answer, and
    its sampler proposes the next sample. It ignores ties and abstentions. The sampler starts each
    fit where the last one ended, so it is kept while answers are added, and replays all of them
    after an undo, a retraction or a restart. The sampler sees the unit cube, and integers are
    snapped afterwards. `n_max` experiments take n_max - 1 comparisons.

    Source: package `optuna-dashboard`, after Takeno et al. 2023.
    Deviation: a fit that diverges, which stops the library's sampler, starts from scratch; if it
    diverges again, the next sample is random.

    Arguments and errors are those of `Agent`. Without the extra `peers`, MissingExtraError is raised.
    """

    version: ClassVar[int] = 1
    _modules = ("optuna", _GP)

    def _start(self) -> OptunaSession:
        with seeded(self.setup.seed) as seed:
            return OptunaSession(len(self.space), _study, _sampler, seed)

    def _feed(self, session: OptunaSession, history: History) -> None:
        with seeded(self.setup.seed, history.answered) as seed:
            session.run(np.array(history.samples[history.answered - 1].z))
            last = history.comparisons[-1]
            if last.teaches and last.answer.preference is not Preference.TIE:
                pair = (session.trials[last.challenger], session.trials[last.incumbent or 0])
                won = last.answer.preference is Preference.CHALLENGER
                session.study.report_preference(*(pair if won else reversed(pair)))
            if history.answered >= self.setup.n_init and session.study.preferences:
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


class _OptunaByValue(_OptunaAgent):
    """A sampler of Optuna with its default settings.

    The first `n_init` samples are a Latin hypercube. Then an Optuna study is told every score, and
    its sampler proposes the next sample. Experiments without a score are left out; infinite scores
    are refused, as by every agent. The sampler keeps what it learned while scores are added, and
    replays all of them after an undo, a retraction or a restart.
    """

    by_value = True

    _sampler: ClassVar[str]  # name of the sampler's class in `optuna.samplers`

    _modules = ("optuna", "torch")

    def _start(self) -> OptunaSession:
        optuna = load("optuna", "peers")
        make: Any = getattr(optuna.samplers, self._sampler)
        # `ask` is first called after n_init experiments; without any score it is random.
        sampler = partial(make, n_startup_trials=1)
        with torch_seeded(self.setup.seed) as seed:
            return OptunaSession(
                len(self.space),
                lambda sampler: optuna.create_study(sampler=sampler),
                lambda seed: sampler(seed=seed),
                seed,
            )

    def _feed(self, session: OptunaSession, history: History) -> None:
        with torch_seeded(self.setup.seed, history.answered) as seed:
            score = history.comparisons[-1].value
            if score is not None:
                z = np.array(history.samples[history.answered - 1].z)
                session.run(z, float(np.clip(score, -_LARGEST, _LARGEST)))
            if history.answered >= self.setup.n_init:
                session.ask(seed)


@final
class OptunaTPE(_OptunaByValue):
    """Optuna's tree-structured Parzen estimator (`TPESampler`), told the score of each experiment.

    Source: package `optuna`, after Bergstra et al. 2011.
    Deviation: the start is a Latin hypercube of `n_init` samples, not 10 random ones; it searches
    the unit cube, and integers are snapped afterwards; scores beyond ±1e100 count as ±1e100.

    Arguments and errors are those of `Agent`. Without the extra `peers`, MissingExtraError is raised.
    """

    version: ClassVar[int] = 1
    _sampler = "TPESampler"


@final
class OptunaGP(_OptunaByValue):
    """Optuna's Gaussian process with expected improvement (`GPSampler`), told each score.

    Source: package `optuna`.
    Deviation: as `OptunaTPE`. A fit that diverges starts from scratch; if it diverges again, the
    next sample is random.

    Arguments and errors are those of `Agent`. Without the extra `peers`, MissingExtraError is raised.
    """

    version: ClassVar[int] = 1
    _sampler = "GPSampler"
