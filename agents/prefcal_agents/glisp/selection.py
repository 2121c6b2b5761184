"""Select the models of GLISp after each experiment: shapes of φ, noise test."""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Int

from prefcal_agents.history.censored import judged
from prefcal_agents.history.lessons import MOST, Memory, Preferences, kpis_of
from prefcal_agents.models.cross_validation import (
    FOLDS,
    Validation,
    choose_epsilon,
    nearest,
    rescale_knob,
)
from prefcal_agents.models.preference_qp import Learning
from prefcal_agents.models.rbf import Shape
from prefcal_env.preferences.best import contradictory
from prefcal_env.preferences.history import History
from prefcal_env.qp import Backend

from .kpi_fit import KPIFit, kpi_fits
from .noise_test import MANY, WINDOW, NoiseTest, evidence_of_mistakes, suited_shape
from .settings import EPSILONS, EVERY_STEP, GLISpSettings

FEW = 20
"""Number of experiments before the process takes turns."""
_TESTED = 5
"""Number of experiments between two tests of whether KPIs explain the answers."""
SELDOM = 10
"""Number of experiments between two validations, or two noise tests, from then on."""
_SHAPE_AT = 5  # of ten; noise tests are at 0, so no proposal waits for both


@dataclass(frozen=True, slots=True)
class Dataset:
    """The training data in a history.

    Args:
        history: All samples and answers.
        kept: Numbers of the samples that models are trained on, increasing, shape (K,); see
            `Memory`.
        preferences: Comparisons of these samples.
    """

    history: History
    kept: Int[np.ndarray, " K"]
    preferences: Preferences

    @classmethod
    def of(cls, history: History) -> "Dataset":
        """Extract what `history` teaches."""
        memory = Memory.of(history)
        return cls(history, memory.kept, Preferences.of(memory.history))

    @property
    def is_strict(self) -> bool:
        """Return whether some answer says which of two samples is better."""
        return bool(np.any(self.preferences.b))


@dataclass(frozen=True, slots=True)
class Selection:
    """Selected settings of the models after a number of experiments.

    Args:
        shape: Shape of φ, chosen by cross-validation.
        noise: Result of the noise test; None while there are too few answers.
        is_noisy: Whether answers are treated as possibly wrong. This takes two things: some
            contradict each other, and the noise test suspects mistakes. A suspicion alone only
            leads to a question, since a cost that jumps looks like mistakes, too.
    """

    shape: Shape
    noise: NoiseTest | None
    is_noisy: bool


@dataclass(frozen=True, slots=True)
class Fit:
    """What GLISp has learned from a history: the data and selections to train its models with.

    Args:
        data: Training data in the history.
        selection: Selected settings of the models.
        kpis: What is known about a person who judges by KPIs; None if they do not explain the
            answers, or are not used.
    """

    data: Dataset
    selection: Selection
    kpis: KPIFit | None


@final
class ModelSelection:
    """Selections after each number of experiments, each starting from the one before.

    They follow from the history alone. They are remembered by the number of experiments. After an
    undo or a retraction, those from the first changed experiment on are forgotten.

    Args:
        n: Number of knobs.
        n_init: Number of samples of the start, during which nothing is selected.
        settings: Settings of the agent.
        seed: Seed of the cross-validations.
        backend: QP solver.
    """

    def __init__(
        self, n: int, n_init: int, settings: GLISpSettings, seed: int, backend: Backend
    ) -> None:
        self._n, self._n_init, self._seed = n, n_init, seed
        self._settings, self._backend = settings, backend
        self._learning = Learning(margin_power=settings.margin_power)
        self._candidates: Sequence[float] = tuple(settings.epsilon * factor for factor in EPSILONS)
        self._history = History()
        self._shapes = [settings.shape(n)]
        self._noise_shapes = [Shape(1.0, (1.0,) * n, settings.rbf)]
        self._evidence: dict[int, float] = {}
        self._kpi_fits = kpi_fits(seed) if settings.kpis else None
        self._explained: dict[int, bool] = {}
        self._made: dict[int, Selection] = {}
        self._data: Dataset | None = None

    def copy(self, settings: GLISpSettings, backend: Backend) -> "ModelSelection":
        """Return an independent twin that remembers the same selections."""
        twin = copy(self)
        twin._settings, twin._backend = settings, backend
        twin._shapes, twin._noise_shapes = self._shapes.copy(), self._noise_shapes.copy()
        twin._evidence = self._evidence.copy()
        twin._explained, twin._made = self._explained.copy(), self._made.copy()
        return twin

    def dataset(self, history: History) -> Dataset:
        """Return the training data in `history`."""
        if self._data is None or self._data.history != history:
            self._data = Dataset.of(history)
        return self._data

    def fit(self, history: History) -> Fit:
        """Return what is learned from `history`."""
        return Fit(self.dataset(history), self.after(history), self.kpi_fit(history))

    def kpi_fit(self, history: History) -> KPIFit | None:
        """Return what KPIs teach after `history`; None if they do not explain the answers."""
        if self._kpi_fits is None or not any(kpis_of(history)):
            return None
        self._follow(history)
        history = judged(history)
        fit = self._kpi_fits.after(history)
        if not fit.teaches or not history.lessons():
            return None
        tested = history.answered - history.answered % _TESTED
        if tested not in self._explained:
            then = history.until(tested)
            self._explained[tested] = self._kpi_fits.after(then).explains(then)
        return fit if self._explained[tested] else None

    def after(self, history: History) -> Selection:
        """Return what is selected after `history`."""
        self._follow(history)
        count = history.answered
        if count not in self._made:
            noise = self._noise_test(count)
            noisy = noise is not None and noise.suspects and contradictory(history.verdicts())
            shape = self._shape(count)
            self._made[count] = Selection(shape, noise, noisy)
        return self._made[count]

    def _follow(self, history: History) -> None:
        """Forget what was selected from the first number on at which `history` has changed."""
        count = shared(self._history, history)
        del self._shapes[count + 1 :], self._noise_shapes[count + 1 :]
        self._evidence = {k: made for k, made in self._evidence.items() if k <= count}
        self._explained = {k: made for k, made in self._explained.items() if k <= count}
        self._made = {k: made for k, made in self._made.items() if k <= count}
        self._history = history

    def _prefix(self, count: int) -> Dataset:
        """Return the data set after `count` experiments."""
        if count == self._history.answered:
            return self.dataset(self._history)
        return Dataset.of(self._history.until(count))

    def _shape(self, count: int) -> Shape:
        while len(self._shapes) <= count:
            number, shape = len(self._shapes), self._shapes[-1]
            if self._is_validated(number):
                shape = self._validated(self._prefix(number), shape)
            self._shapes.append(shape)
        return self._shapes[count]

    def _is_validated(self, count: int) -> bool:
        """Return whether the shape is chosen again after `count` experiments.

        "every step" leaves out the turns of the process. Beyond `MOST` experiments the shape
        stays, because some of the answers that it was chosen by are no longer used.
        """
        at = self._settings.validate_at
        if at != EVERY_STEP:
            return count in at
        if count < self._n_init:
            return False
        if count > MANY:
            return count <= MOST and count % SELDOM == _SHAPE_AT
        return not (self._settings.process and is_process_turn(count, self._n_init))

    def _validated(self, data: Dataset, shape: Shape) -> Shape:
        """Return the better shape that cross-validation finds next to `shape`."""
        settings, comparisons = self._settings, len(data.preferences)
        if comparisons < FOLDS:
            return shape
        validation, candidates = self._validation(data), self._candidates
        if comparisons > MANY:  # ε hardly changes any more, and each try takes tens of milliseconds
            candidates = nearest(candidates, shape.epsilon, 1)
        shape, score = choose_epsilon(validation, shape, candidates)
        if settings.rescale and self._n > 1:
            knob = self._validations(data.history.answered) % self._n
            around = nearest(candidates, shape.epsilon, 0 if comparisons > MANY else 1)
            shape = rescale_knob(validation, shape, score, around, knob=knob)
        return shape

    def _validations(self, count: int) -> int:
        """Return about how many validations there have been: none at the process's turns."""
        if count > MANY:
            return count // SELDOM
        turns = process_turns(count, self._n_init) if self._settings.process else 0
        return count - turns

    def _validation(self, data: Dataset) -> Validation:
        rng = np.random.default_rng([self._seed, data.history.answered, 1])
        return Validation.deal(data.preferences, self._learning, self._backend, rng)

    def _noise_test(self, count: int) -> NoiseTest | None:
        """Return the result of the noise test; in long studies, it runs every ten experiments."""
        count -= count % SELDOM if count > MANY else 0
        if not self._settings.error_rate or count < self._n_init:
            return None
        if not self._prefix(count).is_strict:
            return None
        tests: list[float] = []
        at = count
        while len(tests) < WINDOW and at >= self._n_init:
            tests.append(self._evidence_after(at))
            at -= 1 if at <= MANY else SELDOM
        return NoiseTest(self._noise_shape(count), float(np.mean(tests)))

    def _evidence_after(self, count: int) -> float:
        if count not in self._evidence:
            preferences, shape = self._prefix(count).preferences, self._noise_shape(count)
            rate = self._settings.error_rate
            self._evidence[count] = evidence_of_mistakes(preferences, shape, rate)
        return self._evidence[count]

    def _noise_shape(self, count: int) -> Shape:
        while len(self._noise_shapes) <= count:
            number, shape = len(self._noise_shapes), self._noise_shapes[-1]
            if number >= self._n_init:
                preferences, first = self._prefix(number).preferences, number == self._n_init
                shape = suited_shape(
                    preferences, shape, self._settings.error_rate, answered=number, first=first
                )
            self._noise_shapes.append(shape)
        return self._noise_shapes[count]


def shared(one: History, other: History) -> int:
    """Return the number of experiments up to which two histories are the same."""
    count = min(one.answered, other.answered)
    while count and one.until(count) != other.until(count):
        count -= 1
    return count


def is_process_turn(answered: int, n_init: int) -> bool:
    """Return whether the process makes the proposal after `answered` experiments.

    Source: none; the paper minimizes one acquisition at every step.
    Deviation: one kind of proposal keeps returning to the same place when it is wrong, so from
    `FEW` experiments on every second proposal is the process's. Before that the process settles
    too soon on one of many valleys.

    Args:
        answered: Number of answered experiments, `n_init` or more.
        n_init: Number of experiments in the initial design.
    """
    since = answered - max(n_init, FEW)
    return since >= 0 and since % 2 == 1


def process_turns(answered: int, n_init: int) -> int:
    """Return how many proposals before the one after `answered` experiments were the process's."""
    return max(0, answered - max(n_init, FEW)) // 2
