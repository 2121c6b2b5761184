"""People who err: a share of their answers is the opposite of what they mean."""

from dataclasses import dataclass, replace
from typing import Any

from prefcal_env.calibrators import generator_of_pair
from prefcal_env.errors import SettingsError
from prefcal_env.preferences.answer import Answer, Calibrator, Preference


@dataclass(frozen=True, slots=True)
class Flipping:
    """A calibrator that flips another calibrator's answer in a share of the cases.

    Which answers are wrong depends only on `seed` and the two θ: if the question is repeated or
    asked the other way round, the mistake is the same. Ties and abstentions never change.

    Args:
        calibrator: Calibrator whose answers are flipped; what it compares must have a `theta`.
        share: Share of wrong answers, from 0 to 1.
        seed: Seed that decides which answers are wrong, 0 or more.

    Raises:
        SettingsError: If the share is outside [0, 1].
    """

    calibrator: Calibrator[Any]
    share: float
    seed: int

    def __post_init__(self) -> None:
        if not 0 <= self.share <= 1:
            raise SettingsError(f"share must be in [0, 1], got {self.share!r}")

    def prefer(self, challenger: Any, incumbent: Any) -> Answer | Preference | int | None:
        """Return the calibrator's answer, or its opposite."""
        verdict = self.calibrator.prefer(challenger, incumbent)
        dice = generator_of_pair(self.seed, challenger.theta, incumbent.theta)
        if verdict is None or dice.random() >= self.share:
            return verdict
        if not isinstance(verdict, Answer):
            return Preference(-verdict)
        preference = verdict.preference
        return replace(verdict, preference=None if preference is None else Preference(-preference))
