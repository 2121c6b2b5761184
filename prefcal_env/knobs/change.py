"""Change a space of knobs without losing any θ that was tried."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import KnobError

from .knob import Knob
from .space import KnobSpace


def respaced(old: KnobSpace, new: KnobSpace, added: Mapping[str, float] | None = None) -> KnobSpace:
    """Return a space that searches the ranges of `new` and includes every θ of `old`.

    If a range was narrowed, the search stays inside it, but agents still learn from the experiments
    outside.

    Args:
        old: Space of the experiments so far.
        new: Space to search from now on; it must have all knobs of `old`.
        added: Maps each knob that is not in `old` to its physical value in the experiments so far.

    Raises:
        KnobError: If a knob is missing, has another scale, unit or kind, or its value in the
            experiments so far is not known.
    """
    added = {} if added is None else dict(added)
    before = {knob.name: knob for knob in old}
    missing = sorted(set(before) - set(new.names))
    if missing:
        raise KnobError(f"knobs {missing} are missing: keep them, frozen at one value")
    fresh = [name for name in new.names if name not in before]
    if sorted(added) != sorted(fresh):
        raise KnobError(
            f"values in the experiments so far are needed for the added knobs {fresh}, got {sorted(added)}"
        )
    knobs = [
        _wider(knob, before[knob.name])
        if knob.name in before
        else _including(knob, added[knob.name], added[knob.name])
        for knob in new
    ]
    within = dict(zip(new.names, new.within, strict=True))
    return KnobSpace(knobs, new.constraints, within=within)


def carried(
    theta: Float[np.ndarray, " m"], old: KnobSpace, new: KnobSpace, added: Mapping[str, float] | None = None
) -> Float[np.ndarray, " n"]:
    """Return a physical θ of `old`, shape (m,), as a θ of `new`, shape (n,), with `added` values.

    Raises:
        KnobError: If `new` does not hold it, or has a knob without a value.
    """
    values = {**dict(zip(old.names, theta.tolist(), strict=True)), **(added or {})}
    unknown = [name for name in new.names if name not in values]
    if unknown:
        raise KnobError(f"no value is known for the knobs {unknown}")
    return new.check(np.array([float(values[name]) for name in new.names]))


def _wider(new: Knob, old: Knob) -> Knob:
    kind, was = (new.unit, new.scale, new.integer), (old.unit, old.scale, old.integer)
    if kind != was:
        raise KnobError(
            f"knob {new.name!r} must keep its unit, scale and kind {was}, got {kind}: "
            "give the new knob another name"
        )
    return _including(new, old.low, old.high)


def _including(knob: Knob, low: float, high: float) -> Knob:
    return replace(knob, low=min(knob.low, low), high=max(knob.high, high))
