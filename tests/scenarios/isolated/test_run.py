"""Runs of an own scenario in a process of their own; tests/env/workers kills such processes."""

from pathlib import Path

import numpy as np
import pytest

from prefcal_env.errors import RunError, SettingsError
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.workers import Worker
from prefcal_scenarios.catalog import load
from prefcal_scenarios.isolated import Isolated, isolation
from prefcal_scenarios.names import KEPT_PLANT
from prefcal_scenarios.scenario import with_ranges
from support.step_tests import table
from toy_study import toy_scenario

WILD = str(Path(__file__).parents[2] / "support" / "wild_runs.py")
THETA = np.array([0.31, 26, 0.5])
SPINS, EXITS, LEAVES, RAISES, MEMORY, NOTHING = range(1, 7)


@pytest.fixture(scope="module")
def wild():
    """The wild plant, with a second for each run."""
    source = f"{WILD}:plant"
    with isolation(source, 1.0) as isolated:
        yield isolated(load(source))


@pytest.mark.parametrize(
    ("seed", "why", "words"),
    [
        (SPINS, "late", r"longer than 1 s .*--run-timeout.* was in wild_runs.py:\d+: "),
        (EXITS, "died", r"exit code 3"),
        (LEAVES, "raised", r"run called exit: bye"),
        (RAISES, "raised", r"ZeroDivisionError: division by zero \(in wild_runs.py:\d+: "),
        (MEMORY, "raised", r"MemoryError"),
        (NOTHING, "raised", r"must return an Experiment, got NoneType: is a return missing"),
    ],
)
def test_whatever_a_run_does_is_told_and_the_next_one_runs(wild, seed, why, words):
    with pytest.raises(RunError, match=words) as raised:
        wild.run(THETA, seed=seed)
    assert raised.value.why == why
    theirs = why == "raised" and seed != NOTHING  # an error of prefcal says it all
    assert theirs == ("Traceback" in raised.value.trace)
    assert wild.run(THETA) == toy_scenario().run(THETA)


def test_a_file_that_loads_only_here_is_told(tmp_path):
    path = tmp_path / "own.py"
    path.write_text(f"from prefcal_scenarios import load\ntoy = load({WILD!r} + ':TOY')\n")
    with isolation(f"{path}:toy", early=False) as isolated:
        scenario = isolated(load(f"{path}:toy"))
        path.write_text("raise OSError('no such port')\n")
        with pytest.raises(RunError, match="no such port"):
            scenario.run(THETA)


def test_a_run_that_checks_its_ranges_is_given_those_of_the_study():
    source = f"{WILD}:takes_space"
    with isolation(source) as isolated:
        scenario = isolated(load(source))
        assert scenario.run(THETA).kpis["largest"] == 0.0
        knobs = scenario.space.knobs
        wider = KnobSpace((Knob("T_s", 0.25, 9.0, "h"), *knobs[1:]), within={"T_s": (1.0, 2.0)})
        assert with_ranges(scenario, wider).run(THETA).kpis["largest"] == 9.0


def test_built_in_scenarios_and_rigs_stay_where_they_are():
    with isolation("cstr") as isolated:
        cstr = load("cstr")
        assert isolated(cstr) is cstr
    with isolation(f"{WILD}:plant", early=False) as isolated:
        assert isinstance(isolated(load(f"{WILD}:plant")).run, Isolated)


@pytest.mark.parametrize("limit", [0.0, -1.0, float("nan")])
def test_an_impossible_limit_is_refused(limit):
    with pytest.raises(SettingsError, match="--run-timeout"), isolation("cstr", limit):
        pass


def test_a_process_of_its_own_starts_only_when_the_record_of_its_plant_was_identified(tmp_path, monkeypatch):
    path = tmp_path / "step.csv"
    path.write_text(table())
    kept, started = path.with_suffix(KEPT_PLANT), list[bool]()
    monkeypatch.setattr(Worker, "start", lambda worker: started.append(kept.is_file()))
    source = f'pid {{"plant": "{path.as_posix()}"}}'
    with isolation(source) as isolated:
        assert not started
        isolated(load(source))
    assert started == [True]
