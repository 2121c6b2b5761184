"""Rows and headings of the report's tables, prepared for the templates."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from prefcal_app.summary.compare import Spread
from prefcal_app.summary.gain import gained
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.experiments.maneuvers import named
from prefcal_env.preferences.answer import Preference
from prefcal_env.preferences.loop import Comparison
from prefcal_scenarios.kpis import WORST, grouped
from prefcal_scenarios.presentation.pid_forms import Parameter, pid_forms
from prefcal_scenarios.presentation.wording import (
    ended_text,
    knob_number,
    marks_text,
    measured,
    number,
    objective,
)
from prefcal_scenarios.scenario import KPI

from .record import VERDICTS, Record

_T = TypeVar("_T")
_MOST = 3
"""Number of KPIs that the page shows for each side of a comparison."""


@dataclass(frozen=True, slots=True)
class Value:
    """Cell of a table.

    Args:
        text: Text of the cell.
        met: Whether the value meets its objective; None if there is none.
    """

    text: str
    met: bool | None = None


@dataclass(frozen=True, slots=True)
class ResultRow:
    """Row of the result table: a knob, a KPI, the cost, or how the run ended.

    Args:
        name: Heading of the row.
        values: Values, one for each of `result_columns`.
        unit: Unit of the values; empty for none.
        aim: Objective as text; empty for none.
    """

    name: str
    values: tuple[Value, ...]
    unit: str = ""
    aim: str = ""


@dataclass(frozen=True, slots=True)
class ExperimentRow:
    """An experiment: its number, starting at 1, its values, and how it ended."""

    number: int
    best: bool
    values: tuple[Value, ...]
    ended: str


@dataclass(frozen=True, slots=True)
class Compared:
    """One side of a comparison: the experiment's number, starting at 1, and its values."""

    number: int
    preferred: bool
    values: tuple[Value, ...]


@dataclass(frozen=True, slots=True)
class ComparisonRow:
    """A question with its answer; the newer experiment is the first of `sides`."""

    number: int
    verdict: str
    marks: tuple[str, ...]
    sides: tuple[Compared, Compared]


@dataclass(frozen=True, slots=True)
class PIDRow:
    """Parameter of a tuned PID: the form that has it, and its value in best run and baseline."""

    form: str
    name: str
    unit: str
    best: str
    before: str
    derived: str


def gain_rows(record: Record) -> list[dict[str, Any]]:
    """Return what was gained, a row for each KPI, as the page shows it."""
    assert record.best is not None
    spread = Spread(trial.experiment.kpis for trial in record.trials)
    return gained(record.before.experiment, record.best.experiment, record.kpis, spread)


def foremost(ranked: Sequence[_T], room: int, has_limit: Callable[[_T], bool]) -> list[_T]:
    """Return as many rows as fit; those with an objective are the last ones to be left out."""
    order = sorted(range(len(ranked)), key=lambda i: (not has_limit(ranked[i]), i))
    return [ranked[i] for i in sorted(order[:room])]


def foremost_kpis(record: Record, room: int) -> list[KPI]:
    """Return the KPIs that tell experiments apart, in the order of what was gained.

    Values that read the same are no difference. A KPI that is the same in all experiments tells
    something only if it misses its objective.
    """
    order = [row["title"] for row in gain_rows(record)]
    ranked = sorted(record.kpis, key=lambda kpi: order.index(kpi.title))
    return foremost([k for k in ranked if _tells(record, k)], room, lambda k: bool(objective(k)))


def _tells(record: Record, kpi: KPI) -> bool:
    values = np.unique(record.read(kpi))
    known = values[~np.isnan(values)]
    return len(known) > 1 or any(kpi.met(value) is False for value in known)


def pid_rows(record: Record) -> list[PIDRow]:
    """Return the tuned PID in the ISA and the parallel form; [] for other controllers."""
    scenario = record.scenario
    if scenario.settings is None or record.best is None:
        return []
    best, before = (
        pid_forms(scenario.settings(e.theta), scenario.space, e.channels.time_unit)
        for e in (record.best.experiment, record.before.experiment)
    )
    knobs = {knob.name: knob for knob in scenario.space}

    def text(p: Parameter) -> str:
        knob = knobs.get(p.name.partition(" ")[0])  # "b (set-point weight of K_p)"
        return number(p.value) if knob is None else knob_number(knob, p.value)

    return [
        PIDRow(new.form, new.name, new.unit, text(new), text(old), new.derived)
        for new, old in zip(best, before, strict=True)
    ]


def result_columns(record: Record) -> dict[str, Experiment]:
    """Return the experiments of the result table by heading: best, baseline, references."""
    assert record.best is not None
    return {"best": record.best.experiment, **record.compared_with}


def result_rows(record: Record, experiments: Iterable[Experiment]) -> Iterator[ResultRow]:
    """Yield a row for each knob, the cost, each KPI, and how these experiments ended."""
    shown = list(experiments)
    for i, knob in enumerate(record.scenario.space):
        values = tuple(Value(knob_number(knob, e.theta[i])) for e in shown)
        yield ResultRow(knob.name, values, knob.unit)
    if record.shows_cost:
        yield ResultRow("performance index", tuple(Value(number(record.cost(e))) for e in shown))
    for part, kpi in _grouped(record.kpis, shown):
        values = tuple(_judged(kpi, e) for e in shown)
        title = kpi.title if part in ("", WORST) else named(kpi.title, part)
        yield ResultRow(title, values, kpi.unit, objective(kpi))
    yield ResultRow("ended", tuple(Value(ended_text(e)) for e in shown))


def _grouped(kpis: Sequence[KPI], shown: Sequence[Experiment]) -> Sequence[tuple[str, KPI]]:
    """Return KPIs by group; without maneuvers all of them, even those that no experiment has."""
    if not any(run.maneuver for e in shown for run in e.runs):
        return [("", kpi) for kpi in kpis]
    return grouped(kpis, *shown)


def value_headings(record: Record) -> list[tuple[str, str]]:
    """Return the name and unit of each value that tables show of an experiment."""
    knobs = [(k.name, k.unit) for k in record.scenario.space]
    return knobs + [(k.title, k.unit) for k in shown_values(record)]


def experiment_rows(record: Record) -> Iterator[ExperimentRow]:
    """Yield every experiment with its values, in the order of their numbers."""
    assert record.best is not None
    kpis = shown_values(record)
    for trial in record.trials:
        values = _values(record, kpis, trial.experiment)
        best = trial.index == record.best.index
        yield ExperimentRow(trial.number, best, values, ended_text(trial.experiment))


def comparison_rows(record: Record) -> Iterator[ComparisonRow]:
    """Yield every question with its answer, in the order of the answers."""
    kpis = shown_values(record)
    for row, comparison in enumerate(record.asked, start=1):
        answer = comparison.answer
        marks = tuple(marks_text(answer))
        verdict = VERDICTS[answer.preference]
        yield ComparisonRow(row, verdict, marks, _sides(record, kpis, comparison))


def shown_values(record: Record) -> list[KPI]:
    """Return the KPIs that tell experiments apart, as many as fit into a table."""
    return foremost_kpis(record, _MOST)


def _sides(
    record: Record, kpis: Sequence[KPI], comparison: Comparison
) -> tuple[Compared, Compared]:
    query, preference = comparison.query, comparison.answer.preference
    assert query.incumbent is not None
    assert comparison.incumbent is not None

    def side(index: int, experiment: Experiment, wins: Preference) -> Compared:
        return Compared(index + 1, preference is wins, _values(record, kpis, experiment))

    return (
        side(query.challenger.index, comparison.challenger, Preference.CHALLENGER),
        side(query.incumbent.index, comparison.incumbent, Preference.INCUMBENT),
    )


def _values(record: Record, kpis: Sequence[KPI], experiment: Experiment) -> tuple[Value, ...]:
    space = record.scenario.space
    theta = [Value(knob_number(k, v)) for k, v in zip(space, experiment.theta, strict=True)]
    return (*theta, *(_judged(k, experiment) for k in kpis))


def _judged(kpi: KPI, experiment: Experiment) -> Value:
    return Value(measured(kpi, experiment), kpi.met_by(experiment))
