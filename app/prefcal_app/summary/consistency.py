"""Measure how consistent a person's answers are: repeated questions, and cycles."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, shortest_path

from prefcal_env.preferences.answer import Preference
from prefcal_env.preferences.history import Comparison
from prefcal_env.study import State


@dataclass(frozen=True, slots=True)
class Consistency:
    """Consistency of the answers of a study.

    Args:
        repeated: Number of questions that were asked again.
        agreed: Number of those with the same answer both times.
        cycles: Cycles of experiments, by index: each is better than the next, and the last is
            better than or as good as the first. There is one for each group of experiments whose
            answers contradict each other.
    """

    repeated: int
    agreed: int
    cycles: tuple[tuple[int, ...], ...]

    @classmethod
    def of(cls, state: State) -> "Consistency":
        """Return the consistency of a study, without abstentions and retracted answers."""
        history = state.history
        by_question = {c.question: c for c in history.counting}
        pairs = [(c, o) for c in history.repeats if (o := by_question.get(c.repeats)) is not None]
        agreed = sum(c.answer.preference == o.answer.preference for c, o in pairs)
        return cls(len(pairs), agreed, _cycles([*history.counting, *history.repeats]))


def _cycles(answers: Iterable[Comparison]) -> tuple[tuple[int, ...], ...]:
    """Return a shortest cycle through a strict verdict for each strongly connected group."""
    better = set()  # (a, b): a is better than b
    as_good = set()
    for c in answers:
        if c.incumbent is None or c.retracted or c.answer.preference is None:
            continue
        pair = (c.challenger, c.incumbent)
        if c.answer.preference is Preference.TIE:
            as_good |= {pair, pair[::-1]}
        else:
            better.add(pair if c.answer.preference is Preference.CHALLENGER else pair[::-1])
    if not better:
        return ()
    edges = np.array(sorted(better | as_good))
    groups = _groups(edges)
    found = {}
    for a, b in sorted(better):
        if groups[a] == groups[b] and groups[a] not in found:
            found[groups[a]] = (a, *_path(edges, b, a))
    return tuple(found.values())


def _graph(edges: Int[np.ndarray, "m 2"]) -> csr_array:
    size = int(edges.max()) + 1
    return csr_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(size, size))


def _groups(edges: Int[np.ndarray, "m 2"]) -> list[int]:
    _, labels = connected_components(_graph(edges), directed=True, connection="strong")
    return [int(label) for label in labels]


def _path(edges: Int[np.ndarray, "m 2"], start: int, end: int) -> tuple[int, ...]:
    """Return the nodes of a shortest path from `start` to `end`, both included."""
    _, before = shortest_path(_graph(edges), unweighted=True, indices=start, return_predecessors=True)
    path = [end]
    while path[-1] != start:
        path.append(int(before[path[-1]]))
    return tuple(reversed(path))
