"""Write report.html, a single self-contained file."""

from base64 import b64encode
from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from typing import Any

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from prefcal_scenarios.presentation.wording import knob_number, with_subscripts

from .export import rebuild, versions
from .pictures import Drawn
from .record import Record
from .tables import (
    comparison_rows,
    experiment_rows,
    gain_rows,
    pid_rows,
    result_columns,
    result_rows,
    value_headings,
)


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


def page(record: Record, drawn: Sequence[Drawn]) -> str:
    """Return the text of report.html."""
    template = environment().get_template("report/report.html.j2")
    return template.render(
        record=record, drawn=drawn, rebuild=rebuild(record), versions=versions(), **_view(record)
    )


def data_uri(content: bytes) -> str:
    """Return a data URI with the PNG `content`."""
    return f"data:image/png;base64,{b64encode(content).decode('ascii')}"


def _view(record: Record) -> dict[str, Any]:
    """Return the values that the template needs besides the record itself."""
    view: dict[str, Any] = {"lead": lead(record)}
    if record.best is not None:
        view["headings"] = value_headings(record)
        view["experiment_rows"] = experiment_rows(record)
        view["comparison_rows"] = comparison_rows(record)
        theta = record.scenario.space.named(record.best.experiment.theta)
        view["best_values"] = [
            (k.name, knob_number(k, theta[k.name]), k.unit) for k in record.scenario.space
        ]
        columns = result_columns(record)
        view["result_columns"] = columns
        view["result_rows"] = result_rows(record, columns.values())
        view["gain_rows"] = gain_rows(record)
        view["pid"] = pid_rows(record)
    return view


def lead(record: Record) -> str:
    """Return what the study consists of, as a sentence without its period."""
    tried = f"{len(record.trials)} experiments"
    if record.scored:
        return f"Calibrated by its score, without comparisons: {tried}"
    verdicts = ", ".join(f"{words} {n}" for words, n in record.verdict_counts().items())
    return f"Calibrated by preferences: {tried}, {record.questions} comparisons ({verdicts})"


def listed(value: object) -> str:
    """Return a value as text, with a list's items separated by commas."""
    return ", ".join(map(str, value)) if isinstance(value, (list, tuple)) else str(value)
