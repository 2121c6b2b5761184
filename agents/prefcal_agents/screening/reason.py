"""Why a screening agent shows this experiment, as data that front ends put into words."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.special import ndtr

from prefcal_env.preferences.answer import Preference
from prefcal_env.preferences.history import History

from .growth import Stage

_DIFFERS = 0.02
"""Share of the present weights' cost below which two values of a KPI are called equal."""


@dataclass(frozen=True, slots=True)
class Reason:
    """Why the challenger of the open query is shown.

    Args:
        chance: Probability that the person prefers it to the best so far, by what was learned.
        better_in: Names of the KPIs in which it is better than the best so far, the one that
            matters most first.
        worse_in: Names of those in which it is worse, likewise.
    """

    chance: float
    better_in: tuple[str, ...]
    worse_in: tuple[str, ...]


def reason_for(stage: Stage, new: int, best: int, history: History) -> Reason:
    """Return why row `new` of the bank is compared with row `best`.

    Somebody who often sees no difference prefers the new one less often than the costs say, so the
    chance is multiplied by the share of answers so far that prefer a side.
    """
    given = [c.answer.preference is not Preference.TIE for c in history.lessons()]
    told = (sum(given) + 1) / (len(given) + 1)
    names = stage.scale.names
    logs, weights = stage.logs[[new, best]], stage.utilities.weights
    lost = [stage.utilities.losses(logs, kpi) for kpi in range(len(names))]
    gains = np.array(
        [np.mean(w * (both[:, 1] - both[:, 0])) for w, both in zip(weights.T, lost, strict=True)]
    )
    clear = np.abs(gains) > _DIFFERS * np.abs(gains).sum()
    order = [int(kpi) for kpi in np.argsort(-np.abs(gains), kind="stable") if clear[kpi]]
    return Reason(
        told * float(chances(stage, best)[:, new].mean()),
        tuple(names[kpi] for kpi in order if gains[kpi] > 0),
        tuple(names[kpi] for kpi in order if gains[kpi] < 0),
    )


def chances(stage: Stage, best: int) -> Float[np.ndarray, "d m"]:
    """Return, in each draw, how probably θ are noticeably better than row `best`, shape (d, m)."""
    gain = stage.costs[:, best, None] - stage.costs
    return np.asarray(ndtr(gain / stage.noticed[:, None] - 1.0))
