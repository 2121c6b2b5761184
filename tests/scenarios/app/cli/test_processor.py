"""The command line's processors: made, judged by, and kept in the study."""

import json

import pytest

from prefcal_env.envs.overtake import OvertakeOptions
from prefcal_env.mpc import Processor, read_processor, write_processor
from prefcal_env.study import StudyFile
from prefcal_scenarios.cases.overtake import measuring, overtake, overtake_on, overtake_variants
from prefcal_scenarios.cases.overtake.computation_time import SERVER_CORE
from support.interviews import clock
from support.studies import state_of

PAPER = overtake.references["paper, preferences"]
SLOW = SERVER_CORE.slower(500.0, "slow target")
SHORT = [
    "calibrate",
    "overtake",
    "--calibrator",
    "synthetic",
    "--agent",
    "glisp",
    "--n-init",
    "2",
    "--n-max",
    "3",
]


@pytest.fixture
def slow(tmp_path):
    return write_processor(SLOW, tmp_path / "slow.json")


def configuration(path):
    return state_of(path).configuration


def test_a_scenario_is_judged_on_the_processor_by_kpis_and_calibrator():
    judged = overtake_on(SLOW)
    run = judged.run(PAPER)
    assert run.kpis["t_comp_ratio"] > 1 > overtake.run(PAPER).kpis["t_comp_ratio"]
    (criterion,) = judged.calibrators["synthetic"](0).first
    assert criterion.key(run) == pytest.approx(run.kpis["t_comp_ratio"] - 1)


def test_the_worst_of_several_runs_is_judged_on_it_too():
    robust = overtake_variants({"nominal": OvertakeOptions(), "again": OvertakeOptions()})
    slower, faster = (robust.on_processor(robust, p) for p in (SLOW, SERVER_CORE))
    assert slower.run(PAPER).kpis["t_comp_ratio"] > 1
    assert faster.run(PAPER).kpis["t_comp_ratio"] < 0.1
    assert faster.name == "overtake-robust"


def test_another_road_is_judged_on_it_too():
    elsewhere = overtake.configured({"steering_limit": "per step"})
    judged = elsewhere.on_processor(elsewhere, SLOW).run(PAPER)
    assert judged.kpis["t_comp_ratio"] > 1
    assert judged.kpis["path_peak"] == elsewhere.run(PAPER).kpis["path_peak"]


def test_a_study_keeps_its_processor_and_resumes_without_the_file(prefcal, slow, tmp_path):
    study = str(tmp_path / "mine.prefcal")
    code, _, err = prefcal(*SHORT, "--processor", str(slow), "--study", study)
    assert code == 0, err
    assert configuration(study)["processor"]["name"] == "slow target"
    page = (tmp_path / "prefcal-mine" / "report.html").read_text("utf-8")
    assert "slow target" in page
    assert f"--processor {slow}" in page
    slow.unlink()
    again = ["calibrate", "overtake", "--study", study, "--n-max", "4"]
    code, _, err = prefcal(*again)
    assert code == 0, err
    with StudyFile.open(study, clock=clock()) as file:
        newest = file.experiment(3)
    assert newest.kpis["t_comp_worst"] == pytest.approx(
        overtake_on(SLOW).run(newest.theta).kpis["t_comp_worst"]
    )
    assert prefcal("report", study, "--out", "later")[0] == 0


def test_another_processor_on_resuming_is_refused_and_the_same_one_is_not(prefcal, slow, tmp_path):
    study = str(tmp_path / "mine.prefcal")
    assert prefcal(*SHORT, "--processor", str(slow), "--study", study)[0] == 0
    copy = write_processor(SLOW, tmp_path / "copy.json")
    assert prefcal(*SHORT, "--processor", str(copy), "--study", study)[0] == 0
    other = write_processor(SERVER_CORE, tmp_path / "other.json")
    code, _, err = prefcal(*SHORT, "--processor", str(other), "--study", study)
    assert code == 2
    assert "'slow target', which it keeps" in err


def test_a_study_without_one_takes_none_later(prefcal, slow, tmp_path):
    study = str(tmp_path / "mine.prefcal")
    assert prefcal(*SHORT, "--study", study)[0] == 0
    code, _, err = prefcal(*SHORT, "--processor", str(slow), "--study", study)
    assert code == 2
    assert "started with no --processor" in err


def test_bad_files_and_scenarios_that_do_not_compute_are_refused(prefcal, slow, tmp_path):
    study = str(tmp_path / "mine.prefcal")
    for words, message in (
        ([*SHORT, "--processor", "none.json"], "cannot read none.json"),
        (["calibrate", "cstr", "--calibrator", "synthetic", "--processor", str(slow)],
         "--processor is for scenarios that judge computation times"),
        ([*SHORT[:2], "--calibrator", "fast-processor", "--processor", str(slow)],
         "--calibrator must be one of human, synthetic"),
    ):  # fmt: skip
        code, _, err = prefcal(*words, "--study", study)
        assert code == 2
        assert message in " ".join(err.split())
        assert not (tmp_path / "mine.prefcal").exists()


def test_cycle_counts_become_a_file_that_a_calibration_takes(prefcal, tmp_path):
    rows = [
        f"{phase},{N_p},{N_u},{n},{40_000 * N_p + 9_000 * n * N_u}"
        for phase in ("lane keeping", "overtaking")
        for N_p, N_u in ((10, 2), (16, 5), (30, 20))
        for n in (5, 9)
    ]
    (tmp_path / "cycles.csv").write_text("\n".join(["phase,N_p,N_u,iterations,cycles", *rows]))
    code, out, err = prefcal(
        "processor", "from-cycles", "cycles.csv", "--clock-mhz", "300", "--out", "target.json"
    )
    assert code == 0, err
    assert "Processor 'target' from 12 steps" in out
    assert "The paper's θ takes" in out
    assert read_processor("target.json").name == "target"
    assert prefcal(*SHORT, "--processor", "target.json")[0] == 0


def test_measuring_writes_a_file_with_the_name_asked_for(prefcal, monkeypatch, tmp_path):
    monkeypatch.setattr(measuring, "TIMED", measuring.TIMED[-4:])
    code, out, err = prefcal("processor", "measure", "--rounds", "1", "--name", "this desk")
    assert code == 0, err
    found = json.loads((tmp_path / "processor.json").read_text())
    assert found["name"] == "this desk"
    assert isinstance(read_processor(tmp_path / "processor.json"), Processor)
    assert "timing the controller" in err
    assert "90 % of the steps took" in out


def test_errors_of_cycle_files_are_one_line(prefcal, tmp_path):
    (tmp_path / "cycles.csv").write_text("phase,N_p\n")
    code, _, err = prefcal("processor", "from-cycles", "cycles.csv", "--clock-mhz", "300")
    assert code == 2
    assert "missing: iterations, cycles, N_u (or ε_c)" in err
