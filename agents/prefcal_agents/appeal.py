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

    The next experiment is compared with the best, so what matters most is whether it really is.
    Of the samples next in order, that is asked for of which it is least sure that it is worse. A
    pair that was asked before is left out, whatever was answered: whoever errs about it may do so
    again, and who could not tell, or took his answer back, has said what he had to say.

    Source: none; the least certain pair, as in uncertainty sampling.
    Deviation: the paper asks one comparison for each experiment, and takes all for true.

    Args:
        ledger: Samples and answers.
        values: Ĵ at the N samples that are closed, lower is better.
        features: Values of Ĵ are features · β, but that KPIs never count negatively, shape (N, P).
        belief: What is known of β.

    Returns:
        The later and the earlier sample of the pair.
    """
    candidates = contenders(ledger)
    best, *rest = candidates[np.argsort(values[candidates], kind="stable")]
    pairs = [{c.challenger, c.incumbent} for c in ledger.in_order()]
    rivals = [int(k) for k in rest[:_RIVALS] if {best, k} not in pairs]
    if not rivals:
        return None
    behind = belief.deviations(features[rivals] - features[best])
    nearest = int(np.argmin(behind))
    if behind[nearest] > _SURE:
        return None
    pair = int(best), rivals[nearest]
    return max(pair), min(pair)
