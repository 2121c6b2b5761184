"""Live plants of TOML files: what becomes of the table [opcua], and what is refused."""

import re
from pathlib import Path

import pytest

from prefcal_env.errors import ScenarioError
from prefcal_env.worlds.live import LiveRig
from prefcal_scenarios.catalog import load

pytest.importorskip("asyncua")
DOCS = Path(__file__).parents[3] / "docs"
TANK = re.search(r"```toml\n(.*?)```", (DOCS / "live.md").read_text("utf-8"), re.S)[1]


@pytest.fixture
def written(tmp_path):
    def write(text):
        (tmp_path / "tank.toml").write_text(text, encoding="utf-8")
        return str(tmp_path / "tank.toml")

    return write


def test_the_file_of_the_page_is_a_live_plant(written):
    tank = load(written(TANK))
    assert isinstance(tank.run, LiveRig)
    assert (tank.name, tank.title) == ("tank", "Level of a tank")
    assert tank.space.names == ("K_p", "T_i")
    assert tank.run.start[0].value == 1.5
    assert [kpi.name for kpi in tank.kpis] == [
        "settling time of level",
        "overshoot of level",
        "integrated error of level",
        "total move of valve",
    ]


def test_a_formula_is_checked_before_the_plant_runs(written):
    peak = TANK + '\n[kpis]\npeak = "max(level) - ref(level) + sum(abs(diff(valve)))"\n'
    assert [kpi.name for kpi in load(written(peak)).kpis] == ["peak"]
    with pytest.raises(ScenarioError, match=r"formula of KPI 'peak': signal 'levl': .*mean 'level'"):
        load(written(peak.replace("max(level)", "max(levl)")))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("rate = 5,", "", r"tank\.toml, \[opcua\]: knobs\.K_p: 'rate' is missing"),
        ("[opcua]", '[knobs]\nK = "1:2"\n[opcua]', r"no \[knobs\]: write \[opcua\.knobs\]"),
        ("[opcua]", "[reference]\nlevel = 1\n[opcua]", r"write \[opcua\.references\]"),
        ("[opcua]", "timeout = 3\n[opcua]", r"write it below \[opcua\]"),
        ("[opcua]", "stop_time = 3\n[opcua]", "write duration in"),
    ],
)
def test_a_wrong_table_is_refused_with_its_place(written, old, new, words):
    with pytest.raises(ScenarioError, match=words):
        load(written(TANK.replace(old, new, 1)))


def test_a_relative_journal_lies_beside_the_file(written, tmp_path, monkeypatch):
    path = written(TANK.replace("[opcua]", '[opcua]\njournal = "kept/old.json"', 1))
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert load(path).run.journal.path == tmp_path / "kept" / "old.json"
    there = str(tmp_path / "far.json")
    path = written(TANK.replace("[opcua]", f'[opcua]\njournal = "{there}"', 1))
    assert str(load(path).run.journal.path) == there
