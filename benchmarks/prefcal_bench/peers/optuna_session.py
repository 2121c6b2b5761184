"""Run an Optuna study silently in memory, with any sampler."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, final

import numpy as np
from jaxtyping import Float

from prefcal_agents.support.extras import load

from .alone import alone


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
