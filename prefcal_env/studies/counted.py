"""Which experiments count as unsafe though nobody said so."""

from prefcal_env.champions import unsafe_indices

from .fold import State


def counted_unsafe(state: State) -> frozenset[int]:
    """Indices of the experiments that an answer which stands marks as unsafe by itself.

    Those of an older study whose answers say nothing of it are not among them: they do not count.
    """
    return unsafe_indices((*state.closed, *state.further), automatic=True)
