"""Show a study as tables of answers, experiments and trajectories with their units."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any, Literal

import numpy as np

from prefcal_env.errors import StudyError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.experiments.maneuvers import by_maneuver
from prefcal_env.experiments.panels import plots_of
from prefcal_env.preferences.history import Comparison

from .fold import State

StudyFile = Any
"""`prefcal_env.study.StudyFile`, which calls these functions."""
Kind = Literal["integer", "number", "text", "boolean"]


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a table.

    Args:
        name: Name, without its unit.
        meaning: What its values are, in a few words.
        unit: Unit of the values; empty for none.
        kind: Type of the values.
    """

    name: str
    meaning: str
    unit: str = ""
    kind: Kind = "number"

    @property
    def heading(self) -> str:
        """Return the name with its unit."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name


@dataclass(frozen=True, slots=True)
class Table:
    """A table: its columns and rows; an empty cell is None."""

    columns: Sequence[Column]
    rows: Sequence[Sequence[Any]]

    @property
    def headings(self) -> list[str]:
        """Return the headings of the columns."""
        return [column.heading for column in self.columns]


def frame_of(study: StudyFile, *, answers: bool = False) -> Any:
    """Return the experiments or the answers as a DataFrame; see `StudyFile.to_frame`."""
    import pandas as pd

    state = study.state
    table = answers_of(state) if answers else experiments_of(state, finished(study))
    frame = pd.DataFrame(table.rows, columns=table.headings)
    return frame.set_index(table.headings[0])


def finished(study: StudyFile) -> dict[int, Experiment]:
    """Return the completed experiments of a study by index."""
    return {i: study.experiment(seq) for i, seq in sorted(study.state.finished.items())}


def html_of(study: StudyFile) -> str:
    """Return how far the study is, and its experiments, as HTML."""
    state = study.state
    best = state.history.incumbent
    words = f"Study {Path(study.path).stem}: {len(state.finished)} experiments, " + (
        f"{len(state.answers)} answers" + ("" if best is None else f", best experiment {best + 1}")
    )
    table = frame_of(study).to_html(max_rows=60, float_format=lambda value: f"{value:.4g}")
    return f"<div><p>{escape(words)}</p>{table}</div>"


_ANSWERS = (
    Column("answer", "Number of the new experiment that was answered, from 0; empty for a follow-up"
           " comparison or a repeated question", kind="integer"),
    Column("at", "Time of the answer, ISO 8601", kind="text"),
    Column("challenger", "Number of the newer experiment, from 1", kind="integer"),
    Column("incumbent", "Number of the older experiment, from 1; empty for the first experiment",
           kind="integer"),
    Column("preference", "Verdict, -1: the challenger is better, 0: about the same, 1: the "
           "incumbent is; empty: can't tell", kind="integer"),
    Column("strength", "Weight c_h of the answer, usually 1"),
    Column("marks", "What was marked with the answer, separated by semicolons", kind="text"),
    Column("automatic marks", "Marks that come from an interrupted run", kind="text"),
    Column("challenger on the left", "Whether the challenger was shown on the left",
           kind="boolean"),
    Column("blind", "Whether θ and the roles of the sides were hidden", kind="boolean"),
    Column("comment", "Comment on the answer", kind="text"),
    Column("retracted", "Whether the answer no longer teaches", kind="boolean"),
    Column("repeats question", "Id of the question that this one repeats", kind="integer"),
    Column("question", "Id of the question", kind="integer"),
)  # fmt: skip


def answers_of(state: State) -> Table:
    """Return a row for each answer, in the order given."""
    return Table(_ANSWERS, [_comparison(closed) for closed in state.answers])


def _comparison(closed: Comparison) -> list[Any]:
    answer, rival = closed.answer, closed.incumbent
    return [
        closed.challenger if closed.repeats is None and closed.after is None else None,
        closed.at,
        closed.challenger + 1,
        None if rival is None else rival + 1,
        None if answer.preference is None else int(answer.preference),
        answer.strength,
        "; ".join(mark.value for mark in answer.marks) or None,
        "; ".join(mark.value for mark in answer.automatic) or None,
        closed.challenger_left,
        closed.blind,
        closed.comment or None,
        closed.retracted,
        closed.repeats,
        closed.question,
    ]


def experiments_of(state: State, experiments: dict[int, Experiment]) -> Table:
    """Return a row for each completed experiment: θ, KPIs, end and marks."""
    knobs = _units(state, "knobs")
    about = {name: (unit, title) for name, unit, title in _units(state, "kpis")}
    kpis = sorted({name for e in experiments.values() for name in e.kpis})
    columns = [
        Column("experiment", "Number of the experiment, from 1", kind="integer"),
        *(Column(name, "Controller parameter", unit) for name, unit, _ in knobs),
        *(_kpi_column(name, *about.get(name, ("", ""))) for name in kpis),
        Column("ended", "How the run ended", kind="text"),
        Column("marks", "Marks by a person, separated by semicolons", kind="text"),
        Column("automatic marks", "Marks that come from an interrupted run", kind="text"),
        Column("score", "Score that an agent by score was told; lower is better"),
    ]
    return Table(columns, list(_experiment_rows(state, experiments, kpis)))


def _kpi_column(name: str, unit: str, title: str) -> Column:
    return Column(name, f"KPI: {title}" if title else "KPI", unit)


def _experiment_rows(
    state: State, experiments: dict[int, Experiment], kpis: Sequence[str]
) -> Iterator[list[Any]]:
    history = state.history
    scores = {c.challenger: c.answer.value for c in history.comparisons}
    counted = history.unsafe(automatic=True)
    for index, e in experiments.items():
        automatic = "unsafe" if index in counted else None
        marks = "; ".join(sorted(state.marks.get(index, ()))) or None
        values = [e.kpis.get(k) for k in kpis]
        # Not the experiment's own θ: knobs may have been added since.
        theta = history.samples[index].theta
        yield [index + 1, *theta, *values, e.end.value, marks, automatic, scores.get(index)]


def _units(state: State, what: str) -> list[tuple[str, str, str]]:
    """Return name, unit and title of each knob or KPI in the configuration, if it is valid."""
    try:
        return [
            (str(k["name"]), str(k["unit"]), str(k.get("title", "")))
            for k in state.configuration.get(what, ())
        ]
    except (TypeError, KeyError, IndexError, AttributeError) as error:
        raise StudyError(f"the configuration's {what!r} must list names and units") from error


_REFERENCE = "Reference of the output, held from this instant on"


def trajectory_of(e: Experiment) -> Table:
    """Return a row for each instant, with the name of the maneuver first if there are several.

    References are held from step to step; only outputs that have one get a column for it.
    """
    parts = by_maneuver(e)
    runs = list(parts.values())
    outputs = [p for p in plots_of(e.channels) if p.kind == "y" and p.name not in e.signals]
    outputs = [p for p in outputs if any(np.isfinite(p.values(run)).any() for run in runs)]
    every = range(len(e.channels.y))
    aims = [j for j in every if any(np.isfinite(run.reference(j)).any() for run in runs)]
    aimed = [e.channels.y[j] for j in aims]
    signals = list(dict.fromkeys(key for run in runs for key in run.signals))
    first = [Column("maneuver", "Name of the maneuver", kind="text")] if any(parts) else []
    columns = [
        *first,
        Column("time", "Time since the start of the run", e.channels.time_unit),
        *(Column(c.name, "State", c.unit) for c in e.channels.x),
        *(Column(c.name, "Input, held from this instant on", c.unit) for c in e.channels.u),
        *(Column(p.channel.name, "Output", p.channel.unit) for p in outputs),
        *(Column(f"Reference of {c.name}", _REFERENCE, c.unit) for c in aimed),
        *(Column(key, "Signal") for key in signals),
    ]
    rows = []
    for name, run in parts.items():
        curves = [run.t, *run.x.T, *run.u.T, *(plot.values(run) for plot in outputs)]
        curves += [run.reference(j) for j in aims]
        curves += [run.signals.get(key, [None] * len(run.t)) for key in signals]
        for row in zip(*curves, strict=True):
            cells = [None if cell is None else float(cell) for cell in row]
            rows.append([*([name] if first else []), *cells])
    return Table(columns, rows)
