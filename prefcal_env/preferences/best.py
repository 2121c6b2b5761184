"""Determine the best experiment from the whole record of answers."""

from collections.abc import Collection, Iterable, Iterator, Sequence, Set
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

from .answer import Preference


@dataclass(frozen=True, slots=True)
class Verdict:
    """One valid answer: experiment `challenger` against experiment `incumbent`.

    A follow-up is about two experiments that had been compared before.
    """

    challenger: int
    incumbent: int
    preference: Preference
    follow_up: bool = False

    @property
    def winner(self) -> int | None:
        """Index of the better experiment; None for a tie."""
        if self.preference is Preference.TIE:
            return None
        return self.challenger if self.preference is Preference.CHALLENGER else self.incumbent

    @property
    def loser(self) -> int | None:
        """Index of the worse experiment; None for a tie."""
        winner = self.winner
        if winner is None:
            return None
        return self.incumbent if winner == self.challenger else self.challenger


def best_of(verdicts: Sequence[Verdict], unsafe: Set[int] = frozenset()) -> int:
    """Return the index of the best experiment, an undominated one (see `undominated`).

    The crown starts with experiment 0 and passes to a new experiment that wins, since that was
    compared with the best so far. A follow-up passes the crown on only if its owner lost; a
    follow-up about two others changes nothing. If the crown ends up on an experiment that is
    dominated (because an answer was retracted, or it was marked unsafe), the undominated
    experiment that won most recently is the best.

    Args:
        verdicts: Valid answers, in the order given.
        unsafe: Indices marked unsafe; they are the best only if nothing else was compared.
    """
    return next(bests([(verdicts, unsafe)]))


def bests(parts: Iterable[tuple[Sequence[Verdict], Set[int]]]) -> Iterator[int]:
    """Yield `best_of` the record after each of its parts: new verdicts, and all unsafe so far.

    The crown is passed on, not found anew, so a long record takes time in proportion to its length.
    """
    crown, known, touched = 0, list[Verdict](), set[int]()
    for verdicts, unsafe in parts:
        crown = reigns(verdicts, crown)[-1]
        touched |= {i for v in verdicts for i in (v.challenger, v.incumbent) if v.winner != i}
        known.extend(verdicts)
        # An experiment that has never lost or tied is undominated: there is no group to find.
        clear = crown not in touched and crown not in unsafe
        yield crown if clear else _undominated_one(crown, known, unsafe)


def _undominated_one(crown: int, verdicts: Sequence[Verdict], unsafe: Set[int]) -> int:
    known = {index for group in undominated(verdicts, unsafe) for index in group}
    return crown if not known or crown in known else representative(verdicts, known)


def reigns(verdicts: Sequence[Verdict], first: int = 0) -> tuple[int, ...]:
    """Return all experiments that were the best at some time, in order, from the `first` on."""
    crowned = [first]
    for verdict in verdicts:
        winner = verdict.winner
        if winner is None or winner == crowned[-1]:
            continue
        if verdict.loser == crowned[-1] or (winner == verdict.challenger and not verdict.follow_up):
            crowned.append(winner)
    return tuple(crowned)


def undominated(verdicts: Sequence[Verdict], unsafe: Set[int] = frozenset()) -> tuple[frozenset[int], ...]:
    """Return the groups of experiments that did not lose to any outside their group.

    A group is one experiment, or several that are tied or beat each other in a circle. Losing
    through a chain counts: if 3 beats 2 and 2 is as good as 1, then 3 beats 1. If there are two or
    more groups, no answer says which one is better. (They are the parts of the Schwartz set.)

    Args:
        verdicts: Valid answers.
        unsafe: Indices marked unsafe; left out if anything else was compared.
    """
    groups = _sources(verdicts)
    safe = tuple(g - unsafe for g in groups if g - unsafe)
    if safe:
        return safe
    among_safe = [v for v in verdicts if not {v.challenger, v.incumbent} & unsafe]
    return _sources(among_safe) or groups


def representative(verdicts: Sequence[Verdict], group: Collection[int]) -> int:
    """Return the member of `group` that won most recently; the first one if none ever won."""
    for verdict in reversed(verdicts):
        if verdict.winner in group:
            return int(verdict.winner)  # type: ignore[arg-type]
    return min(group)


def contradictory(verdicts: Sequence[Verdict]) -> bool:
    """Return whether some answers cannot all be right: a circle with a strict verdict in it."""
    edges = _edges(verdicts)
    if not len(edges):
        return False
    labels = _components(edges)
    strict = [(v.winner, v.loser) for v in verdicts if v.winner is not None]
    return any(labels[a] == labels[b] for a, b in strict)


def _sources(verdicts: Sequence[Verdict]) -> tuple[frozenset[int], ...]:
    """Return the strongly connected groups of "at least as good as" that nothing leads into."""
    edges = _edges(verdicts)
    if not len(edges):
        return ()
    labels = _components(edges)
    across = labels[edges[:, 0]] != labels[edges[:, 1]]
    beaten = set(labels[edges[across, 1]].tolist())
    groups: dict[int, list[int]] = {}
    for index in np.unique(edges).tolist():
        if labels[index] not in beaten:
            groups.setdefault(int(labels[index]), []).append(index)
    return tuple(sorted((frozenset(g) for g in groups.values()), key=min))


def _edges(verdicts: Sequence[Verdict]) -> Int[np.ndarray, "m 2"]:
    """Return pairs (at least as good, the other); a tie gives one in each direction."""
    edges: list[tuple[int, int]] = []
    for v in verdicts:
        if v.winner is None:
            edges += [(v.challenger, v.incumbent), (v.incumbent, v.challenger)]
        else:
            edges.append((v.winner, v.challenger + v.incumbent - v.winner))
    return np.array(edges, dtype=np.int64).reshape(-1, 2)


def _components(edges: Int[np.ndarray, "m 2"]) -> Int[np.ndarray, " N"]:
    """Return the label of each node's strongly connected component."""
    from scipy.sparse import csr_array  # takes a tenth of a second to import
    from scipy.sparse.csgraph import connected_components

    size = int(edges.max()) + 1
    graph = csr_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(size, size))
    _, labels = connected_components(graph, directed=True, connection="strong")
    return np.asarray(labels, dtype=np.int64)
