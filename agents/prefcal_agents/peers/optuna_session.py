"""Run a study of Optuna's preferential sampler silently in memory."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, final

import numpy as np
from jaxtyping import Float

from prefcal_agents.support.extras import load


@final
class OptunaSession:
    """An Optuna study that gets one experiment after another.

    Args:
        n: Number of knobs.
        seed: Seed of the sampler, below 2**32.

    Raises:
        MissingExtraError: If the extra `peers` is not installed.
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
        """Add the experiment at `z`, a point of the unit cube, shape (n,)."""
        params = dict(zip(self._knobs, map(float, z), strict=True))
        with self._alone():
            self._study.add_trial(
                self._optuna.trial.create_trial(params=params, distributions=self._knobs, value=0.0)
            )
        self._trials.append(self._study.get_trials(deepcopy=False)[-1])

    def prefer(self, better: int, worse: int) -> None:
        """Add the answer that experiment `better` is preferred to `worse`."""
        self._study.report_preference(self._trials[better], self._trials[worse])

    def ask(self, seed: int) -> None:
        """Set `proposal` to the next point of the unit cube, shape (n,), or to None.

        It is None before the first preference, and if two fits diverge, the second with a new
        sampler seeded by `seed`.
        """
        self.proposal = None
        if not self._study.preferences:
            return
        for _ in range(2):
            try:
                with self._alone():
                    params = self._study.ask(self._knobs).params
            except (RuntimeError, ValueError):  # an invalid covariance or a noise of NaN
                self._study._study.sampler = _sampler(seed)
            else:
                self.proposal = np.array([params[name] for name in self._knobs])
                return

    @contextmanager
    def _alone(self) -> Iterator[None]:
        """Let Optuna report errors only and limit linear algebra to one thread in the context.

        So a proposal has the same digits whatever else the machine does.
        """
        from threadpoolctl import threadpool_limits  # finds libraries that torch loaded

        logging = self._optuna.logging
        before = logging.get_verbosity()
        logging.set_verbosity(logging.ERROR)
        try:
            with threadpool_limits(1):
                yield
        finally:
            logging.set_verbosity(before)


def _sampler(seed: int) -> Any:
    """Return the default sampler with argument checks, so that a diverged fit stops at once.

    Without these checks it would continue for minutes.
    """
    noise = load("gpytorch.priors", "peers").GammaPrior(5.0, 50.0, validate_args=True)
    module = load("optuna_dashboard.preferential.samplers.gp", "peers")
    return module.PreferentialGPSampler(seed=seed, noise_prior=noise)
