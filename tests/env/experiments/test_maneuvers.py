"""Several maneuvers of one θ as one experiment."""

from dataclasses import replace

import numpy as np
import pytest

from prefcal_env import Maneuvers
from prefcal_env.errors import ExperimentError
from prefcal_env.experiments.experiment import End
from prefcal_env.experiments.panels import by_maneuver, combined
from prefcal_env.study.fold import decode, encode
from support.short_runs import short_run


def run(name, error=0.0, theta=1.0, **changes):
    return replace(short_run([theta], kpis={"error": error}, **changes), maneuver=name)


def test_a_kpi_is_the_worst_of_all_maneuvers_beside_the_mean_and_each_of_them():
    made = combined([run("step", 1.0), run("load", 4.0)])
    assert dict(made.kpis) == {"error": 4.0, "error (mean)": 2.5, "error (step)": 1.0, "error (load)": 4.0}
    assert made.maneuver == ""
    assert list(by_maneuver(made)) == ["step", "load"]


def test_the_worst_follows_the_direction_or_the_target_of_a_kpi():
    runs = [run("step", 1.0), run("load", 4.0), run("warm", 2.0)]
    assert combined(runs, higher_is_better=["error"]).kpis["error"] == 1.0
    assert combined(runs, targets={"error": 3.5}).kpis["error"] == 1.0
    assert np.isnan(combined([*runs, run("cold", np.nan)]).kpis["error"])


def test_a_kpi_that_an_interrupted_maneuver_lacks_is_unknown():
    stopped = replace(run("load", end=End.UNSAFE), kpis={})
    made = combined([run("step", 1.0), stopped])
    assert dict(made.kpis) == {"error (step)": 1.0}
    assert made.end is End.UNSAFE


def test_interrupted_maneuvers_may_all_lack_a_kpi_that_should_be_high_or_near_a_target():
    runs = [run(name, 1.0, end=End.UNSAFE) for name in ("step", "load")]
    made = combined(runs, higher_is_better=["yield"], targets={"mean level": 2.0})
    assert made.end is End.UNSAFE
    assert set(made.kpis) == {"error", "error (mean)", "error (step)", "error (load)"}


def test_a_kpi_of_one_maneuver_alone_has_no_mean():
    other = replace(run("load"), kpis={"recovery": 3.0})
    assert set(combined([run("step", 1.0), other]).kpis) == {
        "error",
        "recovery",
        "error (step)",
        "recovery (load)",
    }


def test_maneuvers_come_back_from_a_study_file():
    made = combined([run("step", 1.0), run("load", 4.0)])
    back = decode(encode(made))
    assert back == made
    assert [part.maneuver for part in back.runs] == ["step", "load"]
    assert b"maneuver" not in encode(short_run([1.0]))  # as files were before maneuvers


@pytest.mark.parametrize(
    ("runs", "words"),
    [
        ([], "one or more maneuvers"),
        ([run("step"), run("step")], "two maneuvers are called 'step'"),
        ([run("")], "needs a name of its own"),
        ([run("mean")], "other than 'mean'"),
        ([run("step"), run("load", theta=2.0)], "same θ"),
        ([replace(run("step"), runs=(run("a"),))], "single run"),
    ],
)
def test_what_cannot_be_combined_is_refused(runs, words):
    with pytest.raises(ExperimentError, match=words):
        combined(runs)


def test_one_run_performs_all_maneuvers_with_the_same_seed():
    seeds = []

    def step(theta, seed=0):
        seeds.append(seed)
        return short_run(theta, kpis={"error": 1.0})

    made = Maneuvers({"step": step, "load": step})(np.array([1.0]), seed=7)
    assert seeds == [7, 7]
    assert [part.maneuver for part in made.runs] == ["step", "load"]


@pytest.mark.parametrize(
    ("runs", "words"),
    [({}, "must map names to runs"), ({"step": 3}, "must be a function"), ({"": run}, "name")],
)
def test_what_is_no_maneuver_is_refused(runs, words):
    with pytest.raises(ExperimentError, match=words):
        Maneuvers(runs)


def test_a_run_that_returns_nothing_is_named():
    with pytest.raises(ExperimentError, match="maneuver 'step' must return an Experiment"):
        Maneuvers({"step": lambda theta, seed=0: None})(np.array([1.0]))
