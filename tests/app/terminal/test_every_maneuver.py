"""Maneuvers beside the page: terminal, report, check and tables."""

import csv
import io
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from prefcal_app import figure
from prefcal_app.cli.checkup import Checkup
from prefcal_app.report.pictures import alone
from prefcal_app.view.question import largest_difference
from prefcal_env.errors import ScenarioError
from prefcal_env.experiments.panels import maneuvers_of, without_record
from prefcal_env.study import export_csv
from prefcal_scenarios import KPI
from prefcal_scenarios.own import module_at
from prefcal_scenarios.runs import grouped
from prefcal_scenarios.scenario import panels_of
from support.interviews import begin, proceed
from support.talking import talk

DOCS = Path(__file__).parents[3] / "docs"


@pytest.fixture(scope="module")
def tank():
    yield module_at(DOCS / "heated_tank.py").heated_tank
    sys.modules.pop("heated_tank", None)


@pytest.fixture(scope="module")
def pair(tank):
    return tank.run(np.array([3.0, 6.0])), tank.run(np.array([12.0, 4.0]))


GROUPS = ["worst", "mean", "step", "load", "warm"]


def test_a_question_in_the_terminal_shows_every_maneuver(tank):
    lines = talk(begin(tank, n_max=3), "x").splitlines()
    assert [line.strip() for line in lines if line.strip() in GROUPS] == GROUPS


def test_a_study_as_tables_names_the_maneuver_of_each_row(tank, tmp_path):
    proceed(interview := begin(tank, n_max=3))
    export_csv(interview.file, tmp_path)
    text = (tmp_path / "trajectories" / "experiment-001.csv").read_text("utf-8")
    rows = list(csv.DictReader(io.StringIO(text)))
    assert list(dict.fromkeys(row["maneuver"] for row in rows)) == ["step", "load", "warm"]
    assert float(next(r for r in rows if r["maneuver"] == "warm")["temperature [K]"]) == 70.0


def test_check_and_report_draw_every_maneuver(tank, pair):
    checkup = Checkup(tank, np.array([3.0, 6.0]))
    checkup.check(lambda words: None)
    words = {finding.what: finding.words for finding in checkup.findings}
    assert "3 maneuvers (step, load, warm)" in words["record"]
    assert "other KPIs" not in words
    drawn = [axes for axes in alone(tank, pair[0]).axes if axes.get_visible()]
    assert len(drawn) == 3 * len(tank.panels)
    temperatures = [axes for axes in drawn if "emperature" in axes.get_title("left")]
    starts = {line.get_ydata()[0] for axes in temperatures for line in axes.lines}
    assert starts >= {30.0, 70.0}  # where the step and the warm maneuver start


def test_two_runs_side_by_side_have_rows_for_every_maneuver(tank, pair):
    drawn = figure(tank, *pair).axes
    assert len(drawn) == 2 * 3 * len(tank.panels)
    for axes in drawn[::4], drawn[1::4]:  # the temperature of one side
        assert [round(max(a.lines, key=lambda line: len(line.get_ydata())).get_ydata()[0]) for a in axes] == [
            30,
            40,
            70,
        ]


def test_one_side_that_left_no_record_has_no_curves_in_any_maneuver(tank, pair):
    parts = maneuvers_of(without_record(pair[0]), pair[1])
    assert list(parts) == ["step", "load", "warm"]
    assert all(len(left.t) == 0 < len(right.t) for left, right in parts.values())
    panels = panels_of(tank, *parts["step"])
    assert largest_difference(panels, [(0.0, 1.0)] * len(panels), *parts["step"]) is None


def test_the_largest_difference_is_measured_on_the_axis(tank, pair):
    left, right = maneuvers_of(*pair)["step"]
    panels = panels_of(tank, left, right)
    found = largest_difference(panels, [(0.0, 50.0), (0.0, 1.0)], left, right)
    apart = np.abs(left.x[:, 0] - np.interp(left.t, right.t, right.x[:, 0]))
    assert found["panel"] == 0  # the heater does not count
    assert found["size"] == pytest.approx(apart.max() / 50, abs=1e-3)
    assert largest_difference(panels, [(0, 1)] * 2, left, left) is None


def test_kpis_come_by_group_and_a_mean_has_no_objective(tank, pair):
    groups = grouped(tank.kpis, *pair)
    assert list(dict.fromkeys(group for group, _ in groups)) == GROUPS
    assert all(kpi.met(1e9) is None for group, kpi in groups if group == "mean")
    assert any(kpi.met(1e9) is False for group, kpi in groups if group == "load")


@pytest.mark.parametrize(
    ("kpi", "words"),
    [
        (KPI("margin", "margin", better="higher"), "higher_is_better=.'margin',."),
        (KPI("margin", "margin", at_least=1.0, at_most=3.0), "targets=.'margin': 2"),
    ],
)
def test_a_scenario_whose_worst_maneuver_is_the_best_one_is_refused(tank, kpi, words):
    with pytest.raises(ScenarioError, match=words):
        replace(tank, kpis=(kpi,))
