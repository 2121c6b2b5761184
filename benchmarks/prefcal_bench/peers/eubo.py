"""Provide preferential Bayesian optimization with BoTorch's `PairwiseGP` and EUBO as an agent."""

from typing import ClassVar, final

import numpy as np
from jaxtyping import Float

from prefcal_agents.history.lessons import cube_of
from prefcal_env.preferences.history import History

from .botorch_agent import BoTorchAgent
from .utility import Utility, strict_pairs


@final
class EUBO(BoTorchAgent):
    """Propose the θ whose comparison with the best so far has the best expected winner.

    The first `n_init` samples are a Latin hypercube. Then a Gaussian process of the utility of θ is
    fitted to all answers (`PairwiseGP`), and the next sample maximizes the expected utility of the
    best option, given the incumbent (EUBO). Ties and abstentions are ignored: the package knows
    strict answers only.

    Source: package `botorch`; Lin, Astudillo, Frazier, Bakshy 2022, with θ in the place of KPIs, as
    in Astudillo et al. 2023.
    Deviation: only the challenger is chosen, since every experiment is compared with the best so
    far; while there is no strict answer, or if a fit fails, the next sample is random.

    Args:
        space: Knobs to tune; the model sees the unit cube, and integers are snapped afterwards.
        n_init: Number of samples of the start, 1 or more.
        n_max: Number of experiments, which take n_max - 1 comparisons.
        seed: Seed of all randomness, 0 or more.

    Raises:
        SettingsError: If a value is not valid.
        MissingExtraError: If the extra `peers` is not installed.
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
