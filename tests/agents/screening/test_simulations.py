"""Simulations: each θ once, whatever people's functions return, raise or do to θ."""

import math
import threading
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefcal_agents.screening.bank import Simulations
from prefcal_env.errors import SettingsError, SimulationError
from support.agents import quick

THETAS = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]])


class ManyAtOnce:
    """A simulation that runs all θ of a batch at once, and remembers the batches."""

    def __init__(self, simulate=quick):
        self.simulate, self.batches = simulate, []

    def __call__(self, theta):
        raise AssertionError("many is there")

    def many(self, thetas):
        self.batches.append([tuple(theta) for theta in thetas])
        return (self.simulate(theta) for theta in thetas)


def test_each_theta_is_simulated_once_and_results_come_in_order():
    calls = []

    def simulate(theta):
        calls.append(tuple(theta))
        return {"sum": theta.sum()}

    simulations = Simulations(simulate)
    assert [o["sum"] for o in simulations(THETAS[[0, 1, 0]])] == [3.0, 7.0, 3.0]
    assert [o["sum"] for o in simulations(THETAS[[2, 1]])] == [11.0, 7.0]
    assert calls == [(1.0, 2.0), (3.0, 4.0), (5.0, 6.0)]
    assert (simulations.count, simulations.failed) == (3, 0)


def test_minus_zero_is_the_theta_of_zero():
    simulations = Simulations(quick)
    simulations(np.array([[0.0, 1.0], [-0.0, 1.0]]))
    assert simulations.count == 1


def test_many_gets_only_what_is_new_and_its_results_are_those_of_one_by_one():
    many = ManyAtOnce()
    simulations = Simulations(many)
    simulations(THETAS[:2])
    assert simulations(THETAS) == Simulations(quick)(THETAS)
    assert many.batches == [[(1.0, 2.0), (3.0, 4.0)], [(5.0, 6.0)]]


def test_a_function_that_writes_into_theta_changes_nothing():
    def vandal(theta):
        found = quick(theta)
        theta[:] = np.nan
        return found

    thetas = THETAS.copy()
    for simulate in (vandal, ManyAtOnce(vandal)):
        assert Simulations(simulate)(thetas) == Simulations(quick)(THETAS)
        assert np.array_equal(thetas, THETAS)


@pytest.mark.parametrize("wrong", [None, 3, "cstr", {"a": 1}])
def test_what_is_no_function_is_refused(wrong):
    with pytest.raises(SettingsError, match="simulate must be a function of θ"):
        Simulations(wrong)
    broken = ManyAtOnce()
    broken.many = 3
    with pytest.raises(SettingsError, match="simulate must be a function of θ"):
        Simulations(broken)


@pytest.mark.parametrize(
    "result", [3.5, 0.0, "fast", [("a", 1.0)], np.zeros(2), {"a": "fast"}, {1: 2.0}, {"a": [1.0]}]
)
def test_a_result_that_is_no_kpis_is_refused_with_its_theta(result):
    for simulate in (lambda theta: result, ManyAtOnce(lambda theta: result)):
        with pytest.raises(SimulationError, match=r"(?s)mapping from names of KPIs.*\[1. 2.\]"):
            Simulations(simulate)(THETAS)


def test_a_result_that_is_no_kpis_ends_the_batch_and_what_was_found_is_kept():
    ran = []

    def simulate(theta):
        ran.append(theta[0])
        return 3.5 if theta[0] == 3.0 else quick(theta)

    simulations = Simulations(simulate)
    with pytest.raises(SimulationError, match=r"\[3. 4.\]"):
        simulations(THETAS)
    assert ran == [1.0, 3.0]
    assert simulations(THETAS[:1]) == [quick(THETAS[0])]
    assert ran == [1.0, 3.0]  # nothing ran again


@pytest.mark.parametrize("results", [[], [{"a": 1.0}], [{"a": 1.0}] * 4, None, 3])
def test_a_batch_with_another_number_of_results_is_refused(results):
    simulate = ManyAtOnce()
    simulate.many = lambda thetas: results
    with pytest.raises(SimulationError, match=r"simulate.many must return the KPIs of"):
        Simulations(simulate)(THETAS)


def test_if_all_fail_the_function_is_wrong_and_says_so_each_time_without_running_again():
    calls = []

    def broken(theta):
        calls.append(theta)
        raise KeyError(f"gain {len(calls)}")

    simulations = Simulations(broken)
    for _ in range(2):
        with pytest.raises(SimulationError, match=r"none of 3 θ; the last one: KeyError") as refusal:
            simulations(THETAS)
        assert refusal.value.__cause__.args == ("gain 3",)
    assert len(calls) == 3
    with pytest.raises(SimulationError, match="returned no KPI that is a number"):
        Simulations(lambda theta: {"a": np.nan})(THETAS)


def test_once_a_simulation_has_worked_a_batch_may_fail():
    simulations = Simulations(lambda theta: quick(theta) if theta[0] < 2 else None)
    simulations(THETAS[:1])
    assert simulations(THETAS[1:]) == [{}, {}]


def test_a_stop_by_the_person_is_passed_on_and_keeps_what_was_simulated():
    def stopped(theta):
        if theta[0] == 5.0:
            raise KeyboardInterrupt
        return quick(theta)

    simulations = Simulations(stopped)
    with pytest.raises(KeyboardInterrupt):
        simulations(THETAS)
    assert simulations.count == 2


def test_names_that_change_with_theta_are_refused_but_one_that_is_rare_is_not():
    thetas = np.arange(40.0).reshape(20, 2)
    with pytest.raises(SimulationError, match=r"same names for every θ.* 20 names"):
        Simulations(lambda theta: {f"peak at {theta[0]}": 1.0})(thetas)
    rare = Simulations(lambda theta: {f"peak at {theta[0]}": 1.0, "settling": 2.0})(thetas)
    assert all("settling" in outcome for outcome in rare)
    kinds = Simulations(lambda theta: {"abc"[int(theta[0]) % 3]: 1.0})(thetas)
    assert {name for outcome in kinds for name in outcome} == {"a", "b", "c"}


def test_threads_share_what_is_simulated_one_at_a_time_and_none_twice():
    calls, inside, most = [], [], []

    def slow(theta):
        inside.append(1)
        most.append(len(inside))
        time.sleep(0.002)
        calls.append(tuple(theta))
        inside.pop()
        return {"sum": theta.sum()}

    simulations, thetas = Simulations(slow), np.arange(24.0).reshape(12, 2)
    found = {}
    orders = [np.random.default_rng(k).permutation(12) for k in range(4)]
    threads = [
        threading.Thread(target=lambda k=k: found.update({k: simulations(thetas[orders[k]])}))
        for k in range(4)
    ]
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):
        assert 0 <= simulations.failed <= simulations.count <= 12  # while they are simulating
    assert sorted(calls) == [tuple(theta) for theta in thetas]
    assert max(most) == 1
    for k, order in enumerate(orders):
        assert [o["sum"] for o in found[k]] == thetas[order].sum(axis=1).tolist()


VALUES = st.one_of(st.floats(), st.sampled_from([0, 10**300, -(10**300), True, np.float32(1.5), np.int64(3)]))
RESULTS = st.one_of(st.none(), st.dictionaries(st.sampled_from("abc"), VALUES), st.just(OSError()))


@given(results=st.lists(RESULTS, min_size=1, max_size=9))
def test_any_kpis_are_kept_as_numbers_without_nan(results):
    def simulate(theta):
        found = results[int(theta[0])]
        if isinstance(found, OSError):
            raise found
        return found

    known = [
        {} if not isinstance(r, dict) else {n: float(v) for n, v in r.items() if not math.isnan(float(v))}
        for r in results
    ]
    simulations = Simulations(simulate)
    thetas = np.arange(float(len(results)))[:, None]
    if not any(known):
        with pytest.raises(SimulationError, match="worked for none"):
            simulations(thetas)
        return
    assert [dict(outcome) for outcome in simulations(thetas)] == known
    assert simulations.failed == sum(not k for k in known)
