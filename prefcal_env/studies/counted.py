"""Which experiments count as unsafe though nobody said so."""

from prefcal_env.preference import Mark

from .fold import State


def counted_unsafe(state: State) -> frozenset[int]:
    """Indices of the experiments that an answer which stands marks as unsafe by itself.

    Those of an older study whose answers say nothing of it are not among them: they do not count.
    """
    found: set[int] = set()
    for closed in (*state.closed, *state.further):
        if closed.retracted:
            continue
        if Mark.CHALLENGER_UNSAFE in closed.answer.automatic:
            found.add(closed.challenger)
        if Mark.INCUMBENT_UNSAFE in closed.answer.automatic and closed.incumbent is not None:
            found.add(closed.incumbent)
    return frozenset(found)
