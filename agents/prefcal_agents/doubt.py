"""Whether answers contradict each other, and the shape of φ that suits them then."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from .belief import Belief
from .cross_validation import nearest
from .fitting import Constraints
from .ledger import Ledger, Preferences
from .surrogate import Shape

_SURE = 0.003
"""Error rate of somebody who is as good as never wrong: 0 would allow no surrogate to be."""
_ENOUGH = 1.0
"""By how much better (in nats) answers must be foretold as a fallible person's."""
_EPSILONS = (0.32, 0.56, 1.0, 1.8, 3.2, 5.6)
_MANY = 100  # comparisons; beyond, the shape hardly moves and every try takes long
_SELDOM = 10  # experiments between two doubts then
_WIDEST = 16.0  # largest ratio between the scales of two knobs


@dataclass(frozen=True, slots=True)
class Doubt:
    """How well answers are foretold, if each is wrong with some chance, and if none is.

    Args:
        shape: Of φ, with which a fallible person's answers are foretold best.
        evidence: By how much better (in nats) than a person's who is never wrong; above 0 speaks
            for mistakes.
    """

    shape: Shape
    evidence: float

    @property
    def justified(self) -> bool:
        """Whether answers are to be taken for a fallible person's."""
        return self.evidence > _ENOUGH


def is_weighed(count: int) -> bool:
    """Whether answers are doubted anew after `count` experiments: not always where it is slow."""
    return count <= _MANY or count % _SELDOM == 0


def rows_of(
    preferences: Preferences, shape: Shape, columns: Float[np.ndarray, "N p"] | None = None
) -> Constraints:
    """Comparisons as signs of rows · β, with p KPIs (columns) that may explain them too."""
    features = shape.features(preferences.samples)
    constraints = Constraints.of(preferences, features, np.ones(len(preferences)))
    return constraints if columns is None else constraints.with_outcomes(preferences, columns)


def doubted(
    ledger: Ledger,
    before: Shape,
    error_rate: float,
    columns: Callable[[], Float[np.ndarray, "N p"] | None],
    *,
    first: bool,
) -> Doubt:
    """What `ledger` says, the shape being found near the one that suited the ledger before.

    ε moves to a neighbour and one knob's scale by 2 (the knobs take turns) where answers are then
    foretold better as those of a fallible person.

    Args:
        ledger: At least one strict preference.
        before: Shape to begin with.
        error_rate: Chance that an answer of a fallible person is wrong.
        columns: KPIs that may explain the answers, shape (N, p), or None.
        first: Whether all ε are tried.
    """
    preferences = ledger.preferences()

    def score(shape: Shape) -> float:
        return Belief.of(rows_of(preferences, shape), error_rate).foretold

    shape = before
    if len(preferences) <= _MANY:
        candidates = _EPSILONS if first else nearest(_EPSILONS, before.epsilon, 1)
        scored = [(score(replace(before, epsilon=x)), x) for x in candidates]
        best, epsilon = max(scored)
        shape = _rescaled(replace(before, epsilon=epsilon), best, score, ledger.answered)
    constraints = rows_of(preferences, shape, columns())
    fallible, sure = (Belief.of(constraints, e).foretold for e in (error_rate, _SURE))
    return Doubt(shape, fallible - sure)


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


def believed_best(ledger: Ledger, values: Float[np.ndarray, " N"]) -> int:
    """The sample of lowest value Ĵ among those that were compared and are not marked unsafe."""
    preferences, marks = ledger.preferences(), ledger.marks()
    strict = preferences.b != 0
    compared = np.unique(np.concatenate([preferences.first[strict], preferences.second[strict]]))
    samples, unsafe = ledger.cube(), marks.samples[marks.unsafe]
    safe = [i for i in compared if not np.any(np.all(unsafe == samples[i], axis=1))]
    candidates = np.array(safe or compared)
    return int(candidates[np.argmin(values[candidates])])
