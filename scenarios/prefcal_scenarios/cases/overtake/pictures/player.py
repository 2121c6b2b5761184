"""Animate the runs of an overtaking in report.html, with the player of the query window."""

from importlib.resources import files

from markupsafe import Markup

from prefcal_scenarios.app.report.html import data_uri, environment
from prefcal_scenarios.app.report.record import Record

from .drawing import Drawing
from .film import BEHIND, SEEN, still
from .moments import moments
from .shown import runs


def player(record: Record) -> Markup:
    """Return the HTML of the animation: controls, positions, style and script.

    It is self-contained. Without scripts, the cars stand still beside the obstacle.
    """
    shown = runs(record)
    drawings = [Drawing.of(s.experiment) for s in shown]
    middle = moments(shown[0].experiment)[2].index
    time = round(float(shown[0].experiment.t[middle]), 2)
    pictured = [
        {
            "label": s.label,
            "color": s.color,
            "speed": drawing.at(time).speed,
            "still": data_uri(still(s, time), "still.png"),
        }
        for s, drawing in zip(shown, drawings, strict=True)
    ]
    data = {"still": time, "behind": BEHIND, "seen": SEEN, "runs": [d.as_json() for d in drawings]}
    template = environment().get_template("cases/overtake/pictures/player.html.j2")
    return Markup(
        template.render(
            runs=pictured,
            data=data,
            time=time,
            end=max(float(drawing.t[-1]) for drawing in drawings),
            road_css=_static("road.css"),
            road_js=_static("road.js"),
        )
    )


def _static(name: str) -> Markup:
    """Return a file of the query window unchanged."""
    static = files("prefcal_scenarios").joinpath("app", "web", "static")
    return Markup(static.joinpath(name).read_text(encoding="utf-8"))
