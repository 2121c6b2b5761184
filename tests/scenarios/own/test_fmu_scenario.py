"""Scenarios of FMUs: nothing but names and numbers, in Python and on the command line."""

import numpy as np
import pytest

from prefcal_env import End, Knob
from prefcal_env.errors import RunError, ScenarioError
from prefcal_scenarios.own.fmu_scenario import fmu_scenario
from support.fmus import CRASHES, built

KNOBS = [Knob("K_p", 0.1, 100, scale="log10"), Knob("T_i", 1, 60)]


@pytest.fixture(scope="module")
def tank(tmp_path_factory):
    return built(tmp_path_factory.mktemp("fmu"))


def test_a_scenario_shows_the_outputs_of_the_fmu_and_finds_control_signals_by_name(tank):
    scenario = fmu_scenario(tank, knobs=KNOBS, reference={"level": 2})
    assert (scenario.title, scenario.brief) == ("Tank", "Level of a tank under PI control.")
    experiment = scenario.run(np.array([3.0, 10.0]))
    assert experiment.end is End.TIME_UP
    assert [c.name for c in experiment.channels.y] == ["level"]
    assert [c.name for c in experiment.channels.u] == ["valve"]
    assert any(name.endswith("of level") for name in experiment.kpis)


def test_without_knobs_each_parameter_is_told_with_an_option_to_copy(tank):
    with pytest.raises(ScenarioError) as caught:
        fmu_scenario(tank)
    assert '--knob "K_p=0.1:10:log"  (now 1, Gain)' in str(caught.value)
    assert '--knob "mode=-5:5:int"  (now 0, What goes wrong)' in str(caught.value)


def test_a_run_that_crashes_says_why(tank):
    scenario = fmu_scenario(tank, knobs=[Knob("mode", 0, 4, integer=True)], show=["level"])
    with pytest.raises(RunError, match="SIGABRT"):
        scenario.run(np.array([float(CRASHES)]))


def test_the_command_line_checks_an_fmu_and_tells_how_to_start(tank, capsys, monkeypatch, tmp_path):
    from prefcal_scenarios.app.cli import main

    monkeypatch.chdir(tmp_path)
    command = ["prefcal", "check", str(tank), "--knob", "K_p=0.1:100:log", "--reference", "level=2"]
    monkeypatch.setattr("sys.argv", command)
    with pytest.raises(SystemExit) as ended:
        main()
    assert not ended.value.code
    assert "--knob K_p=0.1:100:log" in capsys.readouterr().out
