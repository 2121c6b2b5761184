"""`prefcal studies respace`: other knobs in a running study."""

import json
from dataclasses import replace

import numpy as np
import pytest

from prefcal_app.cli.studies.commands import RespaceOptions
from prefcal_app.cli.studies.files import respace
from prefcal_app.session import Choice, Interview, Phase, actions
from prefcal_env.errors import StudyError
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.study import StudyFile, export_csv, export_json, import_json, study_path, verify
from support.calibrated import calibrated, copied
from support.interviews import begin, proceed, reopened
from support.studies import state_of
from toy_study import TOY, toy_scenario

SYNTHETIC = ["--calibrator", "synthetic", "--n-init", "3"]
# The toy as its author has it later: one knob more, which the run does not know.
GROWN = f"""
from dataclasses import replace
from prefcal_scenarios.catalog import load
from prefcal_env.knobs import Knob, KnobSpace
old = load({TOY!r})
def run(theta, seed=0):
    return replace(old.run(theta[:3], seed=seed), theta=theta)
toy = replace(old, run=run, space=KnobSpace([*old.space, Knob("filter", 1.0, 5.0, "s")]),
              references={{}})
"""


@pytest.fixture(scope="module", params=["glisp", "random"])
def made(request, tmp_path_factory):
    line = f"--agent {request.param} --n-max 5 --study mine --start T_s=1.2,N_p=10,gain=2"
    return calibrated(tmp_path_factory.mktemp("made"), TOY, *SYNTHETIC, *line.split())


@pytest.fixture
def study(made, tmp_path):
    copied(made, tmp_path)
    return "mine"


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    words = [TOY, *SYNTHETIC, "--agent", "random", "--n-max", "3", "--study", "mine"]
    return calibrated(tmp_path_factory.mktemp("short"), *words)


def thetas(name="mine"):
    return np.array([s.theta for s in state_of(name).history.samples])


def test_a_narrowed_and_frozen_study_goes_on(prefcal, done, study, tmp_path):
    before = thetas()
    line = f"studies respace {study} --scenario {TOY} --knob T_s=0.25:0.75 --freeze N_p=26"
    out = done(*line.split())
    assert out.splitlines()[:2] == ["T_s: 0.25 to 0.75 h", "N_p: 26, frozen"]
    out = done("calibrate", TOY, "--study", study, "--n-max", "9", "--json")
    after = thetas()
    assert after[:5].tolist() == before.tolist()
    assert np.all(after[5:, 0] <= 0.75)
    assert set(after[5:, 1]) == {26.0}
    assert json.loads(out)["experiments"] == 9
    assert verify(study_path(study)) == ()
    copy = tmp_path / "copy.prefcal"
    with StudyFile.open(study_path(study), clock=lambda: "now") as file:
        import_json(export_json(file), copy)
    assert thetas(copy).tolist() == after.tolist()


def test_the_scenario_has_got_a_knob(done, refused, study, tmp_path):
    before = thetas()
    (tmp_path / "grown.py").write_text(GROWN)
    grown = f"{tmp_path / 'grown.py'}:toy"
    assert "studies respace" in refused("calibrate", grown, "--study", study, "--n-max", "8")
    assert "added knobs ['filter']" in refused("studies", "respace", study, "--scenario", grown)
    done("studies", "respace", study, "--scenario", grown, "--add", "filter=0.5")
    out = done("calibrate", grown, "--study", study, "--n-max", "8", "--json")
    after = thetas()
    assert after[:5, :3].tolist() == before.tolist()
    assert set(after[:5, 3]) == {0.5}
    assert np.all(after[5:, 3] >= 1.0)
    assert list(json.loads(out)["best"]) == ["T_s", "N_p", "gain", "filter"]
    with StudyFile.open(study_path(study), clock=lambda: "now") as file:
        rows = (export_csv(file, tmp_path / "csv") / "experiments.csv").read_text().splitlines()
    assert len({row.count(",") for row in rows}) == 1


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "nothing changes"),
        (["--knob", "T_s=1"], "expected KNOB=LOW:HIGH"),
        (["--knob", "T_s=a:1"], "expected a number, got 'a'"),
        (["--knob", "speed=0:1"], "knob must be one of"),
        (["--knob", "T_s=1:0.5"], "knob 'T_s'"),
        (["--freeze", "N_p"], "expected KNOB=VALUE"),
        (["--freeze", "N_p=5.5"], "expected integers"),
        (["--freeze", "gain=0"], "log10 scale needs low above 0"),
        (["--add", "gain=1"], "added knobs [], got ['gain']"),
    ],
)
def test_what_cannot_be_is_refused_and_leaves_the_study_alone(refused, short, tmp_path, words, said):
    copied(short, tmp_path)
    before = study_path("mine").read_bytes()
    assert said in refused("studies", "respace", "mine", "--scenario", TOY, *words)
    assert study_path("mine").read_bytes() == before


def test_an_open_question_stays_open(prefcal, tmp_path):
    path = tmp_path / "mine.prefcal"
    interview = begin(toy_scenario(), n_max=6, path=path)
    asked = proceed(interview).question
    interview.do(actions.Answer(asked.id, Choice.LEFT))
    asked = proceed(interview).question
    theta = asked.challenger.experiment.theta
    interview.file.close()
    respace(RespaceOptions(str(path), knob=("T_s=0.3:0.4",)), TOY)
    again = reopened(toy_scenario(), path)
    now = again.now()
    assert (now.phase, now.question.id) == (Phase.QUESTION, asked.id)
    assert now.question.challenger.experiment.theta.tolist() == theta.tolist()
    again.do(actions.Answer(now.question.id, Choice.LEFT))
    now = proceed(again)
    assert 0.3 <= now.question.challenger.experiment.theta[0] <= 0.4


def test_a_scenario_that_changed_again_is_refused(prefcal, study):
    prefcal("studies", "respace", study, "--scenario", TOY, "--freeze", "N_p=26")
    toy = toy_scenario()
    other = replace(toy, space=KnobSpace([*toy.space.knobs[:2], Knob("gain", 0.01, 200.0, "m/%", "log10")]))
    with (
        StudyFile.open(study_path(study), clock=lambda: "now") as file,
        pytest.raises(StudyError, match="gain"),
    ):
        Interview(other, file, asks=False)
