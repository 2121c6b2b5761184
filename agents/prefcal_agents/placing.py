"""More answers for one experiment: which known sample to compare the latest one with."""

import numpy as np
from jaxtyping import Float

from prefcal_env.preference import Preference

from .ledger import Ledger


def to_place(ledger: Ledger, values: Float[np.ndarray, " N"]) -> tuple[int, int] | None:
    """The latest sample and the one to compare it with; None once its place is known.

    A sample that lost against the best is somewhere below it; where, a bisection tells with few
    further answers: the next one is the middle of those between which it must lie, in the
    order of Ĵ. A winner, a tie and an abstention need none.

    Source: none.
    Deviation: the paper asks one comparison for each experiment.

    Args:
        ledger: Samples and answers.
        values: Ĵ at the N samples that are closed, lower is better.
    """
    new = ledger.answered - 1
    latest = [c for c in ledger.latest if c.challenger == new]  # appeals may be about others
    if not latest or not all(c.teaches for c in latest):
        return None
    order = [int(i) for i in np.argsort(values, kind="stable") if i != new]
    above, below = -1, len(order)  # positions of the worst that is better, the best that is worse
    for c in latest:
        assert c.incumbent is not None  # it teaches
        position = order.index(c.incumbent)
        if c.answer.preference is Preference.INCUMBENT:
            above = max(above, position)
        elif c.answer.preference is Preference.CHALLENGER and c.after is not None:
            below = min(below, position)
        else:
            return None
    between = order[above + 1 : below]
    asked = {c.incumbent for c in latest}
    if not between or not asked.isdisjoint(between):
        return None
    return new, between[len(between) // 2]
