"""More answers for one experiment where answers contradict each other: is the best one the best?"""

import numpy as np
from jaxtyping import Float

from .belief import Belief
from .doubt import contenders
from .ledger import Ledger

SURE = 2.0
"""Standard deviations of a difference from which on it is not asked for."""
_RIVALS = 9  # samples next to the best, by Ĵ


def to_appeal(
    ledger: Ledger,
    values: Float[np.ndarray, " N"],
    features: Float[np.ndarray, "N P"],
    belief: Belief,
    *,
    sure: float = SURE,
) -> tuple[int, int] | None:
    """Return the best sample and the one that may be better; None where that is settled.

    The next experiment is compared with the best, so what matters most is whether it really is.
    Of the other samples of lowest Ĵ, the rival is the one of which the belief is least sure that
    it is worse. A pair that was asked before is left out, whatever was answered.

    Source: none; the least certain pair, as in uncertainty sampling.
    Deviation: the paper asks one comparison for each experiment, and takes all for true.

    Args:
        ledger: Samples and answers.
        values: Ĵ at the N samples that are closed, lower is better; infinite where forgotten.
        features: Values of Ĵ are features · β, but that KPIs never count negatively, shape (N, P).
        belief: What is known of β.
        sure: By how many standard deviations a rival must be worse to be left alone; 0: only one
            that is believed to be better is asked about.

    Returns:
        The later and the earlier sample of the pair.
    """
    candidates, best = contenders(ledger), ledger.incumbent
    candidates = candidates[np.isfinite(values[candidates])]
    if best is None:
        return None
    rest = [int(k) for k in candidates[np.argsort(values[candidates], kind="stable")] if k != best]
    rivals = [k for k in rest[:_RIVALS] if not ledger.asked(best, k)]
    if not rivals:
        return None
    behind = belief.deviations(features[rivals] - features[best])
    nearest = int(np.argmin(behind))
    if behind[nearest] > sure:
        return None
    return max(best, rivals[nearest]), min(best, rivals[nearest])
