"""Write the comparisons as CSV: one row per question, full precision, units in the headings."""

import csv
import io
from collections.abc import Iterator

from prefcal_env.experiments.experiment import Experiment
from prefcal_env.preferences.loop import Comparison
from prefcal_scenarios.presentation.wording import ended_text, labeled

from .record import VERDICTS, Record


def comparisons_as_csv(record: Record) -> str:
    """Return the text of comparisons.csv."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_headings(record))
    for number, comparison in enumerate(record.asked, start=1):
        writer.writerow([number, *_cells(record, comparison)])
    return text.getvalue()


def _headings(record: Record) -> Iterator[str]:
    yield from ("comparison", "verdict", "preference", "strength", "marks", "automatic marks")
    scenario = record.scenario
    for side in ("challenger", "incumbent"):
        yield f"{side} experiment"
        yield from (f"{side} {labeled(k.name, k.unit)}" for k in scenario.space)
        yield from (f"{side} {labeled(k.title, k.unit)}" for k in record.kpis)
        yield from (f"{side} cost", f"{side} ended")


def _cells(record: Record, comparison: Comparison) -> Iterator[object]:
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


def _side(record: Record, experiment: Experiment) -> Iterator[object]:
    scenario = record.scenario
    yield from scenario.space.named(experiment.theta).values()
    yield from (experiment.kpis.get(k.name, "") for k in record.kpis)
    cost = record.cost(experiment)
    yield "" if cost is None else cost
    yield ended_text(experiment)
