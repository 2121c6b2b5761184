"""Select the models of GLISp after each experiment (shapes of φ, noise test), and train Ĵ."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import final

import numpy as np
from jaxtyping import Int

from prefcal_agents.history.lessons import MOST, Memory, Preferences, judged, kpis_of
from prefcal_agents.history.stages import Remembered, Stages
from prefcal_agents.models.cross_validation import FOLDS, Validation, choose_epsilon, nearest, rescale_knob
from prefcal_agents.models.gaussian_process import ExpectationPropagation
from prefcal_agents.models.preference_qp import Constraints, Learning, fit, margins
from prefcal_agents.models.rbf import Shape, Surrogate
from prefcal_env.preferences.best import contradictory
from prefcal_env.preferences.history import History

from .kpi_fit import KPIFit, kpi_fits
from .noise_test import MANY, WINDOW, NoiseTest, evidence_of_mistakes, rows_of, suited_shape
from .settings import EPSILONS, EVERY_STEP, GLISpSettings, GLISpSetup

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


@dataclass(frozen=True, slots=True, eq=False)
class _Stage:
    """What is chosen after a number of experiments.

    Args:
        shape: Shape of φ, by cross-validation.
        suited: Shape of φ that suits a fallible person.
        tested: `suited` at the latest noise test; None without one.
        tests: Functions that return the evidence of the latest noise tests, the last one first. It
            is computed once it is needed, since a study that is opened needs few of them.
    """

    shape: Shape
    suited: Shape
    tested: Shape | None = None
    tests: tuple[Callable[[], float], ...] = ()


@final
class ModelSelection:
    """Selections after each number of experiments, each starting from the one before.

    They follow from the history alone, and copies of an agent share them: memory only saves time.
    """

    def __init__(self, setup: GLISpSetup) -> None:
        self.setup, settings, alike = setup, setup.settings, (1.0,) * len(setup.space)
        self._settings, self._n_init, self._seed = settings, setup.n_init, setup.seed
        self._learning = Learning(margin_power=settings.margin_power)
        self._candidates: Sequence[float] = tuple(settings.epsilon * factor for factor in EPSILONS)
        first = _Stage(Shape(settings.epsilon, alike, settings.rbf), Shape(1.0, alike, settings.rbf))
        self._stages = Stages(lambda: first, self._following, whole=True)
        self._kpi_fits = kpi_fits(setup.seed) if settings.kpis else None
        self.dataset = Remembered(Dataset.of)
        """Training data in a history."""
        self.after = Remembered(self._selection)
        """What is selected after a history."""
        self._explained = Remembered(self._explains)

    def fit(self, history: History) -> Fit:
        """Return what is learned from `history`."""
        return Fit(self.dataset(history), self.after(history), self.kpi_fit(history))

    def kpi_fit(self, history: History) -> KPIFit | None:
        """Return what KPIs teach after `history`; None if they do not explain the answers."""
        if self._kpi_fits is None or not any(kpis_of(history)):
            return None
        history = judged(history)
        fit = self._kpi_fits.after(history)
        if not fit.teaches or not history.lessons():
            return None
        then = history.until(history.answered - history.answered % _TESTED)
        return fit if self._explained(then) else None

    def knows(self, history: History) -> bool:
        """Return whether what KPIs teach after `history` is remembered, so that it takes no time."""
        return self._kpi_fits is None or self._kpi_fits.knows(judged(history))

    def _explains(self, history: History) -> bool:
        """Return whether KPIs explain the answers of `history`."""
        return self._kpi_fits is None or self._kpi_fits.after(history).explains(history)

    def _selection(self, history: History) -> Selection:
        stage = self._stages.after(history)
        if stage.tested is None:
            return Selection(stage.shape, None, is_noisy=False)
        noise = NoiseTest(stage.tested, float(np.mean([test() for test in stage.tests])))
        noisy = noise.suspects and contradictory(history.verdicts())
        return Selection(stage.shape, noise, noisy)

    def _following(self, past: History, before: History, stage: _Stage) -> _Stage:
        """Return what is chosen after `past`, given that after one experiment less."""
        count, rate = past.answered, self._settings.error_rate
        validates = self._is_validated(count)
        # In long studies, a noise test runs every ten experiments, and its shape is settled.
        settled = count > MANY and len(past.lessons()) > MANY and count % SELDOM
        fallible = rate and count >= self._n_init
        if not validates and (settled or not fallible):
            return stage
        data = self.dataset(past)
        shape = self._validated(data, stage.shape) if validates else stage.shape
        if not fallible:
            return replace(stage, shape=shape)
        known, first = data.preferences, count == self._n_init
        suited = suited_shape(known, stage.suited, rate, answered=count, first=first)
        if count > MANY and count % SELDOM:
            return replace(stage, shape=shape, suited=suited)
        test: Callable[[], float] = cache(partial(evidence_of_mistakes, known, suited, rate))
        tests = (test, *stage.tests[: WINDOW - 1])
        return _Stage(shape, suited, suited if data.is_strict else None, tests)

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
        comparisons, count = len(data.preferences), data.history.answered
        if comparisons < FOLDS:
            return shape
        rng = np.random.default_rng([self._seed, count, 1])
        validation = Validation.deal(data.preferences, self._learning, rng)
        candidates, reach = self._candidates, 1
        if comparisons > MANY:  # ε hardly changes any more, and each try takes tens of milliseconds
            candidates, reach = nearest(candidates, shape.epsilon, 1), 0
        shape, score = choose_epsilon(validation, shape, candidates)
        if not self._settings.rescale:
            return shape

        def judge(rescaled: Shape) -> tuple[Shape, float]:
            return choose_epsilon(validation, rescaled, around)

        around = nearest(candidates, shape.epsilon, reach)
        return rescale_knob(shape, score, self._validations(count) % len(shape.scales), judge)

    def _validations(self, count: int) -> int:
        """Return about how many validations there have been: none at the process's turns."""
        if count > MANY:
            return count // SELDOM
        turns = process_turns(count, self._n_init) if self._settings.process else 0
        return count - turns


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


def train(data: Dataset, selection: Selection, settings: GLISpSettings) -> Surrogate:
    """Return Ĵ, trained on `data` with the selected shape and weights.

    Source: eq. QP-pref.
    Deviation: if answers may be wrong (`is_noisy`), Ĵ need not reproduce all; see
    `ExpectationPropagation`.
    """
    if selection.is_noisy:
        assert selection.noise is not None
        shape, posterior = selection.noise.shape, trust(data, selection, settings.error_rate)
        return Surrogate(data.preferences.samples, posterior.mean, shape)
    preferences, shape = data.preferences, selection.shape
    margin = margins(preferences, settings.margin_power)
    features = shape.basis(preferences.samples, preferences.samples)
    constraints = Constraints.of(preferences, features, margin)
    v = fit(constraints, Learning(margin_power=settings.margin_power))
    return Surrogate(preferences.samples, v, shape)


def trust(data: Dataset, selection: Selection, error_rate: float) -> ExpectationPropagation:
    """Return the posterior of β if each answer is wrong with probability `error_rate`."""
    assert selection.noise is not None
    rows = rows_of(data.preferences, selection.noise.shape)
    return ExpectationPropagation.of(rows, error_rate)
