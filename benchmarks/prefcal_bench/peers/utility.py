"""What BOPE and EUBO learn from: the KPIs as a table, and a person's utility from comparisons."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import ndtr

from prefcal_agents.learned_cost import CEILING
from prefcal_agents.lessons import Preferences, normalize
from prefcal_bench.extras import load
from prefcal_env.preferences.history import History

_FIT = {"options": {"ftol": 1e-4}}
"""Options of L-BFGS-B: a smaller tolerance takes twice as long for the same model."""
_SEARCH = {"num_restarts": 8, "raw_samples": 128, "options": {"maxiter": 100}}
_NEVER = 1.1  # share of an infinite value: a bit worse than the worst finite one
_FEWEST = 3  # minimum number of experiments with KPIs


def strict_pairs(history: History) -> Int[np.ndarray, "M 2"]:
    """Return winner and loser of each answer that prefers one side, shape (M, 2)."""
    lessons = Preferences.of(history)
    pairs = np.stack([lessons.first, lessons.second], axis=1)
    pairs[lessons.b > 0] = pairs[lessons.b > 0, ::-1]
    return np.asarray(pairs[lessons.b != 0])


@dataclass(frozen=True, slots=True)
class Utility:
    """A Gaussian process of utility, higher is better: BoTorch's `PairwiseGP`, fitted.

    It has a probit likelihood and Laplace's approximation. Kernel, priors and fit are the package's
    own.
    """

    model: Any  # the fitted `PairwiseGP`
    points: Float[np.ndarray, "K d"]  # points that were compared, about in the unit cube, shape (K, d)

    @classmethod
    def of(cls, points: Float[np.ndarray, "K d"], pairs: Int[np.ndarray, "M 2"]) -> "Utility":
        """Fit the utility at `points` to `pairs`, the rows of winner and loser, 1 or more.

        Raises:
            RuntimeError: If the fit fails numerically, or one of the errors in `attempted`.
        """
        module = load("botorch.models.pairwise_gp", "peers")
        tensor = load("torch", "peers").tensor
        model = module.PairwiseGP(tensor(points), tensor(pairs))
        fit = load("botorch.fit", "peers").fit_gpytorch_mll
        fit(module.PairwiseLaplaceMarginalLogLikelihood(model.likelihood, model), optimizer_kwargs=_FIT)
        return cls(model, points)

    def challengers(self, incumbent: int) -> Float[np.ndarray, "r d"]:
        """Return points of the unit cube to compare with point `incumbent`, the best first.

        The first one maximizes the expected utility of the better one of the two (EUBO).
        """
        acquisition = load("botorch.acquisition.preference", "peers")
        tensor = load("torch", "peers").tensor
        return maxima(
            acquisition.AnalyticExpectedUtilityOfBestOption(
                pref_model=self.model, previous_winner=tensor(self.points[[incumbent]])
            ),
            self.points.shape[1],
            _SEARCH,
        )

    def best_pair(self, open_pairs: Bool[np.ndarray, "K K"]) -> tuple[int, int] | None:
        """Return the two points with the highest EUBO, the earlier one first; None without any.

        Source: the closed form for two normal variables, eq. (2) of Lin et al. 2022.

        Args:
            open_pairs: Whether rows i and j may be compared; only i < j counts.
        """
        mean, covariance = self._moments()
        variance = np.diag(covariance)
        sigma = np.sqrt(np.maximum(variance[:, None] + variance - 2 * covariance, 1e-12))
        u = (mean[:, None] - mean) / sigma
        density = np.exp(-0.5 * u**2) / np.sqrt(2 * np.pi)
        eubo = mean + sigma * (density + u * ndtr(u))
        eubo = np.where(np.triu(open_pairs, 1), eubo, -np.inf)
        first, second = np.unravel_index(int(np.argmax(eubo)), eubo.shape)
        return (int(first), int(second)) if np.isfinite(eubo[first, second]) else None

    def means(self) -> Float[np.ndarray, " K"]:
        """Return the expected utility of each point, shape (K,)."""
        return self._moments()[0]

    def _moments(self) -> tuple[Float[np.ndarray, " K"], Float[np.ndarray, "K K"]]:
        torch = load("torch", "peers")
        with torch.no_grad():
            posterior = self.model.posterior(torch.tensor(self.points))
            mean, covariance = posterior.mean.squeeze(-1), posterior.covariance_matrix
        return np.array(mean), np.array(covariance)


def maxima(acquisition: Any, n: int, search: dict[str, Any]) -> Float[np.ndarray, "r n"]:
    """Return local maxima of `acquisition` over the unit cube, the highest first."""
    torch = load("torch", "peers")
    box = torch.stack([torch.zeros(n, dtype=torch.float64), torch.ones(n, dtype=torch.float64)])
    optimize = load("botorch.optim", "peers").optimize_acqf
    found, values = optimize(acq_function=acquisition, bounds=box, q=1, return_best_only=False, **search)
    order = np.argsort(-np.array(values).ravel(), kind="stable")
    return np.asarray(np.array(found)[order, 0])


@dataclass(frozen=True, slots=True)
class KPITable:
    """The p KPIs of the K experiments that have some."""

    rows: Int[np.ndarray, " K"]  # indices of the samples, increasing, shape (K,)
    # KPIs, lower is better: 0 for the best value and 1 for the worst, which is capped as `normalize` says;
    # 1.1 for an infinite one, shape (K, p)
    shares: Float[np.ndarray, "K p"]

    @classmethod
    def of(cls, history: History) -> "KPITable | None":
        """Return the KPIs that came with the answers; None if there are too few to learn from.

        A missing value counts as the mean of the others. A KPI that never differs is left out.
        """
        values = history.kpis.values
        known = ~np.isnan(values).all(axis=1)
        known[[*history.cut_short]] = False  # their KPIs are bounds
        rows = np.flatnonzero(known)
        if len(rows) < _FEWEST:
            return None
        columns = [_shares(column) for column in values[rows].T if not np.isnan(column).all()]
        columns = [column for column in columns if np.ptp(column) > 0]
        if not columns:
            return None
        return cls(rows, np.stack(columns, axis=1))

    def pairs(self, pairs: Int[np.ndarray, "M 2"]) -> Int[np.ndarray, "L 2"]:
        """Return the pairs of samples of which both are in the table, as pairs of its rows."""
        both = np.isin(pairs, self.rows).all(axis=1)
        return np.searchsorted(self.rows, pairs[both])


def _shares(values: Float[np.ndarray, " K"]) -> Float[np.ndarray, " K"]:
    finite = np.isfinite(values)
    shares = np.where(values > 0, _NEVER, 0.0)
    if finite.any():
        shares[finite] = normalize(values[finite], CEILING)
    missing = np.isnan(values)
    shares[missing] = shares[~missing].mean()
    return shares
