"""Show a study as tables of answers, experiments and trajectories with their units."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path
from typing import Any, Literal

import numpy as np

from prefcal_env.errors import StudyError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.experiments.panels import by_maneuver, plots_of
from prefcal_env.preferences.history import Comparison
from prefcal_env.wording import labeled

from .fold import State

AnyStudy = Any
"""`prefcal_env.study.StudyFile`, which calls these functions."""
_NUMBER = "Number of the experiment, from 1"
_AUTOMATIC = "Marks that come from an interrupted run"
_REFERENCE = "Reference of the output, held from this instant on"
Kind = Literal["integer", "number", "text", "boolean"]


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a table. A table is a list of columns of the same length.

    Args:
        name: Name, without its unit.
        meaning: What its values are, in a few words.
        values: Value of each row; None for an empty cell.
        unit: Unit of the values; empty for none.
        kind: Type of the values.
    """

    name: str
    meaning: str
    values: Sequence[Any]
    unit: str = ""
    kind: Kind = "number"

    @property
    def heading(self) -> str:
        """Return the name with its unit."""
        return labeled(self.name, self.unit)


def frame_of(study: AnyStudy, *, answers: bool = False) -> Any:
    """Return the experiments or the answers as a DataFrame; see `StudyFile.to_frame`."""
    import pandas as pd

    state = study.state
    table = answers_of(state) if answers else experiments_of(state, finished(study))
    headings = [column.heading for column in table]
    frame = pd.DataFrame([*zip(*(c.values for c in table), strict=True)], columns=headings)
    return frame.set_index(headings[0])


def finished(study: AnyStudy) -> dict[int, Experiment]:
    """Return the completed experiments of a study by index."""
    return {i: study.experiment(seq) for i, seq in sorted(study.state.finished.items())}


def html_of(study: AnyStudy) -> str:
    """Return how far the study is, and its experiments, as HTML."""
    state = study.state
    best = state.history.incumbent
    words = f"Study {Path(study.path).stem}: {len(state.finished)} experiments, " + (
        f"{len(state.answers)} answers" + ("" if best is None else f", best experiment {best + 1}")
    )
    table = frame_of(study).to_html(max_rows=60, float_format=lambda value: f"{value:.4g}")
    return f"<div><p>{escape(words)}</p>{table}</div>"


_ANSWERS: Mapping[str, tuple[Kind, str]] = {
    "answer": (
        "integer",
        "Number of the new experiment that was answered, from 0; empty for a "
        "follow-up comparison or a repeated question",
    ),
    "at": ("text", "Time of the answer, ISO 8601"),
    "challenger": ("integer", "Number of the newer experiment, from 1"),
    "incumbent": ("integer", "Number of the older experiment, from 1; empty for the first experiment"),
    "preference": (
        "integer",
        "Verdict, -1: the challenger is better, 0: about the same, 1: the incumbent is; empty: can't tell",
    ),
    "strength": ("number", "Weight c_h of the answer, usually 1"),
    "marks": ("text", "What was marked with the answer, separated by semicolons"),
    "automatic marks": ("text", _AUTOMATIC),
    "challenger on the left": ("boolean", "Whether the challenger was shown on the left"),
    "blind": ("boolean", "Whether θ and the roles of the sides were hidden"),
    "comment": ("text", "Comment on the answer"),
    "retracted": ("boolean", "Whether the answer no longer teaches"),
    "repeats question": ("integer", "Id of the question that this one repeats"),
    "question": ("integer", "Id of the question"),
}
"""Type and meaning of each column of the answers."""


def answers_of(state: State) -> list[Column]:
    """Return a row for each answer, in the order given."""
    rows = [_comparison(closed) for closed in state.answers]
    return [
        Column(name, meaning, [row[k] for row in rows], kind=kind)
        for k, (name, (kind, meaning)) in enumerate(_ANSWERS.items())
    ]


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


def experiments_of(state: State, experiments: Mapping[int, Experiment]) -> list[Column]:
    """Return a row for each completed experiment: θ, KPIs, end and marks."""
    history, indices, runs = state.history, list(experiments), list(experiments.values())
    # Not the experiments' own θ: knobs may have been added since.
    thetas = [history.samples[index].theta for index in indices]
    about = {name: (unit, title) for name, unit, title in _units(state, "kpis")}
    scores = {c.challenger: c.answer.value for c in history.comparisons}
    unsafe = history.interrupted
    found = [Column("experiment", _NUMBER, [i + 1 for i in indices], kind="integer")]
    for k, (name, unit, _) in enumerate(_units(state, "knobs")):
        found.append(Column(name, "Controller parameter", [theta[k] for theta in thetas], unit))
    for name in sorted({name for run in runs for name in run.kpis}):
        unit, title = about.get(name, ("", ""))
        values = [run.kpis.get(name) for run in runs]
        found.append(Column(name, f"KPI: {title}" if title else "KPI", values, unit))
    marks = ["; ".join(sorted(state.marks.get(i, ()))) or None for i in indices]
    automatic = ["unsafe" if i in unsafe else None for i in indices]
    told = [scores.get(i) for i in indices]
    return [
        *found,
        Column("ended", "How the run ended", [run.end.value for run in runs], kind="text"),
        Column("marks", "Marks by a person, separated by semicolons", marks, kind="text"),
        Column("automatic marks", _AUTOMATIC, automatic, kind="text"),
        Column("score", "Score that an agent by score was told; lower is better", told),
    ]


def _units(state: State, what: str) -> list[tuple[str, str, str]]:
    """Return name, unit and title of each knob or KPI in the configuration, if it is valid."""
    try:
        return [
            (str(k["name"]), str(k["unit"]), str(k.get("title", "")))
            for k in state.configuration.get(what, ())
        ]
    except (TypeError, KeyError, IndexError, AttributeError) as error:
        raise StudyError(f"the configuration's {what!r} must list names and units") from error


def trajectory_of(e: Experiment) -> list[Column]:
    """Return a row for each instant, with the name of the maneuver first if there are several.

    References are held from step to step; only outputs that have one get a column for it.
    """
    parts, channels = by_maneuver(e), e.channels
    runs = list(parts.values())
    measured = [plot for plot in plots_of(channels) if plot.kind == "y" and plot.name not in e.signals]
    outputs = [plot for plot in measured if any(np.isfinite(plot.values(run)).any() for run in runs)]
    aims = [j for j in range(len(channels.y)) if any(np.isfinite(r.reference(j)).any() for r in runs)]
    signals = list(dict.fromkeys(key for run in runs for key in run.signals))

    def curves_of(run: Experiment) -> Iterator[Column]:
        yield Column("time", "Time since the start of the run", run.t.tolist(), channels.time_unit)
        for c, x in zip(channels.x, run.x.T, strict=True):
            yield Column(c.name, "State", x.tolist(), c.unit)
        for c, u in zip(channels.u, run.u.T, strict=True):
            yield Column(c.name, "Input, held from this instant on", u.tolist(), c.unit)
        for plot in outputs:
            yield Column(plot.channel.name, "Output", plot.values(run).tolist(), plot.channel.unit)
        for j in aims:
            c = channels.y[j]
            yield Column(f"Reference of {c.name}", _REFERENCE, run.reference(j).tolist(), c.unit)
        for key in signals:  # a maneuver may lack those of another one
            yield Column(key, "Signal", run.signals.get(key, np.full(len(run.t), None)).tolist())

    names = [name for name, run in parts.items() for _ in run.t]
    found = [Column("maneuver", "Name of the maneuver", names, kind="text")] if any(parts) else []
    for same in zip(*map(curves_of, runs), strict=True):
        found.append(replace(same[0], values=[value for column in same for value in column.values]))
    return found
