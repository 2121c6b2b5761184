"""List the tables of the report: the result, every experiment, and every comparison, also as CSV."""

import csv
import io
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, TypeVar

import numpy as np

from prefcal_app.summary.compare import Spread
from prefcal_app.summary.counts import VERDICTS
from prefcal_app.view.end import gain_view, gained
from prefcal_app.view.sides import theta_texts, theta_view
from prefcal_app.view.tables import cell, column, judged, row, table
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.experiments.maneuvers import named
from prefcal_env.preferences.answer import Preference
from prefcal_env.preferences.loop import Comparison
from prefcal_scenarios.kpis import WORST, grouped
from prefcal_scenarios.presentation.pid_forms import Parameter, pid_forms
from prefcal_scenarios.presentation.wording import (
    ended_text,
    knob_number,
    labeled,
    marks_text,
    number,
    objective,
)
from prefcal_scenarios.scenario import KPI

from .record import StudyRecord

_T = TypeVar("_T")
_MOST = 3
"""Number of KPIs that the table of experiments shows."""


def gain_rows(record: StudyRecord) -> list[dict[str, Any]]:
    """Return what was gained, a row for each KPI, as the page shows it."""
    assert record.best is not None
    spread = Spread(trial.experiment.kpis for trial in record.trials)
    return gained(record.before.experiment, record.best.experiment, record.kpis, spread)


def gain_of(record: StudyRecord) -> dict[str, Any]:
    """Return what was gained over the baseline, as the page shows it."""
    assert record.best is not None
    before = theta_view(record.scenario.space, record.before.experiment)
    return gain_view(record.baseline, record.best.index, gain_rows(record), before)


def foremost(ranked: Sequence[_T], room: int, has_limit: Callable[[_T], bool]) -> list[_T]:
    """Return as many rows as fit; those with an objective are the last ones to be left out."""
    order = sorted(range(len(ranked)), key=lambda i: (not has_limit(ranked[i]), i))
    return [ranked[i] for i in sorted(order[:room])]


def foremost_kpis(record: StudyRecord, room: int) -> list[KPI]:
    """Return the KPIs that tell experiments apart, in the order of what was gained.

    Values that read the same are no difference. A KPI that is the same in all experiments tells
    something only if it misses its objective.
    """
    order = [row["title"] for row in gain_rows(record)]
    ranked = sorted(record.kpis, key=lambda kpi: order.index(kpi.title))
    return foremost([k for k in ranked if _tells(record, k)], room, lambda k: bool(objective(k)))


def _tells(record: StudyRecord, kpi: KPI) -> bool:
    values = np.unique(record.read(kpi))
    known = values[~np.isnan(values)]
    return len(known) > 1 or any(kpi.met(value) is False for value in known)


def pid_forms_of(record: StudyRecord) -> list[tuple[Parameter, str, str]]:
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


def pid_table(record: StudyRecord) -> dict[str, Any] | None:
    """Return the tuned PID in the ISA and the parallel form; None for other controllers."""
    before = record.baseline
    rows = [
        row(p.name, (cell(p.form, kind="words"), cell(new, kind="best"), cell(old)), unit=p.unit)
        for p, new, old in pid_forms_of(record)
    ]
    caption = (
        "ISA form: K_p (b r − y + 1/T_i ∫(r − y) dt + T_d d(c r − y)/dt). Parallel form: K_i and "
        f"K_d in place of K_p/T_i and K_p T_d. To go back, set the values of the {before}."
    )
    return table("The PID in both forms", ("", "form", "best", before), rows, caption) if rows else None


def result_columns(record: StudyRecord) -> dict[str, Experiment]:
    """Return the experiments of the result table by heading: best, baseline, references."""
    assert record.best is not None
    return {"best": record.best.experiment, **record.compared_with}


def result_rows(record: StudyRecord, experiments: Iterable[Experiment]) -> Iterator[dict[str, Any]]:
    """Yield a row for each knob, the cost, each KPI, and how these experiments ended."""
    shown = list(experiments)
    for i, knob in enumerate(record.scenario.space):
        yield row(knob.name, [cell(knob_number(knob, e.theta[i])) for e in shown], unit=knob.unit)
    if record.shows_cost:
        yield row("performance index", [cell(number(record.cost(e))) for e in shown])
    for part, kpi in _grouped(record.kpis, shown):
        title = kpi.title if part in ("", WORST) else named(kpi.title, part)
        yield row(title, [judged(kpi, e) for e in shown], unit=kpi.unit, aim=objective(kpi))
    yield row("ended", [cell(ended_text(e)) for e in shown])


def _grouped(kpis: Sequence[KPI], shown: Sequence[Experiment]) -> Sequence[tuple[str, KPI]]:
    """Return KPIs by group; without maneuvers all of them, even those that no experiment has."""
    if not any(run.maneuver for e in shown for run in e.runs):
        return [("", kpi) for kpi in kpis]
    return grouped(kpis, *shown)


def result_table(record: StudyRecord) -> dict[str, Any]:
    """Return the best experiment beside the baseline and the references."""
    columns = result_columns(record)
    rows = list(result_rows(record, columns.values()))
    for each in rows:
        each["cells"][0]["kind"] = "best"
    return table("Result table", ("", *columns), rows, "✓ meets the objective, ✗ does not.")


def experiment_table(record: StudyRecord) -> dict[str, Any]:
    """Return every experiment with θ and the main KPIs, in the order of their numbers."""
    assert record.best is not None
    kpis = shown_values(record)
    rows = []
    for trial in record.trials:
        kind = "best" if trial.index == record.best.index else ""
        theta = theta_texts(record.scenario.space, trial.experiment.theta)
        cells = [cell(text, kind=kind) for text in theta]
        cells += [judged(kpi, trial.experiment, kind) for kpi in kpis]
        cells.append(cell(ended_text(trial.experiment), kind=f"words {kind}".strip()))
        rows.append(row(str(trial.number), cells, kind=kind))
    knobs = [column(k.name, k.unit) for k in record.scenario.space]
    columns: list[dict[str, Any] | str] = [
        "exp.",
        *knobs,
        *(column(k.title, k.unit) for k in kpis),
        column("ended", kind="words"),
    ]
    caption = "The tinted experiment is the best. ✓ meets the objective, ✗ does not."
    return table("Experiments", columns, rows, caption, "tight")


def comparison_table(record: StudyRecord) -> dict[str, Any]:
    """Return every question with its answer, in the order of the answers."""
    rows = [row(str(k), list(_answered(comparison))) for k, comparison in enumerate(record.asked, start=1)]
    words = [column(name, kind="words") for name in ("verdict", "marks")]
    columns: list[dict[str, Any] | str] = ["no.", *words, "newer experiment", "compared with"]
    caption = (
        "The tinted experiment was preferred; its values are under Experiments. All KPIs and full "
        "precision are in comparisons.csv."
    )
    return table("Comparisons", columns, rows, caption, "tight")


def _answered(comparison: Comparison) -> Iterator[dict[str, Any]]:
    query, answer = comparison.query, comparison.answer
    assert query.incumbent is not None
    yield cell(VERDICTS[answer.preference], kind="words")
    yield cell("; ".join(marks_text(answer)), kind="words")
    for sample, wins in ((query.challenger, Preference.CHALLENGER), (query.incumbent, Preference.INCUMBENT)):
        yield cell(str(sample.index + 1), kind="best" if answer.preference is wins else "")


def shown_values(record: StudyRecord) -> list[KPI]:
    """Return the KPIs that tell experiments apart, as many as fit into a table."""
    return foremost_kpis(record, _MOST)


def comparisons_as_csv(record: StudyRecord) -> str:
    """Return the text of comparisons.csv."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_headings(record))
    for k, comparison in enumerate(record.asked, start=1):
        writer.writerow([k, *_cells(record, comparison)])
    return text.getvalue()


def _headings(record: StudyRecord) -> Iterator[str]:
    yield from ("comparison", "verdict", "preference", "strength", "marks", "automatic marks")
    scenario = record.scenario
    for side in ("challenger", "incumbent"):
        yield f"{side} experiment"
        yield from (f"{side} {labeled(k.name, k.unit)}" for k in scenario.space)
        yield from (f"{side} {labeled(k.title, k.unit)}" for k in record.kpis)
        yield from (f"{side} cost", f"{side} ended")


def _cells(record: StudyRecord, comparison: Comparison) -> Iterator[object]:
    answer, query = comparison.answer, comparison.query
    yield VERDICTS[answer.preference]
    yield "" if answer.preference is None else int(answer.preference)
    yield answer.strength
    yield ", ".join(mark.value for mark in answer.marks)
    yield ", ".join(mark.value for mark in answer.automatic)
    assert query.incumbent is not None
    assert comparison.incumbent is not None
    yield query.challenger.index + 1
    yield from _side(record, comparison.challenger)
    yield query.incumbent.index + 1
    yield from _side(record, comparison.incumbent)


def _side(record: StudyRecord, experiment: Experiment) -> Iterator[object]:
    scenario = record.scenario
    yield from scenario.space.named(experiment.theta).values()
    yield from (experiment.kpis.get(k.name, "") for k in record.kpis)
    cost = record.cost(experiment)
    yield "" if cost is None else cost
    yield ended_text(experiment)
