"""Limits that are typed mean the same as in a file, and a wrong one says what it must be."""

import re
from dataclasses import replace

import numpy as np
import pytest

from prefcal_env.errors import ScenarioError
from prefcal_scenarios import KPI, Scenario, load
from prefcal_scenarios.described.description import limit_of
from prefcal_scenarios.described.making import limited

PLANT = """
from prefcal_env import Channel
from prefcal_env.plants import FunctionPlant

plant = FunctionPlant(
    lambda x, u, d: [(u[0] - x[0]) / 5],
    lambda x, u, d: [x[0]],
    states=[Channel("level", "m")],
    inputs=[Channel("inflow", "%", low=0.0, high=10.0)],
    outputs=[Channel("level", "m", target=2.0)],
    time_unit="s",
)
"""
SOURCE = 'pid {{"knobs": {{"K_p": "0.1:10:log"}}, "plant": "tank.py:plant", "limits": {}}}'


@pytest.fixture(autouse=True)
def _tank(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tank.py").write_text(PLANT)


@pytest.mark.parametrize(
    ("text", "name", "entry"),
    [
        ("overshoot <= 10 %", "overshoot", {"at_most": 10.0, "unit": "%"}),
        ("phase_margin>=45", "phase_margin", {"at_least": 45.0}),
        ("overshoot<=10%", "overshoot", {"at_most": 10.0, "unit": "%"}),
        ("lag of oil level ≤ 1e-1 [min]", "lag of oil level", {"at_most": 0.1, "unit": "min"}),
    ],
)
def test_a_limit_is_read_as_an_entry_of_a_file(text, name, entry):
    assert limit_of(text) == (name, entry)


@pytest.mark.parametrize(
    "text",
    ["overshoot", "overshoot <= much", "<= 10", "overshoot = 10", "x <= nan", "x <= 1.2.3", "x <= 2,5 %"],
)
def test_what_is_no_limit_is_refused_with_what_one_is(text):
    with pytest.raises(ScenarioError, match=f"decimal point\\), got {text!r}"):
        limit_of(text)


def test_limits_are_those_of_a_file_in_its_units_and_other_kpis_stay():
    free = load(SOURCE.format("[]"))
    made = load(SOURCE.format('["settling_time <= 2 min", "overshoot <= 10 %", "overshoot >= 1"]'))
    rest = 'controller = "pid"\nplant = "tank.py:plant"\n[knobs]\nK_p = "0.1:10:log"\n[kpis]\n'
    with open("a.toml", "w") as file:
        file.write(rest + "settling_time = { at_most = 2, unit = 'min' }\novershoot = 10\n")
    known, stated = ({kpi.name: kpi for kpi in each.kpis} for each in (made, load("a.toml")))
    assert [*known] == [kpi.name for kpi in free.kpis]
    assert known["settling_time"] == stated["settling_time"]
    assert (known["settling_time"].at_most, known["settling_time"].unit) == (120.0, "s")
    assert (known["overshoot"].at_least, known["overshoot"].at_most) == (1.0, stated["overshoot"].at_most)


def test_a_limit_may_name_the_title_of_a_kpi_or_margin():
    free = load(SOURCE.format("[]"))
    titles = {kpi.name: kpi.title for kpi in free.kpis}
    made = limited(free, [f"{titles['settling_time']} <= 2 min", "phase margin >= 45"])
    known = {kpi.name: kpi for kpi in made.kpis}
    assert titles["settling_time"] == "settling time of level (within ±5 %)"
    assert (known["settling_time"].at_most, known["phase_margin"].at_least) == (120.0, 45.0)


def test_a_limit_of_a_margin_lets_it_be_computed():
    made = load(SOURCE.format('["phase_margin >= 45 °"]'))
    assert made.kpis[-1].name == "phase_margin"
    assert made.kpis[-1].margin
    value = made.run(next(iter(made.references.values()))).kpis["phase_margin"]
    assert value == pytest.approx(42.2, abs=0.1)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("overshot <= 10 %", "no KPI 'overshot'. Did you mean 'overshoot'? Expected one of settling_time, "),
        ("overshoot <= 10 m", "'overshoot': its unit must be %, or one that converts into it, got 'm'"),
        # No run of a PID has it, so a limit of it would be kept by all.
        (
            "overshoot <= 10%; overshoot <= 14%",
            "'overshoot' is limited twice, the second time by 'overshoot <= 14%'",
        ),
        ("integrated error of level <= 3", "there is no KPI 'integrated error of level'"),
    ],
)
def test_a_limit_of_what_no_run_has_is_refused(text, said):
    with pytest.raises(ScenarioError, match=re.escape(said)):
        limited(load(SOURCE.format("[]")), text.split("; "))


def test_an_option_adds_its_limit_to_those_of_the_file_and_replaces_that_of_the_same_kpi(tmp_path):
    (tmp_path / "tank.toml").write_text(
        'controller = "pid"\nplant = "tank.py:plant"\n'
        'limits = ["overshoot <= 10 %", "settling_time <= 90 s"]\n'
    )
    kpis = {kpi.name: kpi for kpi in load('tank.toml {"limits": ["overshoot <= 4 %"]}').kpis}
    assert (kpis["overshoot"].at_most, kpis["settling_time"].at_most) == (4.0, 90.0)


def test_an_own_loop_without_an_m_s_of_its_own_can_be_limited_by_that_of_its_margins():
    pid = load(SOURCE.format("[]"))
    own = replace(pid, kpis=tuple(kpi for kpi in pid.kpis if kpi.name != "M_s"))
    (*_, limit) = limited(own, ["M_s <= 1.8"]).kpis
    assert (limit.name, limit.at_most, limit.goal, limit.margin) == ("M_s", 1.8, "lower", True)
    kept = next(kpi for kpi in limited(pid, ["M_s <= 1.8"]).kpis if kpi.name == "M_s")
    assert kept.about == next(kpi for kpi in pid.kpis if kpi.name == "M_s").about, "a PID has its own"


def test_of_ones_own_scenario_only_its_kpis_can_be_limited():
    space, run = load("lag").space, lambda theta, seed=0: None
    own = Scenario("own", "Own", space, run, kpis=(KPI("left", "left", "m", better="lower"),))
    assert limited(own, ["left <= 5 cm"]).kpis[0].at_most == pytest.approx(0.05)
    assert limited(own, []) is own
    with pytest.raises(ScenarioError, match=r"Expected one of left$"):
        limited(own, ["phase_margin >= 45"])
    assert np.isinf(own.kpis[0].at_most)
    with pytest.raises(ScenarioError, match=r"known before the first run: name them in \[kpis\]"):
        limited(Scenario("own", "Own", space, run), ["left <= 5 cm"])
