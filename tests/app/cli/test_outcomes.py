"""KPIs on the command line: switched off, and taken along as a cost."""

import json
import shlex
from pathlib import Path

from prefcal_app.cli.options import Options
from support.studies import state_of
from toy_study import TOY

SYNTHETIC = ["--calibrator", "synthetic"]
SHORT = [*SYNTHETIC, "--n-init", "4", "--n-max", "7"]


def thetas(done, *words):
    """All θ of a study of the toy."""
    done("calibrate", TOY, *SHORT, *words)
    name = words[words.index("--study") + 1]
    return thetas_of(name)


def thetas_of(study):
    return [sample.theta for sample in state_of(study).history.samples]


def test_without_outcomes_the_agent_learns_from_theta_alone_and_the_line_that_repeats_it_says_so(
    done, tmp_path
):
    on = thetas(done, "--study", str(tmp_path / "on.prefcal"))
    off = thetas(done, "--study", str(tmp_path / "off.prefcal"), "--no-outcomes", "--out", "off")
    assert on[:4] == off[:4]
    configuration = state_of(tmp_path / "off.prefcal").configuration
    assert configuration["options"]["outcomes"] is False
    assert configuration["agent"]["settings"]["kpis"] is False
    assert state_of(tmp_path / "on.prefcal").configuration["options"]["outcomes"] is True
    line = Options.of(
        {"scenario": TOY, "calibrator": "synthetic", "n_init": 4, "n_max": 7, "outcomes": False}
    ).command()
    assert line.endswith("--no-outcomes")
    assert line in (tmp_path / "off" / "report.html").read_text("utf-8")
    again = str(tmp_path / "again.prefcal")
    done(*shlex.split(line)[1:], "--study", again)
    assert thetas_of(again) == off


def test_a_study_never_chooses_which_cost_is_run(prefcal, refused, tmp_path):
    (tmp_path / "mine.py").write_text("cost = lambda e: e.theta[0]\n")
    (tmp_path / "moved.py").write_text("cost = lambda e: e.theta[0]\n")
    words = ["--agent", "glis", "--cost", "mine.py:cost", "--n-max", "4", "--study", "mine"]
    assert prefcal("calibrate", TOY, *words, "--out", "there")[0] == 0
    line = f"prefcal calibrate {TOY} --calibrator score --agent glis"
    page = (tmp_path / "there" / "report.html").read_text("utf-8")
    assert f"{line} --seed 0 --n-init 2 --n-max 4 --cost mine.py:cost" in page
    assert "--cost mine.py:cost" in refused("calibrate", TOY, "--study", "mine", "--n-max", "5")
    assert "--cost mine.py:cost" in refused("report", "mine", "--scenario", TOY)
    assert prefcal("report", "mine", "--scenario", TOY, "--cost", "moved.py:cost")[0] == 0


def test_a_study_keeps_a_kpi_as_its_cost(done, refused):
    words = ["--agent", "glis", "--cost", "t_f", "--n-max", "4", "--study", "mine"]
    out = done("calibrate", TOY, *words, "--json")
    result = json.loads(out)
    cost = result["cost"]
    assert cost is not None
    assert (result["questions"], result["agent"], result["calibrator"]) == (0, "glis", "score")
    page = Path(result["report"]).read_text("utf-8")
    assert "without comparisons: 4 experiments" in page
    out = done("report", "mine", "--scenario", TOY, "--json")
    assert json.loads(out)["cost"] == cost  # the KPI, not the scenario's own score
    out = done("calibrate", TOY, "--study", "mine", "--n-max", "5", "--json")
    assert json.loads(out)["experiments"] == 5
    assert json.loads(out)["cost"] <= cost
    assert "t_f" in refused("calibrate", TOY, "--study", "mine", "--cost", "final", "--n-max", "6")
