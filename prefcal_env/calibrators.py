"""Calibrators: a person, a latent cost with its errors, and a list of priorities."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from .arrays import integer, number
from .errors import SettingsError
from .experiments.experiment import Experiment
from .preferences.answer import Answer, Preference


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

    ask: Callable[[Experiment, Experiment], Any]
    shuffle: int | None = None
    _rng: np.random.Generator | None = field(init=False, repr=False, default=None)

    def __post_init__(self) -> None:
        if not callable(self.ask):
            raise SettingsError(f"ask must be a function of two experiments, got {self.ask!r}")
        if self.shuffle is not None:
            integer("shuffle", self.shuffle, low=0)
            self._rng = np.random.default_rng(self.shuffle)

    def prefer(self, challenger: Experiment, incumbent: Experiment) -> Answer | Preference | None:
        """Ask the person, and mirror their answer if the sides were swapped."""
        swapped = self._rng is not None and self._rng.random() < 0.5
        said = self.ask(incumbent, challenger) if swapped else self.ask(challenger, incumbent)
        answer = _turned(Answer.of(said)) if swapped else Answer.of(said)
        # Of the kind that was returned: who gives a number does not expect an `Answer`.
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


# --- A calibrator that judges by a cost, and its errors.


@runtime_checkable
class Noise(Protocol):
    """A symmetric distribution of errors in comparing two costs."""

    def draw(self, generator: np.random.Generator) -> float:
        """Return one error of a difference of costs, in the unit of the cost."""


@dataclass(frozen=True, slots=True)
class Thurstone:
    """Normal noise of standard deviation `sigma` on each perceived cost (case V).

    The error of a difference is normal with standard deviation √2 `sigma`.

    Raises:
        SettingsError: If `sigma` is not positive and finite.
    """

    sigma: float

    def __post_init__(self) -> None:
        number("sigma", self.sigma, strict=True)

    def draw(self, generator: np.random.Generator) -> float:
        """Return one error of a difference of costs, in the unit of the cost."""
        # Both costs have an error of their own: variances add up.
        return float(np.sqrt(2) * self.sigma * generator.standard_normal())


@dataclass(frozen=True, slots=True)
class BradleyTerry:
    """Logistic noise: a beats b with probability 1/(1 + exp((cost(a) - cost(b))/scale)).

    The error of a difference is logistic.

    Raises:
        SettingsError: If `scale` is not positive and finite.
    """

    scale: float

    def __post_init__(self) -> None:
        number("scale", self.scale, strict=True)

    def draw(self, generator: np.random.Generator) -> float:
        """Return one error of a difference of costs, in the unit of the cost."""
        return float(generator.logistic(scale=self.scale))


def generator_of_pair(
    seed: int, a: Float[np.ndarray, " n"], b: Float[np.ndarray, " n"]
) -> np.random.Generator:
    """Return a generator that depends on `seed` and the two θ, shape (n,), but not their order."""
    pair = sorted((tuple(a + 0.0), tuple(b + 0.0)))  # + 0.0 turns -0.0 into 0.0
    key = np.array(pair).view(np.uint32).ravel()
    return np.random.default_rng([int(seed), *key.tolist()])


@dataclass(frozen=True)
class LatentCost:
    """A `Calibrator` that prefers the experiment with the lower perceived `cost`.

    Perceived costs within `tie_band` of each other are a tie, and so are equal θ. The error of a
    comparison depends only on `seed` and the two θ: the answer is the same if the question is
    repeated or asked the other way round.

    Source: eq. pref_fun, with f hidden.

    Args:
        cost: Function that returns the cost of an experiment; lower is better, may be infinite.
        tie_band: Smallest noticeable difference of costs, 0 or more.
        noise: Distribution of errors; None for no errors.
        seed: Seed of the noise, 0 or more.

    Raises:
        SettingsError: If an option is not valid; in `prefer`, if a cost is NaN or no number.
    """

    cost: Callable[[Experiment], float]
    tie_band: float = 0.0
    noise: Noise | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        if not callable(self.cost):
            raise SettingsError(f"cost must be a function of an experiment, got {self.cost!r}")
        number("tie_band", self.tie_band)
        if self.noise is not None and not isinstance(self.noise, Noise):
            raise SettingsError(f"noise must be Thurstone, BradleyTerry or None, got {self.noise!r}")
        integer("seed", self.seed, low=0)

    def prefer(self, challenger: Experiment, incumbent: Experiment) -> Preference:
        """Return which one is better, as in eq. pref_fun."""
        a, b = self._cost(challenger), self._cost(incumbent)
        difference = 0.0 if a == b else a - b  # two infinite costs are equal
        # An error has no effect on an infinite difference, and may turn round any other.
        if self.noise is not None:
            difference += self._error(challenger.theta, incumbent.theta)
        if abs(difference) <= self.tie_band:
            return Preference.TIE
        return Preference.CHALLENGER if difference < 0 else Preference.INCUMBENT

    def _cost(self, experiment: Experiment) -> float:
        found: Any = self.cost(experiment)
        try:
            cost = float(found)
        except (TypeError, ValueError):
            cost = np.nan
        if np.isnan(cost):
            raise SettingsError(f"cost must be a number, got {found!r} at θ = {experiment.theta}")
        return cost

    def _error(self, a: Float[np.ndarray, " n"], b: Float[np.ndarray, " n"]) -> float:
        """Return the error of cost(a) - cost(b): antisymmetric in a and b, so 0 for equal θ."""
        assert self.noise is not None
        if np.array_equal(a, b):
            return 0.0
        error = self.noise.draw(generator_of_pair(self.seed, a, b))
        # One draw for both orders, with the sign of the order: asked the other way round, the error turns,
        # too.
        return error if tuple(a) < tuple(b) else -error


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
        # a == b, too: infinite minus infinite is NaN, which is not below anything.
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
    # Completed runs all count the same, however long they took to settle.
    return min(e.duration if e.end.interrupted else np.inf for e in runs)


_SURVIVAL = Criterion("survival", _survival, lower_is_better=False)
