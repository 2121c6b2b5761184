"""The data set of a fit: what a history teaches."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

from prefcal_agents.history.lessons import Memory, Preferences
from prefcal_agents.models.kpi_model import Outcomes
from prefcal_env.preferences.history import History


@dataclass(frozen=True, slots=True)
class Dataset:
    """What a history teaches.

    Args:
        history: All samples and answers.
        kept: Numbers of the samples that models are trained on, increasing, shape (K,); see
            `Memory`.
        preferences: Comparisons of these samples.
        kpis: KPIs of these samples, as far as θ predicts them; empty if KPIs are left out.
    """

    history: History
    kept: Int[np.ndarray, " K"]
    preferences: Preferences
    kpis: Outcomes

    @classmethod
    def of(cls, history: History, *, with_kpis: bool) -> "Dataset":
        """Extract what `history` teaches."""
        memory = Memory.of(history)
        kpis = Outcomes.of(memory.history).predictable() if with_kpis else Outcomes.none()
        return cls(history, memory.kept, Preferences.of(memory.history), kpis)

    @property
    def is_strict(self) -> bool:
        """Whether some answer says which of two samples is better."""
        return bool(np.any(self.preferences.b))
