"""How limits are stated is said in lines that can be loaded, for each kind of scenario."""

from dataclasses import replace

import pytest

from prefcal_scenarios import KPI, load
from prefcal_scenarios.described.description import limits_in

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
LIMITS = {"overshoot": 10.0, "settling_time": 130.0}


@pytest.fixture
def source(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tank.py").write_text(PLANT)
    return 'pid {"knobs": {"K_p": "0.1:10:log"}, "plant": "tank.py:plant"}'


def same_but_for_limits(loaded, made):
    assert loaded.space.names == made.space.names
    assert [kpi.name for kpi in loaded.kpis] == [kpi.name for kpi in made.kpis]
    assert {kpi.name: kpi.at_most for kpi in loaded.kpis if kpi.name in LIMITS} == LIMITS


def test_of_a_controller_with_options_it_is_a_file_and_of_a_file_its_table(source, tmp_path):
    made = load(source)
    lead, lines = limits_in(source, made.kpis, LIMITS)
    assert lead == "For that, calibrate a TOML file of these lines."
    assert lines[:5] == (
        'controller = "pid"',
        'plant = "tank.py:plant"',
        "[knobs]",
        '"K_p" = "0.1:10:log"',
        "[kpis]",
    )
    assert '"overshoot" = {"at_most" = 10.0}' in lines
    (tmp_path / "a.toml").write_text("\n".join(lines))
    same_but_for_limits(load("a.toml"), made)
    lead, lines = limits_in("b.toml", made.kpis, LIMITS)
    assert lead == "For that, these lines go to the end of b.toml, in place of [kpis]."
    rest = 'controller = "pid"\nplant = "tank.py:plant"\n[knobs]\nK_p = "0.1:10:log"\n'
    (tmp_path / "b.toml").write_text("\n".join([rest, *lines]))
    same_but_for_limits(load("b.toml"), made)
    # What the file states of its own KPIs stays: without its formula, one is unknown.
    own = 'overshoot = {}\nsettling_time = {}\nenergy = "integral(abs(inflow))"\n'
    (tmp_path / "c.toml").write_text(f"{rest}[kpis]\n{own}")
    made = load("c.toml")
    _, lines = limits_in("c.toml", made.kpis, LIMITS)
    (tmp_path / "d.toml").write_text("\n".join([rest, *lines]))
    same_but_for_limits(load("d.toml"), made)


def test_of_a_python_file_it_is_its_kpis_and_a_built_in_one_takes_none():
    kpis = (KPI("overshoot", "overshoot of 'level'", "%", better="lower"), KPI("peak", "peak"))
    _, lines = limits_in("mine.py:SCENARIO", kpis, {"overshoot": 10.0})
    (made,) = eval("\n".join(lines), {"KPI": KPI})
    assert made == replace(kpis[0], at_most=10.0, better=None)
    assert limits_in("cstr", kpis, {"overshoot": 10.0}) == ("", ())
