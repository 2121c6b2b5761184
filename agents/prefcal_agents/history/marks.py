"""Which samples are known to be unsafe, safe, and good enough."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float

from prefcal_env.preferences.answer import Mark

if TYPE_CHECKING:
    from .history import Comparison

_OF_THE_INCUMBENT = (Mark.INCUMBENT_UNSAFE, Mark.INCUMBENT_GOOD_ENOUGH)


@dataclass(frozen=True, slots=True)
class Marks:
    """What K samples that a calibrator looked at were marked as.

    Args:
        samples: Points of the unit cube, shape (K, n).
        unsafe: Shape (K,); a sample without that mark counts as safe.
        good: Whether good enough, shape (K,); never where unsafe.
    """

    samples: Float[np.ndarray, "K n"]
    unsafe: Bool[np.ndarray, " K"]
    good: Bool[np.ndarray, " K"]

    @classmethod
    def of(cls, comparisons: "Sequence[Comparison]", cube: Float[np.ndarray, "N n"]) -> "Marks":
        """Those of the answers that stand; one that says a sample is unsafe is enough.

        The answer to the first query is often given by a program: it can mark sample 0, but
        that it does not mark it says nothing.
        """
        seen: set[int] = set()
        marked: dict[Mark, set[int]] = {mark: set() for mark in Mark}
        for comparison in comparisons:
            if comparison.retracted:
                continue
            sides = (comparison.challenger, comparison.incumbent)
            seen.update(side for side in sides if side is not None and sides[1] is not None)
            for mark in comparison.answer.marks:
                side = sides[mark in _OF_THE_INCUMBENT]
                if side is not None:
                    marked[mark].add(side)
        unsafe = marked[Mark.CHALLENGER_UNSAFE] | marked[Mark.INCUMBENT_UNSAFE]
        good = marked[Mark.CHALLENGER_GOOD_ENOUGH] | marked[Mark.INCUMBENT_GOOD_ENOUGH]
        known = np.array(sorted(seen | unsafe | good), dtype=np.int64)
        return cls(
            samples=cube[known],
            unsafe=np.array([index in unsafe for index in known], dtype=np.bool_),
            good=np.array([index in good - unsafe for index in known], dtype=np.bool_),
        )
