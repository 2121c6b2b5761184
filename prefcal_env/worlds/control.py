"""Linear systems of python-control, which is not imported: who has one has loaded it."""

import re
from dataclasses import replace
from typing import Any

from prefcal_env.plants.systems import LinearSystem, of_arrays, of_fractions, sample_time


def linear_system(system: Any) -> LinearSystem:
    """Return a StateSpace or TransferFunction as matrices, with the names of its signals.

    Raises:
        PlantError: If its sample time is not stated, or a transfer function is improper.
    """
    dt = sample_time(getattr(system, "dt", None))
    states: tuple[str, ...] = ()
    if hasattr(system, "A"):
        made = of_arrays([system.A, system.B, system.C, system.D], dt)
        states = _names(system, "state")
    else:
        listed = hasattr(system, "num_list")  # since 0.10.1
        num, den = (system.num_list, system.den_list) if listed else (system.num, system.den)
        made = of_fractions(num, den, dt)
    return replace(made, inputs=_names(system, "input"), outputs=_names(system, "output"), states=states)


def _names(system: Any, kind: str) -> tuple[str, ...]:
    """Return names of signals, () where they are only numbered, as python-control does by itself."""
    labels = getattr(system, f"{kind}_labels", None) or ()
    return () if any(re.fullmatch(r"[uyx]\[\d+\]", label) for label in labels) else tuple(labels)
