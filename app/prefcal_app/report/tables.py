"""Tables of the report and of the acceptance sheet, as plain data: one template draws all."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from prefcal_app.summary.compare import Spread
from prefcal_app.summary.counts import VERDICTS
from prefcal_app.summary.gain import gained
from prefcal_app.view.sides import theta_view
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

from .record import Record

_T = TypeVar("_T")
_MOST = 3
"""Number of KPIs that the table of experiments shows."""


@dataclass(frozen=True, slots=True)
class Value:
    """Cell of a table.

    Args:
        text: Text of the cell.
        met: Whether the value meets its objective; None if there is none.
        kind: Classes of the style sheet: "best", "words", "yes" or "no"; empty for none.
    """

    text: str
    met: bool | None = None
    kind: str = ""


@dataclass(frozen=True, slots=True)
class Row:
    """Row of a table.

    Args:
        name: Heading of the row.
        values: Values, one for each column but the first.
        unit: Unit of the values; empty for none.
        aim: Objective as text; empty for none.
        kind: Classes of the heading.
    """

    name: str
    values: tuple[Value, ...]
    unit: str = ""
    aim: str = ""
    kind: str = ""


@dataclass(frozen=True, slots=True)
class Column:
    """Heading of a column, with the unit of its values and its classes."""

    name: str
    unit: str = ""
    kind: str = ""


@dataclass(frozen=True, slots=True)
class Table:
    """A table with its label for screen readers; `look` is its classes in the style sheet."""

    label: str
    caption: str
    columns: Sequence[Column]
    rows: Sequence[Row]
    look: str = "result"


def gain_rows(record: Record) -> list[dict[str, Any]]:
    """Return what was gained, a row for each KPI, as the page shows it."""
    assert record.best is not None
    spread = Spread(trial.experiment.kpis for trial in record.trials)
    return gained(record.before.experiment, record.best.experiment, record.kpis, spread)


def gain_table(record: Record) -> Table:
    """Return what was gained over the baseline, largest change first."""
    assert record.best is not None
    kinds = {"better": "words yes", "worse": "words no", "": ""}
    rows = [
        Row(
            row["title"],
            (
                Value(row["before"]),
                Value(row["after"], row["met"], "best"),
                Value(row["change"]),
                Value(row["verdict"], kind=kinds[row["verdict"]]),
            ),
            row["unit"],
            row["objective"],
        )
        for row in gain_rows(record)
    ]
    before = f"{record.baseline.name} ({record.before.number})"
    names = ("", before, f"best ({record.best.number})", "change", "")
    columns = [Column(name) for name in names]
    caption = "Largest change first. ✓ meets the objective, ✗ does not."
    return Table("What was gained", caption, columns, rows)


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


def pid_forms_of(record: Record) -> list[tuple[Parameter, str, str]]:
    """Return each parameter of a tuned PID in both forms, with its best value and that before.

    Empty for other controllers.
    """
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

    return [(new, text(new), text(old)) for new, old in zip(best, before, strict=True)]


def pid_table(record: Record) -> Table | None:
    """Return the tuned PID in the ISA and the parallel form; None for other controllers."""
    before = record.baseline.name
    rows = [
        Row(p.name, (Value(p.form, kind="words"), Value(new, kind="best"), Value(old)), p.unit)
        for p, new, old in pid_forms_of(record)
    ]
    caption = (
        "ISA form: K_p (b r − y + 1/T_i ∫(r − y) dt + T_d d(c r − y)/dt). Parallel form: K_i and "
        f"K_d in place of K_p/T_i and K_p T_d. To go back, set the values of the {before}."
    )
    columns = [Column(name) for name in ("", "form", "best", before)]
    return Table("The PID in both forms", caption, columns, rows) if rows else None


def result_columns(record: Record) -> dict[str, Experiment]:
    """Return the experiments of the result table by heading: best, baseline, references."""
    assert record.best is not None
    return {"best": record.best.experiment, **record.compared_with}


def result_rows(record: Record, experiments: Iterable[Experiment]) -> Iterator[Row]:
    """Yield a row for each knob, the cost, each KPI, and how these experiments ended."""
    shown = list(experiments)
    for i, knob in enumerate(record.scenario.space):
        yield Row(knob.name, tuple(Value(knob_number(knob, e.theta[i])) for e in shown), knob.unit)
    if record.shows_cost:
        yield Row("performance index", tuple(Value(number(record.cost(e))) for e in shown))
    for part, kpi in _grouped(record.kpis, shown):
        values = tuple(_judged(kpi, e) for e in shown)
        title = kpi.title if part in ("", WORST) else named(kpi.title, part)
        yield Row(title, values, kpi.unit, objective(kpi))
    yield Row("ended", tuple(Value(ended_text(e)) for e in shown))


def _grouped(kpis: Sequence[KPI], shown: Sequence[Experiment]) -> Sequence[tuple[str, KPI]]:
    """Return KPIs by group; without maneuvers all of them, even those that no experiment has."""
    if not any(run.maneuver for e in shown for run in e.runs):
        return [("", kpi) for kpi in kpis]
    return grouped(kpis, *shown)


def result_table(record: Record) -> Table:
    """Return the best experiment beside the baseline and the references."""
    columns = result_columns(record)
    rows = [
        replace(row, values=(replace(row.values[0], kind="best"), *row.values[1:]))
        for row in result_rows(record, columns.values())
    ]
    headings = [Column(name) for name in ("", *columns)]
    return Table("Result table", "✓ meets the objective, ✗ does not.", headings, rows)


def experiment_table(record: Record) -> Table:
    """Return every experiment with θ and the main KPIs, in the order of their numbers."""
    assert record.best is not None
    kpis = shown_values(record)
    rows = []
    for trial in record.trials:
        kind = "best" if trial.index == record.best.index else ""
        theta = [Value(k["text"]) for k in theta_view(record.scenario.space, trial.experiment)]
        values = (*theta, *(_judged(kpi, trial.experiment) for kpi in kpis))
        cells = tuple(Value(v.text, v.met, kind) for v in values)
        ended = Value(ended_text(trial.experiment), kind=f"words {kind}".strip())
        rows.append(Row(str(trial.number), (*cells, ended), kind=kind))
    named = [Column(k.name, k.unit) for k in record.scenario.space]
    named += [Column(k.title, k.unit) for k in kpis]
    columns = [Column("exp."), *named, Column("ended", kind="words")]
    caption = "The tinted experiment is the best. ✓ meets the objective, ✗ does not."
    return Table("Experiments", caption, columns, rows, "tight")


def comparison_table(record: Record) -> Table:
    """Return every question with its answer, in the order of the answers."""
    rows = [
        Row(str(row), tuple(_answered(comparison))) for row, comparison in enumerate(record.asked, start=1)
    ]
    words = [Column(name, kind="words") for name in ("verdict", "marks")]
    columns = [Column("no."), *words, Column("newer experiment"), Column("compared with")]
    caption = (
        "The tinted experiment was preferred; its values are under Experiments. All KPIs and full "
        "precision are in comparisons.csv."
    )
    return Table("Comparisons", caption, columns, rows, "tight")


def _answered(comparison: Comparison) -> Iterator[Value]:
    query, answer = comparison.query, comparison.answer
    assert query.incumbent is not None
    yield Value(VERDICTS[answer.preference], kind="words")
    yield Value("; ".join(marks_text(answer)), kind="words")
    for sample, wins in ((query.challenger, Preference.CHALLENGER), (query.incumbent, Preference.INCUMBENT)):
        yield Value(str(sample.index + 1), kind="best" if answer.preference is wins else "")


def shown_values(record: Record) -> list[KPI]:
    """Return the KPIs that tell experiments apart, as many as fit into a table."""
    return foremost_kpis(record, _MOST)


def _judged(kpi: KPI, experiment: Experiment) -> Value:
    return Value(measured(kpi, experiment), kpi.met_by(experiment))
