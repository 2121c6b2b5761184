"""What holds for every stable linear plant, on random ones."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from prefcal_env import Move, Plant, PlantEnv, Task, rollout

seeds = st.integers(0, 2**32 - 1)
sizes = st.integers(1, 4)


def stable(seed, n_x, n_u=2, n_y=2):
    """Random matrices with all poles left of -0.1, and a state and an input to start with."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(n_x, n_x))
    A -= (np.linalg.eigvals(A).real.max() + 0.1 + rng.exponential()) * np.eye(n_x)
    B, C = rng.normal(size=(n_x, n_u)), rng.normal(size=(n_y, n_x))
    return (A, B, C, rng.normal(size=(n_y, n_u))), rng.normal(size=n_x), rng.normal(size=n_u)


class Staircase:
    """A controller that applies one row of `u` after the other."""

    def __init__(self, u, T_s):
        self.u, self.T_s = u, T_s

    def move(self, m):
        return Move(self.u[min(round(m.t / self.T_s), len(self.u) - 1)])


def outputs(plant, u, T_s, horizon):
    task = Task(x0=plant.x0, u0=plant.u0, y_ref=np.zeros(2), horizon=horizon, dense_step=T_s / 8)
    run = rollout(PlantEnv(plant, task), Staircase(u, T_s), np.ones(1))
    return run.t, run.y


@given(seed=seeds, n_x=sizes, cuts=st.lists(st.floats(0.01, 3.0), min_size=1, max_size=8))
def test_one_long_hold_is_the_same_as_many_short_ones(seed, n_x, cuts):
    system, x0, u = stable(seed, n_x)
    plant, none, times = Plant.of(system), np.zeros(0), np.cumsum(cuts)
    once, x = plant.hold(x0, u, none, times), x0
    for i, dt in enumerate(cuts):
        x = plant.hold(x, u, none, np.array([dt]))[0]
        assert x == pytest.approx(once[i], rel=1e-9, abs=1e-9)


@given(seed=seeds, n_x=sizes)
def test_a_held_input_leads_to_the_steady_state_of_the_matrices(seed, n_x):
    (A, B, C, D), x0, u = stable(seed, n_x)
    plant, none = Plant.of((A, B, C, D)), np.zeros(0)
    rest = -np.linalg.solve(A, B @ u)
    assert plant.f(rest, u, none) == pytest.approx(np.zeros(n_x), abs=1e-8)
    assert plant.hold(x0, u, none, np.array([1000.0]))[0] == pytest.approx(rest, rel=1e-6, abs=1e-6)


@settings(max_examples=25)
@given(seed=seeds, n_x=sizes, dead=st.floats(0.01, 1.5), late=st.floats(0.0, 0.4))
def test_dead_time_of_input_and_output_add_up_for_any_length(seed, n_x, dead, late):
    system, _, _ = stable(seed, n_x)
    u = np.random.default_rng(seed).normal(size=(1, 2))
    split = Plant.of(system, delay=dead, output_delay=late)
    t, y = outputs(split, u, 0.2, 2.0)
    plain = Plant.of(system)
    for i in np.flatnonzero(t > dead + late + 1e-6):
        x = plain.hold(np.zeros(n_x), u[0], np.zeros(0), np.array([t[i] - dead - late]))[0]
        assert y[i] == pytest.approx(plain.g(x, u[0], np.zeros(0)), rel=1e-8, abs=1e-8)


@settings(max_examples=25)
@given(seed=seeds, n_x=sizes, periods=st.integers(1, 5), where=st.sampled_from(["in", "out"]))
def test_dead_time_shifts_the_response_by_its_length(seed, n_x, periods, where):
    system, _, _ = stable(seed, n_x)
    T_s, dead = 0.2, periods * 0.2
    u = np.random.default_rng(seed).normal(size=(10, 2))
    name = {"in": "delay", "out": "output_delay"}[where]
    t, y = outputs(Plant.of(system), u, T_s, 2.0)
    later, late = outputs(Plant.of(system, **{name: dead}), u, T_s, 3.0)
    for at in (0.05, 0.15, 0.75, 1.15, 1.9):  # between samples: there, nothing jumps
        i, j = np.argmin(np.abs(t - at)), np.argmin(np.abs(later - (at + dead)))
        assert [t[i], later[j]] == pytest.approx([at, at + dead], abs=1e-9)
        assert late[j] == pytest.approx(y[i], rel=1e-8, abs=1e-8)
    assert late[later < dead - 1e-9] == pytest.approx(0.0, abs=1e-12)
