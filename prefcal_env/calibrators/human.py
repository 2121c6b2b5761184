"""A person as a calibrator: whoever answers a function of two experiments."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from prefcal_env.errors import SettingsError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.preferences.answer import Answer, Mark, Preference

Ask = Callable[[Experiment, Experiment], Any]

_OTHER_SIDE = {
    Mark.CHALLENGER_UNSAFE: Mark.INCUMBENT_UNSAFE,
    Mark.INCUMBENT_UNSAFE: Mark.CHALLENGER_UNSAFE,
    Mark.CHALLENGER_GOOD_ENOUGH: Mark.INCUMBENT_GOOD_ENOUGH,
    Mark.INCUMBENT_GOOD_ENOUGH: Mark.CHALLENGER_GOOD_ENOUGH,
}


@dataclass
class HumanCalibrator:
    """Asks a person, in a notebook say, which of two experiments is better.

    The query window is the comfortable way; this one fits in five lines of a notebook.

    Args:
        ask: Called with two experiments; gives -1 where the first is better, 1 where the second
            is, 0 where they are the same, None for "can't tell", or an `Answer` about the two:
            `Answer(-1, strength=Strength.MUCH_BETTER)` where the first is much better.
        shuffle: A seed, 0 or more: the challenger then comes first or second by chance, so that
            nobody can know which one is new. None: the challenger is always the first.

    Raises:
        SettingsError: `ask` cannot be called, or an impossible seed.
        PreferenceError: in `prefer`, an answer that is none.
    """

    ask: Ask
    shuffle: int | None = None
    _rng: np.random.Generator | None = field(init=False, repr=False, default=None)

    def __post_init__(self) -> None:
        if not callable(self.ask):
            raise SettingsError(f"ask must be a function of two experiments, got {self.ask!r}")
        if self.shuffle is None:
            return
        integer = isinstance(self.shuffle, (int, np.integer)) and not isinstance(self.shuffle, bool)
        if not integer or self.shuffle < 0:
            raise SettingsError(f"shuffle must be a seed of 0 or more, got {self.shuffle!r}")
        self._rng = np.random.default_rng(self.shuffle)

    def prefer(self, challenger: Experiment, incumbent: Experiment) -> Answer | Preference | None:
        """Ask, and turn the answer back where the sides were swapped."""
        swapped = self._rng is not None and self._rng.random() < 0.5
        said = self.ask(incumbent, challenger) if swapped else self.ask(challenger, incumbent)
        answer = _turned(Answer.of(said)) if swapped else Answer.of(said)
        return answer if isinstance(said, Answer) else answer.preference


def _turned(answer: Answer) -> Answer:
    """The same answer, about the sides the other way round."""
    preference = None if answer.preference is None else Preference(-answer.preference)
    outcomes = None if answer.outcomes is None else answer.outcomes[::-1]
    return Answer(
        preference, answer.strength, tuple(_OTHER_SIDE[m] for m in answer.marks), outcomes,
        automatic=tuple(_OTHER_SIDE[m] for m in answer.automatic),
    )  # fmt: skip
