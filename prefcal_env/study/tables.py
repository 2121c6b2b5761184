"""Show a study as tables: comparisons, experiments and trajectories, as CSV or DataFrame."""

import csv
import io
from collections.abc import Iterable
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from prefcal_env.errors import StudyError
from prefcal_env.experiments.experiment import Channel, Experiment
from prefcal_env.experiments.maneuvers import by_maneuver
from prefcal_env.experiments.panels import Plot, plots_of
from prefcal_env.preferences.history import Comparison

from .fold import State
from .trouble import told

StudyFile = Any
"""`prefcal_env.study.StudyFile`, which calls these functions."""


def export_csv(study: StudyFile, folder: Path | str) -> Path:
    """Write comparisons.csv, experiments.csv and trajectories/experiment-001.csv ... to `folder`.

    Numbers have full precision, headings have units, and the folder may exist. Raises StudyError
    if it cannot be written.
    """
    target, state = Path(folder), study.state
    with told(target, "write", what="the folder"):
        (target / "trajectories").mkdir(parents=True, exist_ok=True)
        _write(target / "comparisons.csv", _comparisons(state))
        experiments = {i: study.experiment(seq) for i, seq in sorted(state.finished.items())}
        _write(target / "experiments.csv", _experiments(state, experiments))
        for index, experiment in experiments.items():
            name = f"experiment-{index + 1:03d}.csv"
            _write(target / "trajectories" / name, _trajectory(experiment))
    return target


def frame_of(study: StudyFile, *, answers: bool = False) -> Any:
    """Return the experiments or the answers as a DataFrame; see `StudyFile.to_frame`."""
    import pandas as pd

    state = study.state
    if answers:
        headings, *rows = _comparisons(state)
    else:
        experiments = {i: study.experiment(seq) for i, seq in sorted(state.finished.items())}
        headings, *rows = _experiments(state, experiments)
    frame = pd.DataFrame([[None if cell == "" else cell for cell in row] for row in rows],
                         columns=headings)  # fmt: skip
    return frame.set_index(headings[0])


def html_of(study: StudyFile) -> str:
    """Return how far the study is, and its experiments, as HTML."""
    state = study.state
    best = state.history.incumbent
    words = f"Study {Path(study.path).stem}: {len(state.finished)} experiments, " + (
        f"{len(state.answers)} answers" + ("" if best is None else f", best experiment {best + 1}")
    )
    table = frame_of(study).to_html(max_rows=60, float_format=lambda value: f"{value:.4g}")
    return f"<div><p>{escape(words)}</p>{table}</div>"


def _write(path: Path, rows: Iterable[Iterable[Any]]) -> None:
    text = io.StringIO()
    safe = ([_safe(cell) if isinstance(cell, str) else cell for cell in row] for row in rows)
    csv.writer(text, lineterminator="\n").writerows(safe)
    path.write_text(text.getvalue(), encoding="utf-8")


def _comparisons(state: State) -> Iterable[list[Any]]:
    yield ["answer", "at", "challenger", "incumbent", "preference", "strength", "marks",
           "automatic marks", "challenger on the left", "blind", "comment", "retracted",
           "repeats question", "question"]  # fmt: skip
    for closed in state.answers:
        yield _comparison(closed)


def _comparison(closed: Comparison) -> list[Any]:
    answer, rival = closed.answer, closed.incumbent
    return [
        closed.challenger if closed.repeats is None and closed.after is None else "",
        closed.at,
        closed.challenger + 1,
        "" if rival is None else rival + 1,
        "" if answer.preference is None else int(answer.preference),
        answer.strength,
        "; ".join(mark.value for mark in answer.marks),
        "; ".join(mark.value for mark in answer.automatic),
        closed.challenger_left,
        closed.blind,
        closed.comment,
        closed.retracted,
        "" if closed.repeats is None else closed.repeats,
        closed.question,
    ]


def _experiments(state: State, experiments: dict[int, Experiment]) -> Iterable[list[Any]]:
    knobs = [_with_unit(name, unit) for name, unit in _units(state, "knobs")]
    units = dict(_units(state, "kpis"))
    kpis = sorted({name for e in experiments.values() for name in e.kpis})
    yield ["experiment", *knobs, *(_with_unit(k, units.get(k, "")) for k in kpis), "ended", "marks",
           "automatic marks", "score"]  # fmt: skip
    history = state.history
    scores = {c.challenger: c.answer.value for c in history.comparisons}
    counted = history.unsafe(automatic=True)
    for index, e in experiments.items():
        automatic = "unsafe" if index in counted else ""
        marks = "; ".join(sorted(state.marks.get(index, ())))
        values = [e.kpis.get(k, "") for k in kpis]
        # Not the experiment's own θ: knobs may have been added since.
        theta = history.samples[index].theta
        score = scores.get(index)
        ended = [e.end.value, marks, automatic, "" if score is None else score]
        yield [index + 1, *theta, *values, *ended]


def _units(state: State, what: str) -> list[tuple[str, str]]:
    """Return name and unit of each knob or KPI in the configuration, which is not trusted."""
    try:
        return [(str(k["name"]), str(k["unit"])) for k in state.configuration.get(what, ())]
    except (TypeError, KeyError, IndexError) as error:
        raise StudyError(f"the configuration's {what!r} must list names and units") from error


def _trajectory(e: Experiment) -> Iterable[list[Any]]:
    """Yield a row for each instant, with the name of the maneuver first if there are several."""
    parts = by_maneuver(e)
    outputs = [plot for plot in plots_of(e.channels) if plot.kind == "y"]
    outputs = [p for p in outputs if p.name not in e.signals and _has(p, parts.values())]
    names = [_heading(c) for c in (*e.channels.x, *e.channels.u, *(p.channel for p in outputs))]
    signals = list(dict.fromkeys(key for run in parts.values() for key in run.signals))
    first = ["maneuver"] if any(parts) else []
    yield [*first, _with_unit("time", e.channels.time_unit), *names, *signals]
    for name, run in parts.items():
        columns = [run.t, *run.x.T, *run.u.T, *(plot.values(run) for plot in outputs)]
        columns += [run.signals.get(key, [""] * len(run.t)) for key in signals]
        for row in zip(*columns, strict=True):
            cells = [cell if isinstance(cell, str) else float(cell) for cell in row]
            yield [*([name] if first else []), *cells]


def _has(plot: Plot, runs: Iterable[Experiment]) -> bool:
    """Return whether any of the runs recorded the output."""
    return any(np.isfinite(plot.values(run)).any() for run in runs)


def _heading(channel: Channel) -> str:
    return _with_unit(channel.name, channel.unit)


def _with_unit(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name


def _safe(text: str) -> str:
    """Escape text that a spreadsheet would run as a formula: a study may not be trusted."""
    return f"'{text}" if text[:1] in ("=", "+", "-", "@", "\t", "\r") else text
