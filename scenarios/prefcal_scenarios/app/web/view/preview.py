"""Preview a rig's record before it is saved: its curves, KPIs and warnings."""

from collections.abc import Iterator
from typing import Any

from prefcal_scenarios.app.presentation.wording import quantity
from prefcal_scenarios.app.session import Given, Interview, Preview, Side
from prefcal_scenarios.scenario import panels_of

from .panels import panel_view
from .seen import Seen
from .sides import side_view


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
        "side": side_view(side, experiment, scenario, study, blind=False),
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
            f"These are exactly the curves of experiment {seen.same + 1}: is this the file of "
            "another run?"
        )
    if seen.retracts:
        what = "1 answer" if seen.retracts == 1 else f"{seen.retracts} answers"
        yield f"{what} about the record that it replaces will no longer count."
