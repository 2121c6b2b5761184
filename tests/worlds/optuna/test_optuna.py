"""Trials of an Optuna study, read from its storage."""

import sys

import pytest

from prefcal_app.session import actions
from prefcal_scenarios.catalog import load

URL = "sqlite:///tuning.db"


@pytest.fixture
def made(tmp_path, monkeypatch):
    """An Optuna study of two values, one trial of which fails; gives the study."""
    optuna = pytest.importorskip("optuna", reason="needs Optuna: pip install 'prefcal[optuna]'")
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    monkeypatch.chdir(tmp_path)
    sampler = optuna.samplers.RandomSampler(seed=1)
    ways = ["minimize", "maximize"]
    study = optuna.create_study(storage=URL, study_name="tune", directions=ways, sampler=sampler)

    def objective(trial):
        x = trial.suggest_float("x", 0.0, 1.0)
        trial.set_user_attr("size", 2 * x)
        if trial.number == 3:
            raise RuntimeError("no result")
        return (x - 0.3) ** 2, x

    study.optimize(objective, 12, catch=(RuntimeError,))
    study.ask()  # one more runs
    return study, objective


def test_trials_are_candidates_and_directions_are_known(made):
    scenario = load(URL)
    numbers = scenario.source.candidates[:, 0].tolist()
    assert numbers == [k for k in range(12) if k != 3]
    assert "Lower is better: values_0. Higher is better: values_1." in scenario.brief
    assert "Only shown: x. Left out: trial 3, which did not complete." in scenario.brief


def test_a_study_goes_on_with_the_trials_that_it_began_with(made, done, monkeypatch):
    monkeypatch.setattr("prefcal_app.report.write.draw", lambda record, extra: ())
    monkeypatch.setattr("prefcal_app.cli.calibrate.converse", lambda interview, console: answered(interview))
    words = ["choose", URL, "--study", "mine", "--terminal"]
    done(*words)
    study, objective = made
    study.optimize(objective, 5)
    done(*words)  # an exit code other than 0 fails


def answered(interview):
    from prefcal_app.session import Choice
    from support.interviews import until

    for _ in range(2):
        interview.do(actions.Answer(until(interview, lambda now: now.question).question.id, Choice.LEFT))


def test_what_is_missing_is_said(made, refused):
    assert "there is no file 'none.db'" in refused("choose", "sqlite:///none.db")
    assert "holds the studies tune: name one with --of, got 'tuna'. Did you mean 'tune'?" in refused(
        "choose", URL, "--of", "tuna"
    )


def test_without_optuna_it_is_said_what_to_install(refused, monkeypatch):
    monkeypatch.setitem(sys.modules, "optuna", None)
    assert "pip install 'prefcal[optuna]'" in refused("choose", URL)
