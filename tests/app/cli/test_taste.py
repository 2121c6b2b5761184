"""`prefcal calibrate --taste`: a study starts from what its person said in an earlier one."""

import json

import pytest

from prefcal_agents import restore
from prefcal_agents.agent import AgentState
from prefcal_env.study import study_path
from support import unseen as unseen_module
from support.studies import state_of

UNSEEN = f"{unseen_module.__file__}:unseen"
UNATTENDED = ["--calibrator", "synthetic", "--simulate", "60", "--json"]
OTHER = f"""
from dataclasses import replace
from prefcal_scenarios.catalog import load
old = load({UNSEEN!r})
quick = replace(old, name="quick", kpis=old.kpis[:1])
heavy = replace(old, name="heavy", kpis=tuple(replace(kpi, unit="kg") for kpi in old.kpis))
"""


def settings_of(name):
    return state_of(name).configuration["agent"]["settings"]


@pytest.fixture
def mine(done):
    """The earlier study."""
    done("calibrate", UNSEEN, *UNATTENDED, "--n-max", "8", "--study", "mine")


def test_a_study_begins_with_the_taste_of_another_one_and_needs_its_file_no_more(done, mine, tmp_path):
    line = ["calibrate", UNSEEN, *UNATTENDED, "--taste", "mine", "--seed", "3", "--out", "hers"]
    done(*line, "--n-max", "4", "--study", "hers")
    kept = settings_of("hers")["taste"]
    assert [answer for answer, *_ in kept] == [
        int(c.answer.preference) for c in state_of("mine").history.lessons
    ]
    assert set(dict(kept[0][1])) == {"slow", "rough"}
    best = json.loads((tmp_path / "hers" / "best.json").read_text())
    assert best["study"]["begins with the taste of"] == "mine"
    report = (tmp_path / "hers" / "report.html").read_text("utf-8")
    assert "begins with the taste of" in report
    assert "Screening taste" not in report + str(best)  # numbers that nobody reads
    study_path("mine").unlink()
    out = done(*line, "--n-max", "5", "--study", "hers")
    assert json.loads(out)["experiments"] == 5


def test_only_kpis_of_the_same_name_travel(done, mine, tmp_path):
    (tmp_path / "other.py").write_text(OTHER)
    done(
        "calibrate",
        "other.py:quick",
        *UNATTENDED,
        "--cost",
        f"{UNSEEN.rpartition(':')[0]}:cost",
        "--taste",
        "mine",
        "--n-max",
        "3",
        "--study",
        "hers",
    )
    assert {name for _, first, _ in settings_of("hers")["taste"] for name, _ in first} == {"slow"}
    state = AgentState.of(state_of("hers").configuration["agent"], state_of("hers").history)
    assert restore(unseen_module.SPACE, state).state.configuration() == state.configuration()


@pytest.mark.parametrize(
    ("scenario", "more", "said"),
    [
        (UNSEEN, ["--taste", "nobody"], "there is no study 'nobody'"),
        (
            "other.py:heavy",
            ["--taste", "mine"],
            "--taste mine: none of its answers is about a KPI of scenario",
        ),
        (
            UNSEEN,
            ["--taste", "mine", "--agent", "glisp", "--simulate", "0"],
            "only the agent screening takes",
        ),
    ],
)
def test_a_taste_that_does_not_fit_is_refused_before_anything_runs(
    refused, mine, tmp_path, scenario, more, said
):
    (tmp_path / "other.py").write_text(OTHER)
    words = [word for word in UNATTENDED if word not in ("--simulate", "60")]
    assert said in refused("calibrate", scenario, *words, *more, "--study", "hers")
