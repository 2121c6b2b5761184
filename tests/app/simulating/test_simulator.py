"""Simulations for an agent: the same with any workers, failures counted, and given up at once."""

import threading
from itertools import count
from types import SimpleNamespace

import numpy as np
import pytest

from prefcal_app.simulating import Abandoned, SimulationCounts, Simulator
from prefcal_app.simulating.simulator import RunTimes
from prefcal_scenarios.catalog import load
from prefcal_scenarios.isolated import isolation
from support import unseen as unseen_module
from support.processes import wait_until
from support.unseen import unseen

SOURCE = f"{unseen_module.__file__}:unseen"
CART = """
import numpy as np
from prefcal_env import Knob, KnobSpace, recorded
from prefcal_scenarios import KPI, Scenario

def run(theta, seed=0, mass=1.0):
    t = np.linspace(0, 1, 11)
    late = float(mass * theta[0])
    return recorded(theta, t, {"position": t}).with_kpis({"late": np.inf if late > 2.1 else late})

cart = Scenario("cart", "A cart", KnobSpace([Knob("gain", 0, 5)]), run, simulated=True,
                kpis=(KPI("late", "delay", better="lower"),))
"""
THETAS = list(np.random.default_rng(0).random((30, 2)))


@pytest.fixture(scope="module")
def alone():
    """The KPIs of all θ, simulated in this process."""
    return Simulator(unseen, jobs=0).many(THETAS)


@pytest.mark.parametrize("jobs", [1, 2])
def test_any_number_of_workers_gives_the_same(alone, jobs):
    with Simulator(unseen, jobs=jobs) as simulator:
        assert simulator.many(THETAS) == alone
        assert simulator(THETAS[3]) == alone[3]


def test_an_own_scenario_loads_its_file_in_each_worker(alone):
    with isolation(SOURCE, early=False) as isolated:
        scenario = isolated(load(SOURCE))
        with Simulator(scenario, jobs=2) as simulator:
            assert simulator.many(THETAS) == alone


def test_failures_are_counted_and_not_repeated(monkeypatch):
    monkeypatch.setenv("PREFCAL_TEST_CRASH", "1")
    thetas = [np.array([0.5, 0.5]), np.array([0.99, 0.5]), np.array([0.01, 0.5])]
    with isolation(SOURCE, early=False) as isolated, Simulator(isolated(load(SOURCE)), jobs=1) as simulator:
        works, raises, crashes = simulator.many(thetas)
        assert works
        assert not raises
        assert not crashes
        assert (simulator.count, simulator.failed) == (3, 2)
        where, why = simulator.failure.split(": ", 1)
        assert where == "gain 0.01 · delay 0.5 s"
        assert why
        monkeypatch.setattr(simulator, "_in", None)  # it may run nothing again
        assert simulator.many(thetas) == [works, raises, crashes]


@pytest.mark.parametrize("jobs", [0, 1])
def test_a_batch_is_given_up_at_once_and_keeps_what_it_knows(monkeypatch, jobs):
    monkeypatch.setenv("PREFCAL_TEST_SECONDS", "0.05")
    raised = []

    def simulate():
        try:
            simulator.many(list(np.random.default_rng(1).random((1000, 2))))
        except Abandoned as error:
            raised.append(error)

    with Simulator(unseen, jobs=jobs) as simulator:
        thread = threading.Thread(target=simulate)
        thread.start()
        wait_until(lambda: simulator.count > 2)
        simulator.abandon()
        thread.join(2.0)
        assert not thread.is_alive()
        assert raised
        known = simulator.count
        with pytest.raises(Abandoned):
            simulator.many(THETAS)
        simulator.resume()
        assert simulator(THETAS[0])
        assert simulator.count > known


def test_progress_is_told_while_it_simulates(monkeypatch):
    monkeypatch.setattr("prefcal_app.simulating.simulator._TELL", 0.0)
    counts = []
    simulator = Simulator(unseen, jobs=0)
    simulator.tell = lambda: counts.append(simulator.count)
    simulator.many(THETAS)
    assert counts == list(range(len(THETAS)))


def test_perturbed_runs_are_the_same_with_any_workers_and_are_no_candidates():
    scenario = load("lag")
    thetas = list(scenario.space.decode_all(np.random.default_rng(1).random((4, len(scenario.space)))))
    alone = Simulator(scenario, seed=2, jobs=0, robust=True)
    with Simulator(scenario, seed=2, jobs=2, robust=True) as simulator:
        assert np.array_equal(simulator.holds(thetas, range(1, 9)), alone.holds(thetas, range(1, 9)))
        assert simulator.count == alone.count == 4
    assert Simulator(scenario, jobs=0).holds is None


def test_a_robust_study_says_how_long_a_question_takes_once_runs_are_measured(monkeypatch):
    ticks = count(step=0.1)  # s: two looks at the clock for each run
    monkeypatch.setattr("prefcal_app.simulating.simulator.time", SimpleNamespace(monotonic=ticks.__next__))
    monkeypatch.setattr("prefcal_app.simulating.simulator._TELL", 0.0)
    scenario = load("lag")
    thetas = list(scenario.space.decode_all(np.random.default_rng(1).random((25, len(scenario.space)))))
    robust, usual = (Simulator(scenario, jobs=0, robust=one) for one in (True, False))
    robust.many(thetas)
    usual.many(thetas)
    assert robust.seconds == usual.seconds == 0.0  # of the varied runs nothing is known yet
    robust.holds(thetas[:1], range(1, 11))
    assert robust.seconds == 0.0  # too few
    robust.holds(thetas[:1], range(11, 33))
    assert robust.seconds == pytest.approx(300 * 0.2, rel=0.1)


def test_how_far_varied_runs_are_is_told_of_what_a_tuning_alone_or_several_together_need(monkeypatch):
    monkeypatch.setattr("prefcal_app.simulating.simulator._TELL", 0.0)
    scenario, told = load("lag"), list[tuple[int, int]]()
    thetas = list(scenario.space.decode_all(np.random.default_rng(1).random((2, len(scenario.space)))))
    simulator = Simulator(scenario, jobs=0, robust=True)
    simulator.many(thetas)
    assert simulator.varied == (0, 0)
    simulator.tell = lambda: told.append(simulator.varied)
    for runs in (range(1, 3), range(3, 5)):
        simulator.holds(thetas[:1], runs)
    assert told == [(0, 300), (1, 300), (2, 300), (3, 300)]  # it goes on to the last one while it holds
    told.clear()
    simulator.holds(thetas, range(5, 7))
    assert told == [(8, 12), (9, 12), (10, 12), (11, 12)]
    assert simulator.varied == (0, 0)


def test_a_pause_between_batches_is_no_pace():
    pace = RunTimes()
    for start in (0.0, 1000.0):
        pace.begin()
        for k in range(11):
            pace.arrived(1, start + 0.5 * k)
    assert pace.seconds == pytest.approx(0.5)


def test_a_machine_that_becomes_busier_is_followed():
    pace, now = RunTimes(), 0.0
    for seconds in (0.1, 0.5):
        for _ in range(1500):
            now += seconds
            pace.arrived(1, now)
    assert pace.seconds == pytest.approx(0.5, rel=0.1)


@pytest.mark.parametrize(
    ("seconds", "about"), [(2.9, None), (3.4, "3 s"), (23.0, "25 s"), (118.0, "2 min"), (0.0, None)]
)
def test_what_hardly_takes_time_is_not_said(seconds, about):
    said = (
        f"A question takes about {about} if the first tuning that is tried on 300 plants holds there, and "
        "can take several times as long if not."
    )
    assert SimulationCounts(0, 1000, 0, 0, seconds=seconds).pace == (said if about else "")


def test_an_own_file_is_perturbed_in_its_workers_and_here(tmp_path):
    file = tmp_path / "cart.py"
    file.write_text(CART)
    with isolation(f"{file}:cart", early=False) as isolated:
        scenario, theta = isolated(load(f"{file}:cart")), np.array([2.0])
        alone = Simulator(scenario, jobs=0, robust=True).holds([theta], range(1, 21))
        with Simulator(scenario, jobs=1, robust=True) as simulator:
            assert np.array_equal(simulator.holds([theta], range(1, 21)), alone)
    assert 0 < alone.sum() < 20
