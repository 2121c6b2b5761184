"""The history: which samples were stored, what was answered, and what follows from both.

It is the part that all preference-based agents share. Frozen: every change gives a new one.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from prefcal_env.errors import ProtocolError
from prefcal_env.preferences.answer import Answer
from prefcal_env.preferences.best import Verdict, best_of, unsafe_indices

from .marks import Marks


@dataclass(frozen=True, slots=True)
class Comparison:
    """One closed query: sample number `challenger` against sample number `incumbent`.

    The incumbent is None for sample 0, which has nothing to be compared with, and wherever a
    score was told. A retracted answer stays on record and teaches nothing. `after` is None where
    the challenger was new; else two known samples were compared, after so many were closed.
    """

    challenger: int
    incumbent: int | None
    answer: Answer
    retracted: bool = False
    after: int | None = None

    @property
    def teaches(self) -> bool:
        """Whether it says anything about the order of its two samples."""
        return (
            self.incumbent is not None and not self.retracted and self.answer.preference is not None
        )

    @property
    def value(self) -> float | None:
        """The score of its sample, if there is one that stands."""
        return None if self.retracted else self.answer.value


@dataclass(frozen=True, slots=True)
class Preferences:
    """What M comparisons teach about N samples: the vector B of eq. pref-vector.

    Args:
        samples: Points of the unit cube, shape (N, n).
        first: i(h), the challenger of comparison h, shape (M,).
        second: j(h), the incumbent that it was compared with, shape (M,).
        b: Preference b_h in {-1, 0, 1}, shape (M,); -1: the first is better.
        weights: c_h of eq. QP-pref, above 0, shape (M,).
    """

    samples: Float[np.ndarray, "N n"]
    first: Int[np.ndarray, " M"]
    second: Int[np.ndarray, " M"]
    b: Int[np.ndarray, " M"]
    weights: Float[np.ndarray, " M"]

    def __len__(self) -> int:
        return len(self.b)

    def subset(self, rows: Int[np.ndarray, " K"]) -> "Preferences":
        """Only the comparisons `rows`, on all samples."""
        return Preferences(
            self.samples, self.first[rows], self.second[rows], self.b[rows], self.weights[rows]
        )


@dataclass(frozen=True, slots=True)
class History:
    """Samples in the order proposed (the last may be pending), and the closed queries.

    Args:
        samples: Points of the unit cube that decode to the θ that ran, each of length n.
        comparisons: Comparison h closed the query of sample h.
        further: Comparisons of samples whose queries were closed, in the order answered.
    """

    samples: tuple[tuple[float, ...], ...] = ()
    comparisons: tuple[Comparison, ...] = ()
    further: tuple[Comparison, ...] = ()

    def __hash__(self) -> int:
        """Of the last sample and all lengths: hashing every KPI took a fifth of a proposal."""
        lengths = len(self.samples), len(self.comparisons), len(self.further)
        return hash((lengths, self.samples[-1:]))

    @property
    def answered(self) -> int:
        """How many samples are closed, which is also the index of the next one."""
        return len(self.comparisons)

    @property
    def pending(self) -> tuple[float, ...] | None:
        """The sample of the open query, if it is stored already."""
        return self.samples[self.answered] if len(self.samples) > self.answered else None

    @property
    def incumbent(self) -> int | None:
        """Index of the best sample, by the whole record; None before the first answer.

        Where scores were told, the first sample with the lowest; else see `best_of`.
        """
        scored, values = self.scores()
        if len(scored):
            return int(scored[np.argmin(values)])
        if not self.comparisons:
            return None
        return best_of(self.verdicts(), self.unsafe())

    def verdicts(self) -> tuple[Verdict, ...]:
        """Return the remaining answers about two samples, in the order given."""
        return tuple(
            Verdict(c.challenger, c.incumbent, c.answer.preference, c.after is not None)
            for c in self.in_order()
            if c.incumbent is not None and c.answer.preference is not None and not c.retracted
        )

    def asked(self, first: int, second: int, *, standing: bool = False) -> bool:
        """Return whether the two samples were compared, whatever was answered.

        With `standing`, answers that were retracted do not count.
        """
        asked = (c for c in self.in_order() if not (standing and c.retracted))
        return any({c.challenger, c.incumbent} == {first, second} for c in asked)

    def unsafe(self) -> frozenset[int]:
        """Return the indices of the samples that the remaining answers mark unsafe."""
        return unsafe_indices(self.comparisons) | unsafe_indices(self.further)

    def in_order(self) -> tuple[Comparison, ...]:
        """All comparisons in the order answered."""
        if not self.further:
            return self.comparisons
        keyed = [(c.challenger + 1, 0, c) for c in self.comparisons]
        keyed += [(c.after or 0, 1, c) for c in self.further]
        return tuple(c for _, _, c in sorted(keyed, key=lambda k: k[:2]))

    @property
    def latest(self) -> tuple[Comparison, ...]:
        """Those that were answered since the latest sample was proposed, its own the first."""
        since = tuple(c for c in self.further if c.after == self.answered)
        return (*self.comparisons[-1:], *since)

    def cube(self) -> Float[np.ndarray, "N n"]:
        """Samples whose queries are closed, shape (N, n); (0, 0) before the first one."""
        if not self.answered:
            return np.zeros((0, 0))
        return np.array(self.samples[: self.answered], dtype=float)

    def preferences(self) -> Preferences:
        """What the remaining answers teach."""
        lessons = [c for c in self.in_order() if c.teaches]
        return Preferences(
            samples=self.cube(),
            first=np.array([c.challenger for c in lessons], dtype=np.int64),
            second=np.array([c.incumbent for c in lessons], dtype=np.int64),
            b=np.array([c.answer.preference for c in lessons], dtype=np.int64),
            weights=np.array([c.answer.strength for c in lessons], dtype=float),
        )

    def scores(self) -> tuple[Int[np.ndarray, " K"], Float[np.ndarray, " K"]]:
        """Indices of the samples whose score stands, and the scores, both of shape (K,)."""
        known = [(c.challenger, c.value) for c in self.comparisons if c.value is not None]
        return (
            np.array([index for index, _ in known], dtype=np.int64),
            np.array([value for _, value in known], dtype=float),
        )

    def outcomes(self) -> tuple[Mapping[str, float], ...]:
        """KPIs of each sample whose query is closed, lower is better; empty where none are known.

        They are what happened: a retracted verdict leaves them.
        """
        known: list[Mapping[str, float]] = [{} for _ in self.comparisons]
        for c in self.comparisons:
            pair = c.answer.outcomes or (None, None)
            for index, outcome in zip((c.challenger, c.incumbent), pair, strict=True):
                if index is not None and outcome and not known[index]:
                    known[index] = outcome
        return tuple(known)

    def marks(self) -> Marks:
        """What the remaining answers mark."""
        return Marks.of(self.in_order(), self.cube())

    def until(self, count: int) -> "History":
        """The first `count` samples and their answers, further ones among them included."""
        further = tuple(c for c in self.further if c.after is not None and c.after <= count)
        return History(self.samples[:count], self.comparisons[:count], further)

    def with_pending(self, z: Float[np.ndarray, " n"]) -> "History":
        """Store `z`, shape (n,), as the sample of the open query."""
        return replace(self, samples=(*self.samples[: self.answered], tuple(map(float, z))))

    def told(self, answer: Answer, incumbent: int | None) -> "History":
        """Close the open query, in which `incumbent` was met; its sample must be stored."""
        closed = Comparison(self.answered, incumbent, answer)
        return replace(self, comparisons=(*self.comparisons, closed))

    def told_further(self, answer: Answer, challenger: int, incumbent: int) -> "History":
        """Add the answer to a further comparison of two known samples."""
        closed = Comparison(challenger, incumbent, answer, after=self.answered)
        return replace(self, further=(*self.further, closed))

    def undone(self) -> "History":
        """Take the last answer back: its query is open again, a later sample is dropped.

        Raises:
            ProtocolError: nothing is answered.
        """
        if not self.comparisons:
            raise ProtocolError("there is no answer to undo")
        kept = self.samples[: self.answered]
        if len(self.latest) > 1:
            return History(kept, self.comparisons, self.further[:-1])
        return History(kept, self.comparisons[:-1], self.further)

    def retracted(self, index: int, *, further: bool = False) -> "History":
        """Forget what answer number `index` (from 0) taught; every sample stays.

        `further` ones are numbered on their own.

        Raises:
            ProtocolError: there is no such answer, or it is retracted already.
        """
        answers = self.further if further else self.comparisons
        if isinstance(index, bool) or not isinstance(index, (int, np.integer)):
            raise ProtocolError(f"the index of an answer must be an integer, got {index!r}")
        if not 0 <= index < len(answers):
            raise ProtocolError(
                f"there is no answer {index}: {len(answers)} are given, counted from 0"
            )
        if answers[index].retracted:
            raise ProtocolError(f"answer {index} is retracted already")
        changed = replace(answers[index], retracted=True)
        answers = (*answers[:index], changed, *answers[index + 1 :])
        return replace(self, further=answers) if further else replace(self, comparisons=answers)
