"""Preview what a person confirms: a rig's record, or what a run writes to a live plant."""

from collections.abc import Iterator
from math import isfinite, isinf, isnan
from typing import Any

from prefcal_app.session import Given, Interview, Preview, Side
from prefcal_app.session.study.now import PlantNow, Recovery
from prefcal_env.sources import Change, Stage
from prefcal_scenarios.presentation.wording import quantity
from prefcal_scenarios.scenario import Scenario, panels_of

from .panels import panel_view
from .seen import Seen
from .sides import numbers_view, run_view, side_view


def preview_view(interview: Interview, given: Given) -> dict[str, Any]:
    """Return PREVIEW for the page."""
    scenario, seen = interview.scenario, interview.preview(given)
    experiment = seen.experiment
    panels = panels_of(scenario, experiment)
    side = Side(given.index, experiment, challenger=True)
    study = Seen().look(interview)
    unit = experiment.channels.time_unit
    return {
        "panels": [panel_view(panel) for panel in panels],
        "axes": study.frame(panels, experiment),
        "side": {
            **numbers_view(experiment, scenario.shown_kpis),
            **side_view(side, experiment, scenario, blind=False),
            **run_view(experiment, panels, scenario.shown_kpis, study),
        },
        "time_unit": unit,
        "text": f"{len(experiment.t)} rows, from {quantity(float(experiment.t[0]), unit)} to "
        f"{quantity(float(experiment.t[-1]), unit)}",
        "same": seen.same is not None,
        "warnings": list(warnings(seen)),
    }


def warnings(seen: Preview) -> Iterator[str]:
    """Yield the reasons not to save a record."""
    if seen.same is not None:
        yield (
            f"These are exactly the curves of experiment {seen.same + 1}: is this the file of another run?"
        )
    if seen.retracts:
        what = "1 answer" if seen.retracts == 1 else f"{seen.retracts} answers"
        yield f"{what} about the record that it replaces will no longer count."


def plant_view(scenario: Scenario, plant: PlantNow | None) -> dict[str, Any] | None:
    """Return what the page shows of a live plant; None if the scenario has none."""
    source = scenario.source
    if plant is None:
        return None
    return {
        "changes": None if plant.changes is None else [_change(each) for each in plant.changes],
        "problem": plant.problem,
        "unrestored": plant.recovery is Recovery.FAILED and plant.progress is None,
        "instructions": source.instructions,
        "duration": _plain(source.duration),
        "afterward": source.afterward,
        "stops": source.stops,
        "running": _running(plant),
    }


def _change(change: Change) -> dict[str, str]:
    """Return a value to write, in words."""
    return {
        "name": change.name,
        "unit": change.unit,
        "old": "unknown" if isnan(change.old) else f"{change.old:.6g}",
        "new": f"{change.new:.6g}",
        "limits": f"{change.quantity.low:g} to {change.quantity.high:g}",
        "rate": "any" if isinf(change.rate) else f"{change.rate:g}",
    }


def _running(plant: PlantNow) -> dict[str, Any] | None:
    """Return how far the plant's run is; None if none is in progress."""
    progress = plant.progress
    if progress is None:
        return None
    return {
        "stage": progress.stage.value,
        "recovers": plant.recovery is not Recovery.DONE,
        "restores": progress.stage in (Stage.RESTORING, Stage.LOST),
        "records": progress.stage is Stage.RECORDING,
        "elapsed": progress.elapsed,
        "problem": progress.problem,
        "stopping": plant.stopping,
        "times": list(plant.times),
        "outputs": [
            {
                "name": curve.channel.name,
                "unit": curve.channel.unit,
                "values": [_plain(value) for value in curve.values],
                "reference": [_plain(value) for value in curve.reference],
            }
            for curve in plant.curves
        ],
    }


def _plain(value: float | None) -> float | None:
    """Return a number for JSON, which has no NaN: None for bad quality."""
    return value if value is not None and isfinite(value) else None
