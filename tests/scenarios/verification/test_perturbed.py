"""The perturbed runs of a candidate: shared by all candidates, and counted until one does not hold."""

import numpy as np
import pytest

from prefcal_env.preferences.answer import Reading
from prefcal_scenarios import load
from prefcal_scenarios.scenario import Scenario
from prefcal_scenarios.verification.varied_runs import Perturbed, runs_kept, verify

READING = Reading()


@pytest.fixture(scope="module")
def lag() -> Scenario:
    return load("lag")


def middle(scenario):
    return scenario.space.decode(scenario.space.snap(np.full(len(scenario.space), 0.5)))


def test_without_a_number_a_run_is_that_of_the_scenario(lag):
    theta = middle(lag)
    assert Perturbed(lag, 0).run(theta, seed=4) == lag.run(theta, seed=4)


def test_each_number_is_another_plant_with_other_noise_whatever_ran_before(lag):
    theta, source = middle(lag), Perturbed(lag, 0)
    runs = [source.run(np.append(theta, k)) for k in (1, 2, 1)]
    assert runs[0].kpis == runs[2].kpis != runs[1].kpis
    assert Perturbed(lag, 0).run(np.append(theta, 2)).kpis == runs[1].kpis
    assert Perturbed(lag, 1).run(np.append(theta, 2)).kpis != runs[1].kpis
    assert runs[0].theta.tolist() == [*theta.tolist(), 1.0]


def test_they_are_not_the_runs_of_the_verification_that_follows(lag):
    theta = middle(lag)
    judged = {Perturbed(lag, 0).run(np.append(theta, k)).kpis["error"] for k in range(1, 9)}
    assert judged.isdisjoint(run.kpis["error"] for run in verify(lag, theta, 8, jobs=1).runs)


def counted(bad, *, reading=READING, thetas=(0.0,)):
    """Count runs; `bad` gives KPIs of θ and run (0: nominal), and note which runs were made."""
    made = []

    def many(points):
        made.extend(tuple(point.tolist()) for point in points)
        return [bad(point[0], int(point[1]) if len(point) > 1 else 0) for point in points]

    return runs_kept(many, reading, [np.array([theta]) for theta in thetas], 40), made


def test_runs_are_counted_until_one_does_not_keep_the_limits():
    thetas = (0.5, 1.0, 12.0)
    found, made = counted(lambda theta, run: {"time": np.inf if run == theta else 1.0}, thetas=thetas)
    assert found == [40, 0, 11]
    assert max(run for theta, run in (p for p in made if len(p) > 1) if theta == 1.0) == 2


def test_a_run_that_failed_or_was_unsafe_does_not_keep_the_limits():
    assert counted(lambda theta, run: {} if run == 3 else {"time": 1.0})[0] == [2]
    assert counted(lambda theta, run: {"a": np.inf if run == 5 else 2.0, "b": 1.0})[0] == [4]


def test_what_never_settles_even_nominally_need_not():
    assert counted(lambda theta, run: {"time": np.inf, "other": np.inf if run == 9 else 1.0})[0] == [8]


def test_what_is_unsafe_nominally_does_not_hold():
    assert counted(lambda theta, run: {})[0] == [0]
    assert counted(lambda theta, run: {"time": np.inf, "other": np.inf})[0] == [0]


def test_an_objective_is_a_limit_as_people_read_it():
    reading = Reading({"time": 0.1}, {"time": 1.0})
    assert counted(lambda theta, run: {"time": 0.9 + 0.1 * run}, reading=reading)[0] == [1]
    assert counted(lambda theta, run: {"time": 1.04}, reading=reading)[0] == [40]
    assert counted(lambda theta, run: {"time": 1.2}, reading=reading)[0] == [40]
