"""Provide BoTorch's preferential Bayesian optimization as agents: EUBO, and BOPE with KPIs."""

from collections.abc import Callable
from typing import Any, ClassVar, TypeVar, final

import numpy as np
from jaxtyping import Float

from prefcal_agents.agent import Pair, rematch
from prefcal_agents.lessons import cube_of
from prefcal_agents.search import Tried
from prefcal_bench.extras import load
from prefcal_env.preferences.history import History

from .peer import Peer, torch_seeded
from .utility import KPITable, Utility, maxima, strict_pairs

T = TypeVar("T")
_KPI_FIT: dict[str, Any] = {"options": {"maxiter": 50}}
_SEARCH: dict[str, Any] = {"num_restarts": 2, "raw_samples": 64, "options": {"maxiter": 30}}
_RIVALS = 8  # number of runs, the best by expected utility, that a new one has to improve on
_KPI_DRAWS, _UTILITY_DRAWS = 32, 16


class BoTorchAgent(Peer):
    """An agent that proposes the first of its candidates that did not run.

    Without such a candidate, or if a fit fails, the sample is random.
    """

    _modules = ("botorch.models.pairwise_gp",)

    def _candidates(self, history: History, seed: int) -> Float[np.ndarray, "r n"] | None:
        """Fit a model to the record; return points of the unit cube, the best first, if any."""
        raise NotImplementedError

    def _proposal(self, history: History, tried: Tried) -> Float[np.ndarray, " n"] | None:
        with torch_seeded(self.setup.seed, history.answered) as seed:
            points = attempted(lambda: self._candidates(history, seed))
        return None if points is None else tried.first_new(np.clip(points, 0.0, 1.0))


def attempted(compute: Callable[[], T]) -> T | None:
    """Return what `compute` returns, or None if a model of BoTorch cannot be fitted or searched.

    Errors of linear algebra in torch and gpytorch are RuntimeErrors; torch's distributions raise
    ValueError for parameters that are NaN after a failed fit.
    """
    errors = load("botorch.exceptions.errors", "peers")
    try:
        return compute()
    except (RuntimeError, ValueError, errors.BotorchError, errors.ModelFittingError):
        return None


@final
class EUBO(BoTorchAgent):
    """Propose the θ whose comparison with the best so far has the best expected winner.

    The first `n_init` samples are a Latin hypercube. Then a Gaussian process of the utility of θ is
    fitted to all answers (`PairwiseGP`), and the next sample maximizes the expected utility of the
    best option, given the incumbent (EUBO). Ties and abstentions are ignored: the package knows
    strict answers only. The model sees the unit cube, and integers are snapped afterwards.
    `n_max` experiments take n_max - 1 comparisons.

    Source: package `botorch`; Lin, Astudillo, Frazier, Bakshy 2022, with θ in the place of KPIs, as
    in Astudillo et al. 2023.
    Deviation: only the challenger is chosen, since every experiment is compared with the best so
    far; while there is no strict answer, or if a fit fails, the next sample is random.

    Arguments and errors are those of `Agent`. Without the extra `peers`, MissingExtraError is raised.
    """

    version: ClassVar[int] = 1

    def _candidates(self, history: History, seed: int) -> Float[np.ndarray, "r n"] | None:
        return challengers(history, seed)


def challengers(history: History, seed: int) -> Float[np.ndarray, "r n"] | None:
    """Return the points of the cube with the highest EUBO against the incumbent, best first.

    None while there is no strict answer. The search draws from torch's global generator.
    """
    pairs, incumbent = strict_pairs(history), history.incumbent
    if not len(pairs) or incumbent is None:
        return None
    return Utility.of(cube_of(history), pairs).challengers(incumbent)


@final
class BOPE(BoTorchAgent):
    """Learn how θ makes the KPIs, and how a person judges the KPIs, as two models.

    The first `n_init` samples are a Latin hypercube. Then each KPI gets a Gaussian process over θ,
    and the utility of KPIs one that is fitted to all answers (`PairwiseGP`). The next sample
    maximizes the expected improvement under the uncertainty of both (qNEIUU). Before it is
    proposed, one follow-up question explores the preferences: of the experiments that ran, it
    compares the two whose better one has the highest expected utility (EUBO). Ties and abstentions
    are ignored. Without KPIs it is `EUBO` on θ and asks no follow-up questions. `n_max` experiments
    take up to 2 n_max - n_init - 1 comparisons. The models see the unit cube, and integers are
    snapped afterwards.

    Source: package `botorch`; Lin, Astudillo, Frazier, Bakshy 2022.
    Deviation: exploration compares experiments that ran, not predicted KPIs, since a person
    compares curves; every experiment is compared with the best so far as well, and both kinds of
    questions alternate; KPIs are scaled and capped as for GLISp, and infinite ones count as a bit
    worse than the worst finite one; improvement is on the 8 runs of highest expected utility, with
    32 draws of KPIs times 16 of utility, for speed; no θ runs again, so the next lower maximum
    replaces one that ran; while there is no strict answer, or if a fit
    fails, the next sample is random.

    Arguments and errors are those of `Agent`. Without the extra `peers`, MissingExtraError is raised.
    """

    version: ClassVar[int] = 1

    def _candidates(self, history: History, seed: int) -> Float[np.ndarray, "r n"] | None:
        return _most_improving(history, seed)

    def question(self, history: History) -> Pair | None:
        """Return the unbeaten samples to compare, or those that tell most about the KPIs."""
        pair = rematch(history)
        if pair is not None or history.answered >= self._most(history):
            return pair
        if history.answered < self.setup.n_init or len(history.latest) > 1:
            return None
        with torch_seeded(self.setup.seed, history.answered):
            return attempted(lambda: _most_telling(history))


def _models(history: History) -> tuple[KPITable, Utility] | None:
    """Return the KPIs and the utility over them; None if there is nothing to learn from."""
    table = KPITable.of(history)
    if table is None:
        return None
    pairs = table.pairs(strict_pairs(history))
    return (table, Utility.of(table.shares, pairs)) if len(pairs) else None


def _most_telling(history: History) -> Pair | None:
    """Return the two runs with the highest EUBO that were not compared; None without KPIs."""
    models = _models(history)
    if models is None:
        return None
    table, utility = models
    asked = {frozenset((c.challenger, c.incumbent)) for c in history.counting}
    unasked = [[frozenset((int(i), int(j))) not in asked for j in table.rows] for i in table.rows]
    pair = utility.best_pair(np.array(unasked))
    return None if pair is None else (int(table.rows[pair[1]]), int(table.rows[pair[0]]))


def _most_improving(history: History, seed: int) -> Float[np.ndarray, "r n"] | None:
    """Return the points of the cube with the highest qNEIUU, best first; EUBO's without KPIs."""
    models = _models(history)
    if models is None:
        return challengers(history, seed)
    table, utility = models
    z = cube_of(history)[table.rows]
    best = np.argsort(-utility.means(), kind="stable")[:_RIVALS]
    torch = load("torch", "peers")
    objective = load("botorch.acquisition.objective", "peers").LearnedObjective(
        utility.model, sample_shape=torch.Size([_UTILITY_DRAWS]), seed=seed
    )
    sampler = load("botorch.sampling.normal", "peers").SobolQMCNormalSampler(
        torch.Size([_KPI_DRAWS]), seed=seed
    )
    improvement = load("botorch.acquisition.logei", "peers").qLogNoisyExpectedImprovement(
        model=_kpi_model(z, table.shares),
        X_baseline=torch.tensor(z[best]),
        sampler=sampler,
        objective=objective,
        prune_baseline=False,  # independent draws would keep all of them
        cache_root=False,  # utilities of new and old runs are drawn jointly
    )
    return maxima(improvement, z.shape[1], _SEARCH)


def _kpi_model(z: Float[np.ndarray, "K n"], shares: Float[np.ndarray, "K p"]) -> Any:
    """Return a fitted Gaussian process of each KPI over the unit cube, independent, as one model.

    Kernel and priors are the package's own.
    """
    tensor = load("torch", "peers").tensor
    model = load("botorch.models", "peers").SingleTaskGP(tensor(z), tensor(shares))
    likelihood = load("gpytorch.mlls", "peers").ExactMarginalLogLikelihood
    fit = load("botorch.fit", "peers").fit_gpytorch_mll
    fit(likelihood(model.likelihood, model), optimizer_kwargs=_KPI_FIT)
    return model
