"""More answers for one experiment where answers contradict each other: is the best one the best?"""

import numpy as np
from jaxtyping import Float

from .belief import Belief
from .doubt import contenders
from .ledger import Ledger

_RIVALS = 9  # samples next to the best, by Ĵ
_SURE = 2.0  # standard deviations of a difference from which on it is not asked for


def to_appeal(
    ledger: Ledger,
    values: Float[np.ndarray, " N"],
    features: Float[np.ndarray, "N P"],
    belief: Belief,
) -> tuple[int, int] | None:
    """The sample believed best and the one that may be better; None where that is settled.

    The next experiment is compared with the best, so it matters most whether that is who. Of
    the samples next in order, the one of which it is least sure that it is worse is asked for: a
    pair that was compared before is left out, since whoever errs about it may do so again.

    Source: none; the least certain pair, as in uncertainty sampling.
    Deviation: the paper asks one comparison for each experiment, and takes all for true.

    Args:
        ledger: Samples and answers.
        values: Ĵ at the N samples that are closed, lower is better.
        features: Values of Ĵ are features · β.
        belief: What is known of β.

    Returns:
        The later and the earlier sample of the pair.
    """
    preferences, candidates = ledger.preferences(), contenders(ledger)
    best, *rest = candidates[np.argsort(values[candidates], kind="stable")]
    pairs = np.stack([preferences.first, preferences.second])
    met = pairs[:, np.any(pairs == best, axis=0)]
    rivals = np.array([k for k in rest[:_RIVALS] if k not in met], dtype=np.int64)
    if not len(rivals):
        return None
    away = belief.deviations(features[best] - features[rivals])
    nearest = int(np.argmin(away))
    if away[nearest] > _SURE:
        return None
    pair = int(best), int(rivals[nearest])
    return max(pair), min(pair)
