"""`prefcal new`: every starter runs as it is written."""

import json
import shlex
from pathlib import Path

import pytest

from prefcal_app.cli.starters.new import KINDS
from prefcal_scenarios.catalog import load

DOCS = Path(__file__).parents[3] / "docs"


@pytest.mark.parametrize("kind", [k for k in KINDS if k not in ("fmu", "opcua")])
def test_a_starter_passes_its_check_by_the_command_that_is_told(prefcal, done, kind):
    out = done("new", kind)
    check = next(line for line in out.splitlines() if line.startswith("Check it:"))
    out = done(*shlex.split(check.partition("prefcal ")[2]))
    tune = next(iter(KINDS[kind].source))
    assert f"prefcal calibrate {tune.replace('FILE', kind + KINDS[kind].suffix)}" in out


@pytest.mark.parametrize(
    ("kind", "cost"),
    [("function", "settling time of level"), ("controller", "overshoot of level"), ("pid", "M_s")],
)
def test_a_starter_is_tuned_unattended_by_a_kpi_as_the_refusal_advises(prefcal, done, refused, kind, cost):
    assert prefcal("new", kind)[0] == 0
    words = [w.replace("FILE", f"{kind}.py") for w in KINDS[kind].source]
    words += ["--calibrator", "synthetic", "--n-max", "3", "--simulate", "0"]
    assert "say what to go by: a KPI (--cost " in refused("calibrate", *words)
    out = done("calibrate", *words, "--cost", cost, "--out", "made", "--json")
    found = json.loads(out)
    assert found["experiments"] == 3
    assert found["cost"] >= 0


@pytest.mark.parametrize("kind", ["function", "pid", "controller", "mpc"])
def test_a_scenario_and_so_its_studies_are_called_as_the_file_is(prefcal, done, kind):
    out = done("new", kind, "folder/pump 2.py")
    check = next(line for line in out.splitlines() if line.startswith("Check it:"))
    told = shlex.split(check.partition("prefcal ")[2])
    if kind == "pid":
        assert load(f'pid {{"plant": "{told[-1]}"}}').name == "pid-pump-2"
    else:
        assert load(told[-1]).name == "pump-2"


@pytest.mark.parametrize("kind", [kind for kind, row in KINDS.items() if row.suffix == ".py"])
def test_a_starter_is_at_most_30_lines(kind):
    lines = KINDS[kind].text(Path(kind)).splitlines()
    assert len(lines) <= 30
    assert max(map(len, lines)) <= 100


def test_the_first_experiment_of_the_starter_with_a_pid_hardly_overshoots(prefcal):
    assert prefcal("new", "pid", "tank.py")[0] == 0
    tank = load('pid {"plant": "tank.py:plant"}')
    assert tank.run(tank.references["MIGO"]).kpis["overshoot"] < 10


def test_a_file_is_never_replaced(refused, tmp_path):
    (tmp_path / "rig.toml").write_text("mine")
    assert "exists: give another name" in refused("new", "rig")
    assert (tmp_path / "rig.toml").read_text() == "mine"
