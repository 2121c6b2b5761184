"""Turn what was read from a live plant into an experiment."""

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from prefcal_env.experiments.experiment import Experiment
from prefcal_env.experiments.recorded import recorded

from .drive import Outcome

if TYPE_CHECKING:
    from .rig import LiveRig


def experiment_of(rig: "LiveRig", theta: Float[np.ndarray, " n"], outcome: Outcome) -> Experiment:
    """Return the experiment of a physical θ, shape (n,), from the samples of its run.

    Outputs of bad quality stay NaN. Inputs and references keep their latest good value meanwhile,
    since they are held between samples anyway.
    """
    t = np.array([instant for instant, _ in outcome.rows])
    columns: dict[str, dict[str, Float[np.ndarray, " K"]]] = {
        "output": {}, "input": {}, "reference": {},
    }  # fmt: skip
    for tag in rig.tags:
        values = np.array([row[f"{tag.role} {tag.name}"] for _, row in outcome.rows])
        columns[tag.role][tag.name] = values if tag.role == "output" else held(values)
    drawn = [tag for tag in rig.tags if tag.role != "reference"]
    return recorded(
        theta,
        t,
        columns["output"],
        columns["input"] or None,
        columns["reference"] or None,
        {tag.name: tag.unit for tag in drawn},
        {tag.name: (tag.low, tag.high) for tag in drawn if tag.low > -np.inf or tag.high < np.inf},
        kpis=rig.kpis,
        end=outcome.end,
        time_unit="s",
    )


def held(values: Float[np.ndarray, " K"]) -> Float[np.ndarray, " K"]:
    """Return `values` with each NaN replaced by the latest good value, or else by the first one."""
    good = np.flatnonzero(~np.isnan(values))
    if not len(good):
        return np.zeros(len(values))
    places = np.clip(np.searchsorted(good, np.arange(len(values)), side="right") - 1, 0, None)
    return np.asarray(values[good[places]])
