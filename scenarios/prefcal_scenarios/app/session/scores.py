"""Compare experiments by the scenario's cost, for agents that learn from scores."""

import numpy as np

from prefcal_env.preferences.answer import Answer, Preference
from prefcal_env.study import State

from .experiments import ExperimentStore


def judged(state: State, album: ExperimentStore, index: int) -> tuple[int | None, Answer]:
    """Return the best so far, and how experiment `index` compares with it, with its score.

    The preference is for readers of the record: the agent learns from the score alone. An
    experiment without a record has no score and abstains.
    """
    best = state.history.incumbent
    value = _score(album, index)
    if best is None:
        return None, Answer(None, value=value)
    rival = _score(album, best)
    if value is None or rival is None:
        # Anything is better than a best without a score.
        won = value is not None
        return best, Answer(Preference.CHALLENGER if won else None, value=value)
    return best, Answer(Preference(int(np.sign(value - rival))), value=value)


def _score(album: ExperimentStore, index: int) -> float | None:
    experiment, cost = album.experiment(index), album.scenario.cost
    assert cost is not None, "refused before the study was started"
    value = float(cost(experiment)) if len(experiment.t) else np.nan
    return value if np.isfinite(value) else None
