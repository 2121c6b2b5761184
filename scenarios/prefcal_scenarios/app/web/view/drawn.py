"""Collect what is drawn of one experiment: curves, references and limits."""

from collections.abc import Sequence
from typing import Any

from prefcal_env.experiments.experiment import Experiment
from prefcal_env.experiments.panels import Plot

from .panels import curves, limits, reference, story


def curves_view(experiment: Experiment, panels: Sequence[Plot]) -> dict[str, Any]:
    """Return curves, changing references and limits, and each panel in words."""
    empty = not len(experiment.t)
    first = experiment.runs[0] if experiment.runs else experiment
    return {
        "runs": max(len(experiment.runs), 1),
        "curves": [curves(p, experiment) for p in panels] if not empty else [[] for _ in panels],
        "references": [reference(p, first) for p in panels],
        "limits": [limits(p, first) for p in panels],
        "stories": [story(p, first) for p in panels],
    }
