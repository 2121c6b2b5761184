"""What "How it went" and "Comparisons" show: differences that people can see, and every answer."""

from dataclasses import replace

import numpy as np
import pytest

from prefcal_app.report.pictures import course, drawn_kpis
from prefcal_app.report.record import MOST, foremost_kpis
from prefcal_scenarios import KPI
from toy_study import toy_record


def with_kpis(kpis, values):
    """A study with these KPIs: `values` maps the number of an experiment to its values."""
    record = replace(toy_record(), judged=False)
    scenario = replace(record.scenario, kpis=kpis, cost=None)
    names = [kpi.name for kpi in kpis]

    def told(experiment):
        numbers = {t.number for t in record.trials if t.experiment is experiment}
        known = dict(zip(names, values(min(numbers, default=1)), strict=True))
        return replace(experiment, kpis=known)

    comparisons = tuple(
        c._replace(challenger=told(c.challenger), incumbent=c.incumbent and told(c.incumbent))
        for c in record.comparisons
    )
    return replace(record, scenario=scenario, comparisons=comparisons)


def test_the_kpis_that_changed_most_are_shown_and_always_those_with_a_limit():
    kpis = (*(KPI(f"k{i}", f"k{i}", better="lower") for i in range(6)), KPI("M_s", "M_s", at_most=2))
    # The later a KPI, the more it changes; that with a limit changes least.
    record = with_kpis(kpis, lambda n: [*(100 + n * i for i in range(6)), 1.5 + n / 100])
    assert record.best.number > 1
    assert [kpi.name for kpi in drawn_kpis(record)] == ["k5", "k4", "k3", "M_s"]
    assert [kpi.name for kpi in foremost_kpis(record, MOST)] == ["k5", "k4", "M_s"]


def test_a_kpi_that_reads_the_same_everywhere_is_not_shown_unless_it_misses_its_limit():
    kpis = (
        KPI("overshoot", "overshoot", "%", better="lower", resolution=0.1),
        KPI("met", "met", at_most=1.0),
        KPI("missed", "missed", at_most=1.0),
    )
    record = with_kpis(kpis, lambda n: [0.005 * n, 0.5, 1.5])
    assert [kpi.name for kpi in drawn_kpis(record)] == ["missed"]


@pytest.mark.parametrize(
    ("kpi", "start", "visible"),
    [
        (KPI("a", "a", "%", better="lower", resolution=0.1), 0.0, 0.1),
        (KPI("a", "a", "s", better="lower"), 2.0, 0.001),
        (KPI("a", "a", "s", better="lower"), -2.0, 0.001),
    ],
)
def test_the_smallest_visible_difference_does_not_fill_a_panel(kpi, start, visible):
    record = with_kpis((kpi,), lambda n: [start + visible * (n % 2) + 0.02 * visible * n])
    axes = course(record).axes[0]
    steps = axes.lines[0].get_ydata()
    assert set(np.round(steps - start, 9)) <= {0.0, visible}
    low, high = axes.get_ylim()
    assert high - low >= 10 * visible
    assert low <= min(steps)
    assert max(steps) <= high
    assert start < 0 or low >= 0
