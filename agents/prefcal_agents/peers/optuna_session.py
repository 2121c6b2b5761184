"""A study of Optuna's preferential sampler that lives in memory and says nothing."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, final

import numpy as np
from jaxtyping import Float

from prefcal_agents.support.extras import load


@final
class OptunaSession:
    """The study, told about one experiment after another.

    Args:
        n: Knobs.
        seed: Of the sampler, below 2**32.

    Raises:
        MissingExtraError: the extra `peers` is not installed.
    """

    def __init__(self, n: int, seed: int) -> None:
        self._optuna = load("optuna", "peers")
        uniform = self._optuna.distributions.FloatDistribution(0.0, 1.0)
        self._knobs = {f"z{k}": uniform for k in range(n)}
        self._trials: list[Any] = []
        self.proposal: Float[np.ndarray, " n"] | None = None
        with self._alone():
            preferential = load("optuna_dashboard.preferential", "peers")
            self._study = preferential.create_study(n_generate=1, sampler=_sampler(seed))

    @staticmethod
    def check_installed() -> None:
        """Raise MissingExtraError unless everything can be imported."""
        for module in ("optuna", "optuna_dashboard.preferential.samplers.gp"):
            load(module, "peers")

    def run(self, z: Float[np.ndarray, " n"]) -> None:
        """The experiment of `z`, in the unit cube, shape (n,), was run."""
        params = dict(zip(self._knobs, map(float, z), strict=True))
        with self._alone():
            self._study.add_trial(
                self._optuna.trial.create_trial(params=params, distributions=self._knobs, value=0.0)
            )
        self._trials.append(self._study.get_trials(deepcopy=False)[-1])

    def prefer(self, better: int, worse: int) -> None:
        """Experiment number `better` was preferred to number `worse`."""
        self._study.report_preference(self._trials[better], self._trials[worse])

    def ask(self, seed: int) -> None:
        """Set `proposal` to the next point of the unit cube, shape (n,); None if there is none.

        There is none before the first preference, and when two fits have diverged, the second of
        a new sampler with `seed`.
        """
        self.proposal = None
        if not self._study.preferences:
            return
        for _ in range(2):
            try:
                with self._alone():
                    params = self._study.ask(self._knobs).params
            except (RuntimeError, ValueError):  # a covariance that is none, a noise that is NaN
                self._study._study.sampler = _sampler(seed)
            else:
                self.proposal = np.array([params[name] for name in self._knobs])
                return

    @contextmanager
    def _alone(self) -> Iterator[None]:
        """Inside, Optuna reports errors only, and linear algebra keeps to one thread.

        So a proposal has the same digits whatever else the machine does.
        """
        from threadpoolctl import threadpool_limits  # finds what torch has loaded

        logging = self._optuna.logging
        before = logging.get_verbosity()
        logging.set_verbosity(logging.ERROR)
        try:
            with threadpool_limits(1):
                yield
        finally:
            logging.set_verbosity(before)


def _sampler(seed: int) -> Any:
    """The sampler as it is by default, except that a fit which has diverged stops.

    With its arguments unchecked, it goes on for minutes.
    """
    noise = load("gpytorch.priors", "peers").GammaPrior(5.0, 50.0, validate_args=True)
    module = load("optuna_dashboard.preferential.samplers.gp", "peers")
    return module.PreferentialGPSampler(seed=seed, noise_prior=noise)
