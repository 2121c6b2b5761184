"""`prefcal calibrate --from`: the best of an earlier study among the first experiments."""

import json

import pytest

from prefcal_env.study import StudyFile, study_path
from prefcal_scenarios.presentation.wording import earlier_text
from support.studies import state_of
from toy_study import TOY

SYNTHETIC = ["--calibrator", "synthetic", "--agent", "random", "--n-init", "2"]
OTHER = f"""
from dataclasses import replace
from prefcal_scenarios.catalog import load
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.knobs.constraints import LinearConstraint
old = load({TOY!r})
def run(theta, seed=0):
    return replace(old.run(theta[:3], seed=seed), theta=theta)
grown = replace(old, name="grown", run=run, references={{}},
                space=KnobSpace([*old.space, Knob("filter", 1.0, 5.0, "s")]))
seconds = replace(old, name="seconds", references={{}},
                  space=KnobSpace([Knob("T_s", 900, 5400, "s"), *old.space.knobs[1:]]))
refused = replace(old, name="refused", references={{}},
                  space=KnobSpace(old.space.knobs, [LinearConstraint("short", {{"T_s": 1}}, 0.3)]))
"""


@pytest.fixture(autouse=True)
def _other_file(tmp_path):
    (tmp_path / "other.py").write_text(OTHER)


_FILE: list[bytes] = []


@pytest.fixture
def mine(done):
    """θ that won an earlier study called mine, which runs once for all tests."""
    if not _FILE:
        done(
            "calibrate",
            TOY,
            *SYNTHETIC,
            "--n-max",
            "6",
            "--study",
            "mine",
            "--start",
            "T_s=1.2,N_p=10,gain=2",
        )
        _FILE.append(study_path("mine").read_bytes())
    study_path("mine").parent.mkdir(parents=True, exist_ok=True)
    study_path("mine").write_bytes(_FILE[0])
    state = state_of("mine")
    return state.history.samples[state.history.incumbent].theta


def test_the_best_of_the_earlier_study_is_the_first_experiment(prefcal, mine, tmp_path):
    line = ["calibrate", TOY, *SYNTHETIC, "--from", "mine", "--study", "hers"]
    code, _, err = prefcal(*line, "--seed", "5", "--n-max", "4", "--out", "a")
    assert code == 0, err
    state = state_of("hers")
    assert state.history.samples[0].theta == pytest.approx(mine)
    said = "mine (toy): its best θ of 6 experiments"
    assert f"From {said}." in err
    assert state.configuration["earlier"]["thetas"] == [pytest.approx(list(mine))]
    assert earlier_text(state.configuration["earlier"]) == said
    assert said in prefcal("studies", "show", "hers")[1]
    shown = json.loads(prefcal("studies", "show", "hers", "--json")[1])
    assert shown["earlier"]["study"] == "mine"
    page = (tmp_path / "a" / "report.html").read_text()
    assert said in page
    assert "--from mine" in page


def test_it_goes_on_without_the_earlier_study(prefcal, done, refused, mine):
    line = ["calibrate", TOY, *SYNTHETIC, "--from", "mine"]
    whole = prefcal(*line, "--n-max", "7", "--study", "whole", "--json")[1]
    done(*line, "--n-max", "3", "--study", "hers")
    study_path("mine").unlink()
    out = done(*line, "--n-max", "7", "--study", "hers", "--json")
    assert json.loads(out)["best"] == json.loads(whole)["best"]
    assert "started with --from mine, got --from theirs" in refused(
        "calibrate", TOY, "--study", "hers", "--from", "theirs"
    )


def test_the_present_tuning_comes_first(done, mine):
    done(
        "calibrate",
        TOY,
        *SYNTHETIC,
        "--n-max",
        "4",
        "--study",
        "hers",
        "--from",
        "mine",
        "--start",
        "T_s=0.5,N_p=30,gain=0.1",
    )
    first, second = (state_of("hers").history.samples[i].theta for i in (0, 1))
    assert (first, second) == (pytest.approx((0.5, 30, 0.1)), pytest.approx(mine))


def test_the_best_of_both_runs_once(done, mine):
    present = ",".join(f"{k}={v!r}" for k, v in zip(("T_s", "N_p", "gain"), mine, strict=True))
    done(
        "calibrate", TOY, *SYNTHETIC, "--n-max", "3", "--study", "hers", "--from", "mine", "--start", present
    )
    assert len(state_of("hers").configuration["agent"]["start"]) == 1


def test_a_new_knob_has_the_value_of_the_present_tuning(prefcal, done, mine):
    line = ["calibrate", "other.py:grown", *SYNTHETIC, "--n-max", "4", "--study", "hers", "--from", "mine"]
    code, _, err = prefcal(*line)
    assert code != 0
    assert "no knobs ['filter']" in " ".join(err.split())
    assert "--start" in err
    assert not study_path("hers").exists()
    done(*line, "--start", "T_s=0.5,N_p=30,gain=0.1,filter=2")
    assert state_of("hers").history.samples[1].theta == pytest.approx((*mine, 2.0))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([TOY, "--from", "nobody"], "no study 'nobody'"),
        (["other.py:seconds", "--from", "mine"], "'T_s' was in 'h' in the earlier study"),
        (["other.py:refused", "--from", "mine"], "constraints refuse the best θ"),
        (
            [
                TOY,
                "--from",
                "mine",
                "--n-max",
                "2",
                "--start",
                "T_s=0.5,N_p=30,gain=0.1",
                "--start",
                "T_s=0.5,N_p=31,gain=0.1",
            ],
            "every experiment has its θ",
        ),
    ],
)
def test_what_cannot_be_is_refused_before_anything_runs(refused, mine, words, said):
    assert said in refused("calibrate", *words, *SYNTHETIC, "--study", "hers")
    assert not study_path("hers").exists()


def test_a_study_that_has_not_begun_gives_nothing(refused, mine):
    configuration = dict(state_of("mine").configuration)
    StudyFile.create(study_path("empty"), configuration, clock=lambda: "now").close()
    assert "no answered experiment yet" in refused(
        "calibrate", TOY, *SYNTHETIC, "--from", "empty", "--study", "hers"
    )


@pytest.mark.parametrize("earlier", [3, {}, {"study": 1}, {"study": "a", "thetas": 1}])
def test_a_strange_record_of_it_is_refused(refused, mine, tmp_path, earlier):
    strange = {**state_of("mine").configuration, "earlier": earlier}
    StudyFile.create(study_path("odd"), strange, clock=lambda: "now").close()
    assert "earlier study" in refused("studies", "show", "odd")
