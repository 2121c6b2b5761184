"""Whether answers contradict each other, and the shape of φ that suits them then."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float, Int

from prefcal_env.knobs import KnobSpace

from .belief import Belief
from .cross_validation import nearest
from .fitting import Constraints
from .ledger import Ledger, Preferences
from .memory import Memory
from .schedule import MANY, SELDOM
from .surrogate import Shape

Columns = Callable[[Ledger], Float[np.ndarray, "N p"] | None]

ALMOST_SURE = 0.003
"""Error rate of somebody who is as good as never wrong: 0 would allow no surrogate to be."""
_ENOUGH = 1.0
"""By how much better (in nats) answers must be predicted as a fallible person's."""
_WINDOW = 10
"""Doubts that are averaged: a cost that jumps looks like mistakes for a moment. By one doubt alone
calibrators of the reactor who never err were often taken for fallible, which cost experiments."""
_EPSILONS = (0.32, 0.56, 1.0, 1.8, 3.2, 5.6)
_WIDEST = 16.0  # largest ratio between the scales of two knobs


@dataclass(frozen=True, slots=True)
class Doubt:
    """How well answers are predicted if each is wrong with some chance, and if none is.

    Args:
        shape: Of φ, with which a fallible person's answers are predicted best.
        evidence: By how much better (in nats) than a person's who is never wrong, on average of
            the last doubts; above 0 speaks for mistakes.
    """

    shape: Shape
    evidence: float

    @property
    def justified(self) -> bool:
        """Whether answers are to be taken for a fallible person's."""
        return self.evidence > _ENOUGH


@dataclass(frozen=True, slots=True)
class Doubts:
    """What is doubted after any ledger; a function of each alone.

    Args:
        space: The knobs.
        rbf: φ of eq. rbf.
        n_init: Samples of the start, during which nothing is doubted.
        error_rate: Chance that an answer of a fallible person is wrong; 0: nobody errs.
        shapes: Ledger to the shape that suits a fallible person's answers; a cache, which changes
            no result.
        known: Ledger to the evidence after it alone; a cache too.
    """

    space: KnobSpace
    rbf: str
    n_init: int
    error_rate: float
    shapes: dict[Ledger, Shape] = field(default_factory=dict, repr=False, compare=False)
    known: dict[Ledger, float] = field(default_factory=dict, repr=False, compare=False)

    def after(self, ledger: Ledger, columns: Columns) -> Doubt | None:
        """What is doubted after `ledger`, or after an earlier one where that takes long.

        None while there are too few answers.

        Args:
            ledger: Samples and answers.
            columns: From a ledger, KPIs that may explain its answers, of the N samples that are
                remembered, shape (N, p), or None.
        """
        count = ledger.answered
        if count > MANY:
            count -= count % SELDOM
        ledger = ledger.until(count)
        if not self.error_rate or count < self.n_init:
            return None
        if not np.any(ledger.preferences().b):
            return None
        found: list[float] = []
        while len(found) < _WINDOW and count >= self.n_init:
            found.append(self._evidence(ledger.until(count), columns))
            count -= 1 if count <= MANY else SELDOM
        return Doubt(self._shape(ledger), float(np.mean(found)))

    def _evidence(self, ledger: Ledger, columns: Columns) -> float:
        """By how much better the answers are predicted as a fallible person's, in nats."""
        if ledger not in self.known:
            preferences = Memory.of(ledger).ledger.preferences()
            if not np.any(preferences.b):
                return 0.0
            constraints = rows_of(preferences, self._shape(ledger), columns(ledger))
            rates = (self.error_rate, ALMOST_SURE)
            fallible, sure = (Belief.of(constraints, e).foretold for e in rates)
            self.known[ledger] = fallible - sure
        return self.known[ledger]

    def take_over(self, other: "Doubts") -> None:
        """Know what `other` knows, of the same study."""
        self.shapes.update(other.shapes)
        self.known.update(other.known)

    def _shape(self, ledger: Ledger) -> Shape:
        """The shape in use after `ledger`: each is looked for from the one before."""
        missing: list[Ledger] = []
        shape = Shape(1.0, (1.0,) * len(self.space), self.rbf)
        for count in range(ledger.answered, self.n_init - 1, -1):
            prefix = ledger.until(count)
            if prefix in self.shapes:
                shape = self.shapes[prefix]
                break
            missing.append(prefix)
        for prefix in reversed(missing):
            shape = self._suited(prefix, shape)
            self.shapes[prefix] = shape
        return shape

    def _suited(self, ledger: Ledger, shape: Shape) -> Shape:
        """The better shape next to `shape`, by how well the answers of `ledger` are predicted.

        ε moves to a neighbour (in the beginning anywhere), and the scale of one knob by a factor
        of 2 (the knobs take turns).
        """
        preferences = ledger.preferences()
        if not np.any(preferences.b) or len(preferences) > MANY:
            return shape

        def score(shape: Shape) -> float:
            return Belief.of(rows_of(preferences, shape), self.error_rate).foretold

        begun = ledger.answered > self.n_init
        candidates = nearest(_EPSILONS, shape.epsilon, 1) if begun else _EPSILONS
        best, epsilon = max((score(replace(shape, epsilon=x)), x) for x in candidates)
        return _rescaled(replace(shape, epsilon=epsilon), best, score, ledger.answered)


def rows_of(
    preferences: Preferences, shape: Shape, columns: Float[np.ndarray, "N p"] | None = None
) -> Constraints:
    """Comparisons as signs of rows · β, with p KPIs (columns) that may explain them too."""
    features = shape.basis(preferences.samples, preferences.samples)
    constraints = Constraints.of(preferences, features, np.ones(len(preferences)))
    return constraints if columns is None else constraints.with_outcomes(preferences, columns)


def _rescaled(shape: Shape, best: float, score: Callable[[Shape], float], turn: int) -> Shape:
    n = len(shape.scales)
    for factor in (2.0, 0.5) if n > 1 else ():
        scales = np.array(shape.scales)
        scales[turn % n] *= factor
        scales /= np.exp(np.mean(np.log(scales)))
        if scales.max() > _WIDEST * scales.min():
            continue
        changed = replace(shape, scales=tuple(map(float, scales)))
        found = score(changed)
        if found > best + _ENOUGH:
            shape, best = changed, found
    return shape


def contenders(ledger: Ledger) -> Int[np.ndarray, " K"]:
    """The samples that were compared and are not marked unsafe; all compared if all are."""
    preferences, marks = ledger.preferences(), ledger.marks()
    strict = preferences.b != 0
    compared = np.unique(np.concatenate([preferences.first[strict], preferences.second[strict]]))
    samples, unsafe = ledger.cube(), marks.samples[marks.unsafe]
    safe = [i for i in compared if not np.any(np.all(unsafe == samples[i], axis=1))]
    return np.array(safe or compared, dtype=np.int64)
