"""A taste whose standards rise as runs get better."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from .runs import Runs
from .weighted import Term, Weighted


@dataclass(frozen=True, slots=True)
class Standards:
    """A `Rule` by the final standards: the referee of a person whose standards rise.

    Args:
        first: Standards at the start.
        final: Standards at the end, with the same terms in the same order.
    """

    first: Weighted
    final: Weighted

    def cost(self, runs: Runs) -> Float[np.ndarray, " K"]:
        """Return the cost by the final standards, lower is better, shape (K,)."""
        return self.final.cost(runs)

    def compare(self, a: Runs, b: Runs) -> Int[np.ndarray, " K"]:
        """Return -1 where `a` is better by the final standards, 0 for a tie, 1 where `b` is."""
        return self.final.compare(a, b)

    def person(self) -> "Rising":
        """Return a person at the start of a study."""
        return Rising(self.first, self.final)


@dataclass(slots=True)
class Rising:
    """A `Rule` that changes: the scales shrink as runs get better, one comparison after another.

    After each comparison, the scale of a term becomes the distance of the better run if that is
    smaller, but not smaller than that of `final`.

    Args:
        now: Today's standards.
        final: Standards at the end, with the same terms in the same order.
    """

    now: Weighted
    final: Weighted

    def cost(self, runs: Runs) -> Float[np.ndarray, " K"]:
        """Return the cost by today's standards, shape (K,)."""
        return self.now.cost(runs)

    def compare(self, a: Runs, b: Runs) -> Int[np.ndarray, " K"]:
        """Return who is better by today's standards, and raise them; for a single pair."""
        verdict = self.now.compare(a, b)
        better = a if verdict[0] < 0 else b
        if np.isinf(better.survived[0]):
            pairs = zip(self.now.terms, self.final.terms, strict=True)
            self.now = Weighted(tuple(_raised(term, last, better) for term, last in pairs))
        return verdict


def _raised(term: Term, last: Term, better: Runs) -> Term:
    reached = float(better.column(term.name)[0]) - term.good
    return replace(term, scale=min(term.scale, max(reached, last.scale)))
