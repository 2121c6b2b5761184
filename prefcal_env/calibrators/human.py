"""A person as a calibrator, asked through a function of two experiments."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from prefcal_env.arrays import integer
from prefcal_env.errors import SettingsError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.preferences.answer import Answer, Preference

Ask = Callable[[Experiment, Experiment], Any]


@dataclass
class HumanCalibrator:
    """A calibrator that asks a person, in a notebook for example, which experiment is better.

    The query window is more comfortable; this class fits in five lines of a notebook.

    Args:
        ask: Function of two experiments. Returns -1 if the first is better, 1 if the second is
            better, 0 if they are the same, None for "can't tell", or an `Answer` about the two,
            such as `Answer(-1, marks=(Mark.INCUMBENT_UNSAFE,))` if the second is also unsafe.
        shuffle: Seed, 0 or more, that puts the challenger first or second at random, so that
            people cannot know which one is new. With None the challenger always comes first.

    Raises:
        SettingsError: If `ask` is not callable or the seed is not valid.
        PreferenceError: If the answer to `prefer` is not valid.
    """

    ask: Ask
    shuffle: int | None = None
    _rng: np.random.Generator | None = field(init=False, repr=False, default=None)

    def __post_init__(self) -> None:
        if not callable(self.ask):
            raise SettingsError(f"ask must be a function of two experiments, got {self.ask!r}")
        if self.shuffle is None:
            return
        integer("shuffle", self.shuffle, low=0)
        self._rng = np.random.default_rng(self.shuffle)

    def prefer(self, challenger: Experiment, incumbent: Experiment) -> Answer | Preference | None:
        """Ask the person, and mirror their answer if the sides were swapped."""
        swapped = self._rng is not None and self._rng.random() < 0.5
        said = self.ask(incumbent, challenger) if swapped else self.ask(challenger, incumbent)
        answer = _turned(Answer.of(said)) if swapped else Answer.of(said)
        return answer if isinstance(said, Answer) else answer.preference


def _turned(answer: Answer) -> Answer:
    """Return the same answer with both sides exchanged."""
    preference = None if answer.preference is None else Preference(-answer.preference)
    outcomes = None if answer.outcomes is None else answer.outcomes[::-1]
    return Answer(
        preference,
        answer.strength,
        tuple(m.mirrored for m in answer.marks),
        outcomes,
        automatic=tuple(m.mirrored for m in answer.automatic),
    )
