"""Hand an experiment to a notebook: as a DataFrame, and as HTML with a picture and its KPIs."""

import base64
import io
from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

import numpy as np

from .tracking_kinds import kinds_of

Experiment = Any
"""`prefcal_env.Experiment`, which calls these functions."""
_MOST = 2000
"""Largest number of points of a curve in the picture."""


def frame_of(experiment: Experiment) -> Any:
    """Return the curves as a DataFrame; see `Experiment.to_frame`."""
    import pandas as pd

    channels = experiment.channels
    columns = {}
    for j, channel in enumerate(channels.y):
        values = experiment.output(j)
        if values is not None:
            columns[channel.label] = values
    groups = ((channels.x, experiment.x), (channels.u, experiment.u))
    for group, values in groups:
        columns |= {c.label: values[:, i] for i, c in enumerate(group) if c.label not in columns}
    columns |= {k: v for k, v in experiment.signals.items() if k not in columns}
    unit = channels.time_unit
    index = pd.Index(experiment.t, name=f"time [{unit}]" if unit else "time")
    return pd.DataFrame(columns, index=index)


def html_of(experiment: Experiment) -> str:
    """Return the end, a picture of the curves and a table of the KPIs as HTML."""
    theta = ", ".join(f"{value:.4g}" for value in experiment.theta)
    rows = list(_with_units(experiment))
    table = table_of(("KPI", "value"), rows) if rows else ""
    words = (
        f"Experiment: θ = ({theta}), {experiment.duration:.4g} "
        f"{escape(experiment.channels.time_unit)}, {escape(experiment.end.value)}"
    )
    return f"<div><p>{words}</p>{_picture(experiment)}{table}</div>"


def _with_units(experiment: Experiment) -> Iterable[tuple[str, str]]:
    """Yield the name of each KPI, and its value with its unit if the channels tell that."""
    units = {name: unit for name, unit, _ in kinds_of(experiment.channels)}
    for name, value in experiment.kpis.items():
        # A KPI of one maneuver is called "NAME (MANEUVER)".
        unit = units.get(name, units.get(name.rpartition(" (")[0], ""))
        yield name, f"{value:.4g} {unit}".strip()


def table_of(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return an HTML table of plain texts; all columns but the first one are numbers."""
    head = "".join(f"<th>{escape(heading)}</th>" for heading in headings)
    body = "".join(
        f"<tr><td>{escape(first)}</td>"
        + "".join(f"<td style='text-align:right'>{escape(cell)}</td>" for cell in cells)
        + "</tr>"
        for first, *cells in rows
    )
    return f"<table><tr>{head}</tr>{body}</table>"


def _picture(experiment: Experiment) -> str:
    """Return the curves as an image; nothing without a record or without matplotlib."""
    if not len(experiment.t):
        return ""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        return ""
    channels = experiment.channels
    curves = [
        *((c, experiment.output(j)) for j, c in enumerate(channels.y)),
        *((c, experiment.x[:, i]) for i, c in enumerate(channels.x)),
        *((c, experiment.u[:, i]) for i, c in enumerate(channels.u)),
    ]
    shown = {c.label: (c, values) for c, values in reversed(curves) if values is not None}
    if not shown:
        return ""
    references = {c.label: experiment.y_ref[:, j] for j, c in enumerate(channels.y)}
    rows = np.unique(np.linspace(0, len(experiment.t) - 1, _MOST).astype(int))
    figure = Figure(figsize=(6.0, 0.5 + 1.3 * len(shown)), layout="constrained")
    grid = figure.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (channel, values) in zip(grid, reversed(shown.values()), strict=True):
        style = "steps-post" if channel in channels.u else "default"
        axes.plot(experiment.t[rows], values[rows], drawstyle=style, lw=1.2)
        if channel.target is not None:
            axes.axhline(channel.target, color="0.5", ls=":", lw=1)
        elif channel.label in references:
            reference = references[channel.label]
            axes.step(experiment.t_control, reference, where="post", color="0.5", ls=":", lw=1)
        axes.set_title(channel.label, loc="left", fontsize=9)
    grid[-1].set_xlabel(f"time [{experiment.channels.time_unit}]", fontsize=9)
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=80)
    data = base64.b64encode(content.getvalue()).decode()
    return f"<img alt='curves of the experiment' src='data:image/png;base64,{data}'>"
