"""A calibrator with priorities: the first criterion that separates two experiments decides."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from prefcal_env.arrays import number
from prefcal_env.errors import SettingsError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.preferences.answer import Preference


@dataclass(frozen=True, slots=True)
class Criterion:
    """One criterion by which experiments are compared.

    Args:
        name: Name of the criterion, as shown to people.
        key: Function that returns its value for an experiment; may be infinite.
        just_noticeable: Largest difference that is not noticed, in the key's unit.
        lower_is_better: Whether lower values are better; otherwise higher ones are.

    Raises:
        SettingsError: If `key` is not a function or the just noticeable difference is below 0.
    """

    name: str
    key: Callable[[Experiment], float]
    just_noticeable: float = 0.0
    lower_is_better: bool = True

    def __post_init__(self) -> None:
        if not callable(self.key):
            raise SettingsError(f"criterion {self.name!r}: key must be a function of an experiment")
        number(f"criterion {self.name!r}: just_noticeable", self.just_noticeable)

    def compare(self, challenger: Experiment, incumbent: Experiment) -> Preference:
        """Return which experiment is better by this criterion alone."""
        a, b = (float(self.key(e)) for e in (challenger, incumbent))
        if np.isnan(a) or np.isnan(b):
            raise SettingsError(f"criterion {self.name!r} must be a number, got NaN")
        if a == b or abs(a - b) <= self.just_noticeable:
            return Preference.TIE
        return Preference.CHALLENGER if (a < b) == self.lower_is_better else Preference.INCUMBENT


@dataclass(frozen=True)
class Lexicographic:
    """A `Calibrator` that compares by `criteria` in order of importance.

    An interrupted experiment loses against one that was not interrupted, whatever the criteria; of
    two interrupted ones, the longer is better (end of section III). Only the criteria in `first`
    matter even more: for example, whether the controller can run at all.

    With just noticeable differences the preference is not transitive: a and b, and b and c, may be
    ties although a is better than c; or a is better than b, b than c, and c than a. The same holds
    for people.

    Args:
        criteria: One or more criteria, in order of importance.
        first: Criteria that come before survival, in order of importance.

    Raises:
        SettingsError: If there is no criterion or an item is not a `Criterion`.
    """

    criteria: Sequence[Criterion]
    first: Sequence[Criterion] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "criteria", tuple(self.criteria))
        object.__setattr__(self, "first", tuple(self.first))
        strangers = [c for c in (*self.first, *self.criteria) if not isinstance(c, Criterion)]
        if not self.criteria or strangers:
            raise SettingsError(f"criteria must be one or more Criterion, got {strangers or 'none'}")

    def prefer(self, challenger: Experiment, incumbent: Experiment) -> Preference:
        """Return which experiment is better, as in eq. pref_fun."""
        return self.decide(challenger, incumbent)[0]

    def decide(self, challenger: Experiment, incumbent: Experiment) -> tuple[Preference, Criterion | None]:
        """Return which one is better, and the deciding criterion; None if there is none."""
        for criterion in (*self.first, _SURVIVAL, *self.criteria):
            verdict = criterion.compare(challenger, incumbent)
            if verdict is not Preference.TIE:
                return verdict, criterion
            if criterion is _SURVIVAL and challenger.end.interrupted:
                break  # both stopped at the same time: the remaining criteria do not apply
        return Preference.TIE, None


def _survival(experiment: Experiment) -> float:
    """Return the time it survived; of several runs, that of the first one to be stopped."""
    runs = experiment.runs or (experiment,)
    return min(e.duration if e.end.interrupted else np.inf for e in runs)


_SURVIVAL = Criterion("survival", _survival, lower_is_better=False)
