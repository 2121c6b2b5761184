"""Turn what was read from a live plant into an experiment."""

from collections.abc import Mapping, Sequence
from typing import get_args

import numpy as np
from jaxtyping import Float

from prefcal_env.experiments.experiment import End, Experiment
from prefcal_env.tables.curves import bridged
from prefcal_env.tables.recorded import recorded

from .parts import Role
from .plan import LivePlan

Row = tuple[float, Mapping[str, float]]
"""A sample: seconds since the start of the record, and the value of each tag by its key."""


def experiment_of(rig: LivePlan, theta: Float[np.ndarray, " n"], rows: Sequence[Row], end: End) -> Experiment:
    """Return the experiment of a physical θ, shape (n,), from the samples of its run.

    Where an output had bad quality, its curve is interpolated, and the signal "NAME as read" keeps
    the gaps. Inputs and references keep their latest good value meanwhile, since they are held
    between samples anyway. A run in which an output or input never had a good value has failed. An
    output whose reference never had one has no reference in this run.
    """
    read = {tag: np.array([row[tag.key] for _, row in rows]) for tag in rig.tags}
    outputs = {tag.name: values for tag, values in read.items() if tag.role == "output"}
    nothing = bool(never_good(rig, rows))
    kept = slice(0, 0) if nothing else slice(None)
    drawn = [tag for tag in rig.tags if tag.role != "reference"]
    t = np.array([instant for instant, _ in rows])[kept]
    curves = {
        role: {
            tag.name: bridged(t, values[kept], held=role != "output")
            for tag, values in read.items()
            if tag.role == role
        }
        for role in get_args(Role)
    }
    return recorded(
        theta,
        t,
        curves["output"],
        curves["input"],
        curves["reference"],
        {c.name: c.unit for c in drawn},
        {c.name: (c.low, c.high) for c in drawn},
        signals={
            f"{name} as read": values[kept]
            for name, values in outputs.items()
            if np.isnan(values[kept]).any()
        },
        kpis=rig.kpis,
        end=End.FAILED if nothing else end,
        time_unit="s",
    )


def never_good(rig: LivePlan, rows: Sequence[Row]) -> list[str]:
    """Return the roles and names of outputs and inputs without any good value in a run."""
    return [
        tag.key
        for tag in rig.tags
        if tag.role != "reference" and all(np.isnan(row[tag.key]) for _, row in rows)
    ]
