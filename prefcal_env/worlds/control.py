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
    inputs, outputs = _names(system, "input"), _names(system, "output")
    if hasattr(system, "A"):
        made, states = of_arrays([system.A, system.B, system.C, system.D], dt), _names(system, "state")
        return replace(made, inputs=inputs, outputs=outputs, states=states)
    listed = hasattr(system, "num_list")  # since 0.10.1
    num, den = (system.num_list, system.den_list) if listed else (system.num, system.den)
    return replace(of_fractions(num, den, dt), inputs=inputs, outputs=outputs)


def _names(system: Any, kind: str) -> tuple[str, ...]:
    """Return names of signals, () where they are only numbered, as python-control does by itself."""
    labels = getattr(system, f"{kind}_labels", None) or ()
    return () if any(re.fullmatch(r"[uyx]\[\d+\]", label) for label in labels) else tuple(labels)
