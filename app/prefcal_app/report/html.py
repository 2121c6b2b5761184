"""Write report.html, a single self-contained file."""

from base64 import b64encode
from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from typing import Any

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from prefcal_app.view.sides import theta_view
from prefcal_scenarios.presentation.wording import with_subscripts

from .export import REBUILD, versions
from .pictures import Drawn
from .record import StudyRecord
from .tables import comparison_table, experiment_table, gain_of, pid_table, result_table


@cache
def environment(*packages: str) -> Environment:
    """Return the template environment, which escapes all values but `Markup`.

    Args:
        packages: Packages with further templates.
    """
    made = Environment(
        loader=ChoiceLoader([PackageLoader(each, ".") for each in ("prefcal_app", *packages)]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    made.filters |= {"subscripts": with_subscripts, "listed": listed, "data_uri": data_uri}
    made.policies["json.dumps_kwargs"] = {"separators": (",", ":"), "sort_keys": True}
    css = files("prefcal_app.report").joinpath("report.css").read_text(encoding="utf-8")
    made.globals["css"] = Markup(css)
    return made


def page(record: StudyRecord, drawn: Sequence[Drawn]) -> str:
    """Return the text of report.html."""
    view: dict[str, Any] = {"lead": lead(record), "rebuild": REBUILD}
    if record.best is not None:
        theta = theta_view(record.scenario.space, record.best.experiment)
        view |= {"theta": theta, "pid": pid_table(record), "experiments": experiment_table(record)}
        view |= {"gain": gain_of(record), "result": result_table(record)}
    if record.asked and not record.scored:
        view["comparisons"] = comparison_table(record)
    template = environment().get_template("report/report.html.j2")
    return template.render(record=record, drawn=drawn, versions=versions(), **view)


def data_uri(content: bytes) -> str:
    """Return a data URI with the PNG `content`."""
    return f"data:image/png;base64,{b64encode(content).decode('ascii')}"


def lead(record: StudyRecord) -> str:
    """Return what the study consists of, as a sentence without its period."""
    tried = f"{len(record.trials)} experiments"
    if record.scored:
        return f"Calibrated by its score, without comparisons: {tried}"
    verdicts = ", ".join(f"{words} {n}" for words, n in record.verdict_counts().items())
    return f"Calibrated by preferences: {tried}, {record.questions} comparisons ({verdicts})"


def listed(value: object) -> str:
    """Return a value as text, with a list's items separated by commas."""
    return ", ".join(map(str, value)) if isinstance(value, (list, tuple)) else str(value)
