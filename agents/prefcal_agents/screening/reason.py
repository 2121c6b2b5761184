"""Why a screening agent shows this experiment, as data that front ends put into words."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from prefcal_agents.utility.utilities import noticed
from prefcal_env.preferences.answer import Preference
from prefcal_env.preferences.history import History

from .growth import Stage

_DIFFERS = 0.02
"""Share of what all differences count together below which that of a KPI is left out."""
_NOTHING = 1e-9


@dataclass(frozen=True, slots=True)
class Reason:
    """Why the challenger of the open query is shown.

    Args:
        chance: Probability that the person prefers it to the best so far, by what was learned.
        better_in: Names of the KPIs in which it is better than the best so far, the one that
            matters most first.
        worse_in: Names of those in which it is worse, likewise.
        kept: In a robust study, how many perturbed runs keep the limits before one does not.
    """

    chance: float
    better_in: tuple[str, ...]
    worse_in: tuple[str, ...]
    kept: int | None = None


@dataclass(frozen=True, slots=True)
class RobustResult:
    """How the best θ of a robust study holds, and what that costs nominally.

    Args:
        kept: How many perturbed runs keep the limits before one does not.
        costs: KPIs in which another θ is better that promises most, but does not hold; what matters
            most first. The values are those of the best θ and of the other one, lower is better.
    """

    kept: int
    costs: Mapping[str, tuple[float, float]]


def reason_for(stage: Stage, new: int, best: int, history: History) -> Reason:
    """Return why row `new` of the bank is compared with row `best`."""
    names, utilities = stage.scale.names, stage.utilities
    levels = utilities.levels(stage.logs[[new, best]])
    parts = utilities.gains(levels, np.array([0]), np.array([1]))[:, :, 0]
    shares = parts / (np.abs(parts).sum(axis=0) + _NOTHING)  # in orders one KPI decides
    gains = shares.mean(axis=1).reshape(2, len(names)).sum(axis=0)  # and its limit
    clear = np.abs(gains) > _DIFFERS * np.abs(gains).sum()
    order = [int(kpi) for kpi in np.argsort(-np.abs(gains), kind="stable") if clear[kpi]]
    return Reason(
        float(chances(stage, best, history)[new]),
        tuple(names[kpi] for kpi in order if gains[kpi] > 0),
        tuple(names[kpi] for kpi in order if gains[kpi] < 0),
    )


def chances(stage: Stage, best: int, history: History) -> Float[np.ndarray, " m"]:
    """Return how probably the person prefers each θ to row `best`, shape (m,).

    Somebody who often sees no difference prefers the new one less often than the costs say, so the
    chance is multiplied by the share of answers so far that prefer a side.
    """
    given = [c.answer.preference is not Preference.TIE for c in history.lessons()]
    told = (sum(given) + 1) / (len(given) + 1)
    return np.asarray(told * noticed(stage.costs[:, best, None] - stage.costs).mean(axis=0))
