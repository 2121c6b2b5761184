"""Why a screening agent shows this experiment, as data that front ends put into words."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.special import ndtr

from prefcal_env.preferences.history import History

from .growth import Stage

_COUNTS_MORE = 1.4
"""A KPI counts more than before if its weight has grown by this factor."""
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
        learned: Names of the KPIs that count more, by the answers, than before the first answer,
            the clearest first; empty before anything is learned.
    """

    chance: float
    better_in: tuple[str, ...]
    worse_in: tuple[str, ...]
    learned: tuple[str, ...]


def reason_for(stage: Stage, new: int, best: int, history: History) -> Reason:
    """Return why row `new` of the bank is compared with row `best`."""
    names = stage.scale.names
    logs, weights = stage.logs[[new, best]], stage.utilities.weights
    lost = [stage.utilities.losses(logs, kpi) for kpi in range(len(names))]
    gains = np.array(
        [np.mean(w * (both[:, 1] - both[:, 0])) for w, both in zip(weights.T, lost, strict=True)]
    )
    clear = np.abs(gains) > _DIFFERS * np.abs(gains).sum()
    order = [int(kpi) for kpi in np.argsort(-np.abs(gains), kind="stable") if clear[kpi]]
    return Reason(
        float(chances(stage, best)[new]),
        tuple(names[kpi] for kpi in order if gains[kpi] > 0),
        tuple(names[kpi] for kpi in order if gains[kpi] < 0),
        _learned(stage, names, history),
    )


def chances(stage: Stage, best: int) -> Float[np.ndarray, " m"]:
    """Return the probability that each θ is noticeably better than row `best`, shape (m,)."""
    gain = stage.costs[:, best, None] - stage.costs
    return np.asarray(ndtr(gain / stage.noticed[:, None] - 1.0).mean(axis=0))


def _learned(stage: Stage, names: tuple[str, ...], history: History) -> tuple[str, ...]:
    """Return the KPIs whose weight has grown, and in which most preferred experiments were better.

    The weights of a few answers are uncertain; the second condition keeps what is said true.
    """
    wins = np.zeros(len(names))
    for verdict in history.verdicts():
        if verdict.winner is None or verdict.loser is None:
            continue
        rows = [stage.bank.find(history.samples[i].theta) for i in (verdict.winner, verdict.loser)]
        winner, loser = stage.logs[rows]
        wins += np.where(loser > winner, 1.0, 0.0) - np.where(loser < winner, 1.0, 0.0)
    grown = stage.utilities.weights.mean(axis=0) * len(names)
    order = np.argsort(-grown, kind="stable")
    return tuple(names[kpi] for kpi in order if grown[kpi] > _COUNTS_MORE and wins[kpi] > 0)
