"""What is learned of one person from comparisons of KPIs: the door for data that no study asked for."""

from collections.abc import Iterable, Mapping, Sequence, Set, Sized
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from prefcal_env.arrays import integer
from prefcal_env.errors import PreferenceError
from prefcal_env.preferences.answer import Outcome, Reading
from prefcal_env.preferences.history import History, KPIValues

from .people import DRAWS, Bank, Lessons, Scale, Utilities, learn, worth

KPIs = Mapping[str, float]
"""KPIs of an experiment by name, lower is better; infinite means never, NaN or no entry unknown."""


class Chances(NamedTuple):
    """How probably a person gives each answer about two experiments; in all 1."""

    better: float  # that the first one is better
    same: float  # that they are about the same
    worse: float  # that the second one is better


@dataclass(frozen=True, slots=True)
class Told:
    """An answer, with the KPIs that it was about.

    Args:
        answer: -1 if the first experiment is better, 0 if both are about the same, 1 if the second is.
        first: KPIs of one experiment.
        second: KPIs of the other one.
    """

    answer: int
    first: Outcome
    second: Outcome

    @classmethod
    def all_of(cls, history: History) -> "tuple[Told, ...]":
        """Return the answers of a record that came with the KPIs of both experiments.

        Answers that are retracted, abstentions, and those about runs that were cut short are left out.
        """
        cut, found = history.cut_short, []
        for lesson in history.lessons:
            first, second = lesson.answer.outcomes or (None, None)
            # KPIs of a run that was cut short are bounds: compared as values they would teach the wrong wish.
            if first and second and not cut & {lesson.challenger, lesson.incumbent}:
                found.append(cls(int(lesson.answer.preference or 0), Outcome(first), Outcome(second)))
        return tuple(found)

    @classmethod
    def of(cls, plain: "Told | Sequence[Any]") -> "Told":
        """Read what `plain` returned. Raises PreferenceError for anything else."""
        if isinstance(plain, Told):
            return plain
        try:
            answer, *sides = plain
            first, second = (Outcome.from_dict(dict(side)) for side in sides)
            ((said, _),) = _check([answer], [(first, second)])
        except (TypeError, ValueError) as error:
            raise PreferenceError(f"an answer that travels cannot be {plain!r}") from error
        return cls(int(said), first, second)

    @property
    def plain(self) -> tuple[Any, ...]:
        """Return plain data for JSON."""
        return (self.answer, *(tuple(side.to_dict().items()) for side in (self.first, self.second)))


def lessons_of(
    told: Sequence[Told], scale: Scale, strength: float = 1.0, reading: Reading | None = None
) -> Lessons:
    """Return answers as arrays; a KPI that both experiments lack makes no difference."""
    sides = [*(each.first for each in told), *(each.second for each in told)]
    # Infinite on both sides is the same on both sides. If one lacks it, that one counts as never arriving.
    kpis = np.array([[side.get(name, np.inf) for name in scale.names] for side in sides], dtype=float)
    kpis = kpis.reshape(len(sides), len(scale.names))
    seen = kpis if reading is None else reading.table(scale.names, kpis)
    # Rows 0 ... m - 1 hold the first experiments, m ... 2m - 1 the second ones.
    said, first = np.array([each.answer for each in told], dtype=np.int64), np.arange(len(told))
    # Of a tie either may stand first: only whether the difference is noticed counts.
    better, worse = np.where(said > 0, [first + len(told), first], [first, first + len(told)])
    return Lessons(scale.logs(seen), better, worse, said == 0, np.full(len(told), strength))


@dataclass(frozen=True, eq=False, slots=True)
class Taste:
    """What a person wants from KPIs, as far as their answers tell.

    `Taste.learn` and `Taste.of` make one. It is what `Screening` learns of a person; how often its
    probabilities come true with real people is in docs/research/people.md.

    Args:
        scale: How KPIs are measured.
        utilities: Draws of what the person wants, given the answers.
    """

    scale: Scale
    utilities: Utilities

    @classmethod
    def learn(
        cls,
        answers: Sequence[int],
        kpis: Sequence[tuple[KPIs, KPIs]],
        seed: int = 0,
        *,
        usual: Sequence[KPIs] = (),
    ) -> "Taste":
        """Learn from m answers.

        Args:
            answers: What the person said of each pair, length m: -1 if the first one is better, 0 if
                they are about the same, 1 if the second one is.
            kpis: KPIs of the two experiments of each pair, length m.
            seed: Seed of all randomness.
            usual: KPIs of further experiments, which tell together with the others which values are
                usual. A KPI that is always the same tells nothing.

        Raises:
            PreferenceError: If the lengths differ, an answer is none of the three, a KPI is no number,
                no experiment is given, or the seed is no whole number, 0 or more.
        """
        pairs = _check(answers, kpis)
        told = [Told(int(answer), Outcome(a), Outcome(b)) for answer, (a, b) in pairs]
        return cls._of(told, seed, _several("usual KPIs", usual))

    @classmethod
    def of(cls, history: History, seed: int = 0) -> "Taste":
        """Learn from the answers of a study that came with the KPIs of both experiments.

        Raises:
            PreferenceError: If there is none.
        """
        return cls._of(Told.all_of(history), seed)

    @classmethod
    def _of(cls, told: Sequence[Told], seed: int, usual: Sequence[KPIs] = ()) -> "Taste":
        integer("seed", seed, low=0, error=PreferenceError)
        # Without a bank of simulations, the experiments themselves say which values are usual.
        table = [*(each.first for each in told), *(each.second for each in told), *usual]
        if not table:
            raise PreferenceError("a taste needs the KPIs of experiments: give answers, or usual ones")
        bank = _bank(table)
        # The same seed gives the same taste: predictions are functions of the answers.
        scale, rng = Scale.of(bank, np.arange(len(bank))), np.random.default_rng(seed)
        utilities = Utilities.draw(scale, DRAWS, rng)
        return cls(scale, learn(utilities, lessons_of(told, scale), scale, rng))

    def predict(self, a: KPIs, b: KPIs) -> Chances:
        """Predict the answer to "which is better, a or b?".

        Raises:
            PreferenceError: If a KPI is no number, or one that was learned is missing in both.
        """
        # Three possible answers about the same pair: a wins, b wins, a tie.
        levels, one = self.utilities.levels(self._logs([a, b])), np.array([0, 1, 0])
        tie = np.array([False, False, True])
        gain = self.utilities.gain(self.utilities.differences(levels, one, 1 - one))
        logs = self.utilities.log_answers(gain, tie)
        # The mean over draws, mistakes included, so that a sure prediction is rare: research/people.md.
        better, worse, same = (np.exp(logs).mean(axis=0)).tolist()
        return Chances(better, same, worse)

    def rank(self, table: Sequence[KPIs]) -> tuple[int, ...]:
        """Rank experiments: return their numbers in `table`, the most promising one first.

        Raises:
            PreferenceError: If a KPI is no number, or one that was learned is missing in all.
        """
        table = _several("a table", table)
        if not table:
            return ()
        value = worth(self.utilities.costs(self._logs(table))).mean(axis=0)
        return tuple(np.argsort(-value, kind="stable").tolist())

    def _logs(self, table: Sequence[KPIs]) -> Float[np.ndarray, "m k"]:
        bank = _bank(table)
        lacking = sorted(set(self.scale.names) - set(bank.names))
        if lacking:
            raise PreferenceError(
                f"this taste is about {list(self.scale.names)}, but {lacking} are not given"
            )
        return self.scale(bank)


def _check(answers: Sequence[int], kpis: Sequence[tuple[KPIs, KPIs]]) -> list[tuple[int, tuple[KPIs, KPIs]]]:
    """Return each answer with its pair; raise PreferenceError if there are not as many of both."""
    answers, kpis = _several("answers", answers), _several("pairs of KPIs", kpis)
    if len(answers) != len(kpis):
        raise PreferenceError(f"each answer needs a pair of KPIs: {len(answers)} answers, {len(kpis)} pairs")
    for answer, pair in zip(answers, kpis, strict=True):
        if answer not in (-1, 0, 1):
            raise PreferenceError(f"an answer must be -1, 0 or 1, got {answer!r}")
        if isinstance(pair, Mapping) or not isinstance(pair, Sized) or len(pair) != 2:
            raise PreferenceError(f"a pair of KPIs must be two experiments, got {pair!r}")
    return list(zip(answers, kpis, strict=True))


def _several(what: str, given: Sequence[Any]) -> Sequence[Any]:
    """Return what was given, in order; raise PreferenceError if it is one thing, and no sequence."""
    if isinstance(given, str | Mapping | Set) or not isinstance(given, Iterable):
        raise PreferenceError(f"{what} must be several, in order, got {given!r}")
    return [*given]


def _bank(table: Sequence[KPIs]) -> Bank:
    """Return experiments as a bank; they have no θ, so each has its number for one."""
    # A bank keeps one row for each θ, so without numbers all rows but the first would vanish.
    number = np.arange(len(table), dtype=float)[:, None]
    return Bank.of(number, number, KPIValues.of([Outcome(kpis) for kpis in table]))
