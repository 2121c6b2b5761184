"""Tables as plain data, which the page, the terminal and the report draw as they are."""

from collections.abc import Iterable, Sequence
from typing import Any

from prefcal_env.experiments.experiment import Experiment
from prefcal_scenarios.presentation.wording import measured
from prefcal_scenarios.scenario import KPI

Data = dict[str, Any]


def table(
    label: str, columns: Iterable[Data | str], rows: Iterable[Data], caption: str = "", kind: str = "result"
) -> Data:
    """Return a table.

    Args:
        label: Name of the table, for screen readers.
        columns: What `column` returns, or a heading alone; the first one is that of the rows' names.
        rows: What `row` returns.
        caption: What the signs mean; empty for none.
        kind: Classes of the style sheet.
    """
    heads = [column(each) if isinstance(each, str) else each for each in columns]
    return {"label": label, "columns": heads, "rows": list(rows), "caption": caption, "kind": kind}


def column(name: str, unit: str = "", kind: str = "") -> Data:
    """Return the heading of a column, with the unit of its values and its classes."""
    return {"name": name, "unit": unit, "kind": kind}


def row(
    name: str, cells: Sequence[Data], *, unit: str = "", aim: str = "", about: str = "", kind: str = ""
) -> Data:
    """Return a row.

    Args:
        name: Heading of the row.
        cells: What `cell` returns, one for each column but the first.
        unit: Unit of the values; empty for none.
        aim: Objective as text; empty for none.
        about: What the heading means; empty for nothing.
        kind: Classes of the row.
    """
    return {"name": name, "cells": list(cells), "unit": unit, "aim": aim, "about": about, "kind": kind}


def cell(text: str, met: bool | None = None, kind: str = "") -> Data:
    """Return a cell.

    Args:
        text: Text of the cell.
        met: Whether the value meets its objective; None if there is none.
        kind: Classes of the style sheet: "best", "words", "yes" or "no"; empty for none.
    """
    return {"text": text, "met": met, "kind": kind}


def judged(kpi: KPI, experiment: Experiment, kind: str = "") -> Data:
    """Return the cell of a KPI: its value, and whether that meets the objective."""
    return cell(measured(kpi, experiment), kpi.met_by(experiment), kind)
