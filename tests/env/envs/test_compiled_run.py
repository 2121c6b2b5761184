"""A plant that PIDs control runs compiled, and does what it does in `rollout`."""

from itertools import product

import numba
import numpy as np
import pytest

from prefcal_env import Channel, End, FunctionPlant, Move, Plant, rollout
from prefcal_env.compiling import of_compiled_runs
from prefcal_env.controllers.pid import PID, Decentralized
from prefcal_env.envs.closed_loop import ClosedLoop, compiled_run
from prefcal_env.envs.plant_env import PlantEnv
from prefcal_env.envs.task import StepSignal, Task
from prefcal_env.envs.varied_loop import Worn, varied_plant
from prefcal_env.errors import PlantError
from prefcal_env.plants.plant import Disturbed

THETA = np.ones(1)


def drawn(random, *choices):
    """Return one of some values."""
    return choices[int(random.integers(len(choices)))]


def random_plant(random):
    """Return a plant of order 0 to 4, some unstable, some discrete, some with D, dead time and rest."""
    n, n_u, n_y = (int(random.integers(*ends)) for ends in ((0, 5), (1, 3), (1, 3)))
    A = random.standard_normal((n, n)) - drawn(random, 0.0, 1.0, 2.0, 3.0) * np.eye(n)
    B, C = random.standard_normal((n, n_u)), random.standard_normal((n_y, n))
    D = random.standard_normal((n_y, n_u)) * (n == 0 or drawn(random, 0, 0, 1))
    dt = drawn(random, 0.0, 0.0, 0.0, 0.05)
    if dt:
        A = A / 4 + np.eye(n) / 2

    def late(m):
        longest = drawn(random, 0.0, 0.0, 0.3, 1.1)
        found = random.uniform(0.0, longest, m)
        return (np.round(found / dt) * dt if dt else found).tolist()

    limits = drawn(random, np.inf, 2.0, 0.5)
    inputs = [Channel(f"u{i}", low=-limits, high=limits) for i in range(n_u)]
    rest = (random.standard_normal(n_u) / 4, random.standard_normal(n_y)) if drawn(random, 0, 1) else None
    return Plant.of((A, B, C, D, dt), inputs=inputs, delay=late(n_u), output_delay=late(n_y), rest=rest)


def random_equations(random):
    """Return a plant with curved equations, some with own outputs, some slower with less gain."""
    n, n_u = (int(random.integers(1, end)) for end in (4, 3))
    A, B = random.standard_normal((n, n)) - 2 * np.eye(n), random.standard_normal((n, n_u))
    limits = drawn(random, np.inf, 2.0, 0.5)
    own = drawn(random, None, lambda x, u, d: [x[0] + 0.1 * u[0], x[0] ** 2])
    plant = FunctionPlant(
        lambda x, u, d: A @ np.sin(x) + B @ u + 0.1 * d[0],
        own,
        states=[Channel(f"x{i}") for i in range(n)],
        inputs=[Channel(f"u{i}", low=-limits, high=limits) for i in range(n_u)],
        outputs=[Channel("a"), Channel("b")] if own else (),
        disturbances=[Channel("d")],
        delay=random.uniform(0.0, drawn(random, 0.0, 0.3, 1.1), n_u).tolist(),
        max_step=drawn(random, None, 0.03),
    )
    values = drawn(random, {}, {"all time constants": 1.2, "gain of u0": 0.8, "dead time": 1.3})
    return varied_plant(plant, values, 1.3 if values else 1.0).plant


def random_task(random, plant):
    """Return a plant with loads, and a task with some of what a task can have."""
    n_u, n_y = len(plant.inputs), len(plant.outputs)
    loaded = Disturbed(plant, on_outputs=range(drawn(random, 0, n_y)), on_inputs=range(n_u))
    size, n_d = plant.inputs[0].high, len(loaded.disturbances)
    u0 = random.uniform(-0.5, 0.5, n_u) * min(size, 1.0)
    steps = [(t, random.standard_normal(n_y)) for t in (1.7, 4.0)]
    steps[0][1][0] = drawn(random, 1.0, np.nan)
    task = Task(
        x0=random.standard_normal(len(plant.states)),
        u0=u0,
        y_ref=StepSignal(random.standard_normal(n_y), tuple(steps)),
        d=StepSignal(np.zeros(n_d), ((2.5, random.standard_normal(n_d)),)),
        horizon=6.0,
        dense_step=drawn(random, 0.1, 0.07, 0.31),
        tracked=(0,),
        unsafe=drawn(random, lambda x: False, lambda x: bool(np.any(np.abs(x) > 20.0))),
        max_move=drawn(random, None, np.full(n_u, 0.2)),
        noise=drawn(random, None, np.full(n_y, 0.05)),
        bias=drawn(random, None, np.full(n_y, 0.1)),
        lag=drawn(random, 0.0, 0.03, 0.2, 5.0),
        measurement_delay=drawn(random, 0.0, 0.0, 0.13, [0.21] * n_y),
        jitter=0.0 if getattr(plant, "sample_time", 0.0) else drawn(random, 0.0, 0.1, 0.49),
    )
    return loaded, task


def random_controller(random, plant):
    """Return a function that makes a controller: a PID, or several, some behind worn devices."""
    n_u, n_y = len(plant.inputs), len(plant.outputs)
    rows = [random.uniform(-1.0, 1.0, 4) for _ in range(int(random.integers(1, n_u + 1)))]
    T_i, T_s, c = drawn(random, np.inf, 2.0), drawn(random, 0.1, 0.25), drawn(random, 0.0, 1.0)
    worn = drawn(random, 0, 0, 1)
    grain, play = np.full(n_y, drawn(random, 0.0, 0.03)), np.full(n_u, drawn(random, 0.0, 0.02))

    def make(_):
        pids = [
            PID(K, T_i, abs(T_d), T_s=T_s, b=b, c=c, output=i % n_y, input=i, plant=plant)
            for i, (K, T_d, b, _) in enumerate(rows)
        ]
        found = pids[0] if len(pids) == 1 else Decentralized(pids)
        return Worn(found, grain, play, plant.inputs) if worn else found

    return make


def assert_close(a, b):
    """Assert that two experiments are the same but for rounding, relative to the largest number so far."""
    assert (a.end, a.t.shape, a.solved.tolist()) == (b.end, b.t.shape, b.solved.tolist())
    for name in ("t", "x", "u", "y", "t_control", "u_control", "y_ref"):
        found, right = getattr(a, name), getattr(b, name)
        assert found.shape == right.shape, name
        if right.size:
            size = np.fmax.accumulate(np.abs(right).reshape(len(right), -1).max(axis=1))
            error = np.abs(found - right).reshape(len(right), -1).max(axis=1)
            assert np.all(np.isnan(error) | (error <= 1e-9 * (1 + size))), (
                name,
                np.nanmax(error / (1 + size)),
            )
            assert np.array_equal(np.isnan(found), np.isnan(right)), name


@pytest.mark.parametrize("plant_of", [random_plant, random_equations])
@pytest.mark.parametrize("seed", range(60))
def test_random_loops_run_as_in_a_rollout(seed, plant_of):
    random = np.random.default_rng([seed, 7])
    plant, task = random_task(random, plant_of(random))
    env, make = PlantEnv(plant, task), random_controller(random, plant)
    assert compiled_run(env, make(THETA), seed) is not None
    assert_close(ClosedLoop(env, make)(THETA, seed), rollout(env, make(THETA), THETA, seed=seed))


LAG = Plant.of(([2.0], [3.0, 1.0]), inputs=Channel("u", low=-1.0, high=1.0), delay=0.35)


def lag_env(plant=LAG, **how):
    return PlantEnv(plant, Task(x0=np.zeros(1), u0=np.zeros(1), y_ref=np.ones(1), horizon=2.0, **how))


def pid_of(theta):
    return PID(theta[0], 2.0, T_s=0.1)


def test_a_run_that_overflows_ends_with_its_last_finite_state():
    plant = Plant.of(([1.0], [1.0, -400.0]))
    env, found = lag_env(plant), ClosedLoop(lag_env(plant), pid_of)(THETA)
    assert found.end is End.UNSAFE
    assert_close(found, rollout(env, pid_of(THETA), THETA))
    assert np.isfinite(found.x).all()
    assert found.x.max() > 1e250


def test_a_run_that_becomes_unsafe_ends_at_the_first_unsafe_instant():
    env = lag_env(unsafe=lambda x: bool(x[0] > 0.9))
    found = ClosedLoop(env, pid_of)(THETA)
    assert found.end is End.UNSAFE
    assert found.x[-1, 0] > 0.9 >= found.x[:-1].max()
    assert_close(found, rollout(env, pid_of(THETA), THETA))


def test_a_controller_goes_on_with_what_it_remembers():
    first, second = pid_of(THETA / 5), pid_of(THETA / 5)
    for start in (0.2, 0.37):  # the second run begins with the integral of 2 s, 0.1 times the error
        found = ClosedLoop(lag_env(), lambda _: first)(THETA)
        assert_close(found, rollout(lag_env(), second, THETA))
        assert found.u_control[0, 0] == pytest.approx(start, abs=0.01)


def test_noise_and_jitter_are_those_of_the_seed():
    loop = ClosedLoop(lag_env(noise=np.full(1, 0.1), jitter=0.2), pid_of)
    assert loop(THETA, 3) == loop(THETA, 3)
    assert loop(THETA, 3) != loop(THETA, 4)


LARGE = Task(np.zeros(101), np.zeros(1), np.ones(1), 2.0)


class Own(PID):
    """A controller that may do anything in another way."""


class SubPlant(FunctionPlant):
    """A plant that may do anything in another way."""


class Packed:
    """Somebody's own controller, with an attribute of the same name."""

    packed, T_s = "a parcel", 0.1

    def move(self, measurement):
        return Move(measurement.u)


UNKNOWN = {
    "an own controller with a familiar attribute": (lag_env(), lambda theta: Packed()),
    "another plant": (
        lag_env(SubPlant(lambda x, u, d: -x, states=[Channel("x")], inputs=[Channel("u")])),
        pid_of,
    ),
    "another controller": (lag_env(), lambda theta: Own(theta[0], T_s=0.1)),
    "another controller among several": (lag_env(), lambda theta: Decentralized([Own(theta[0], T_s=0.1)])),
    "a hundred states and more": (
        PlantEnv(Plant.of((-np.eye(101), np.eye(101)[:, :1], np.eye(101)[:1], [[0.0]])), LARGE),
        pid_of,
    ),
    "a preview": (lag_env(preview=2), pid_of),
    "an end of its own": (lag_env(settled=lambda period: True), pid_of),
    "a dead time of one entry": (
        PlantEnv(
            Plant.of(np.ones((2, 2)), delay=[[0.0, 0.1], [0.2, 0.0]]),
            Task(np.zeros(0), np.zeros(2), np.ones(2), 2.0),
        ),
        pid_of,
    ),
}


@pytest.mark.parametrize("what", UNKNOWN)
def test_what_is_not_compiled_runs_as_before(what):
    env, make = UNKNOWN[what]
    assert compiled_run(env, make(THETA), 0) is None
    assert ClosedLoop(env, make)(THETA).end in (End.TIME_UP, End.SETTLED)


def test_a_pid_of_a_channel_that_does_not_exist_is_not_compiled():
    for pid in (PID(1.0, T_s=0.1, output=1), PID(1.0, T_s=0.1, input=1)):
        assert compiled_run(lag_env(), pid, 0) is None
        with pytest.raises(IndexError):
            ClosedLoop(lag_env(), lambda _: pid)(THETA)  # noqa: B023


def plant_by(f, g=None):
    outputs = [Channel("y")] if g else ()
    return FunctionPlant(
        f, g, states=[Channel("x")], inputs=[Channel("u", low=-1.0, high=1.0)], outputs=outputs
    )


def test_a_reference_that_is_a_function_of_time_runs_compiled():
    for plant in (LAG, plant_by(lambda x, u, d: u - x)):
        env = PlantEnv(plant, Task(np.zeros(1), np.zeros(1), lambda t: np.array([np.sin(t)]), 2.0))
        assert compiled_run(env, pid_of(THETA), 0) is not None
        assert_close(ClosedLoop(env, pid_of)(THETA), rollout(env, pid_of(THETA), THETA))


def test_a_reference_that_changes_its_shape_is_not_compiled():
    env = PlantEnv(LAG, Task(np.zeros(1), np.zeros(1), lambda t: np.ones(1 + (t > 1)), 2.0))
    assert compiled_run(env, pid_of(THETA), 0) is None


def test_a_plant_of_equations_runs_to_the_last_digit_as_in_a_rollout():
    env = lag_env(plant_by(lambda x, u, d: u - np.sqrt(1 + x)), noise=np.full(1, 0.1), jitter=0.2)
    assert compiled_run(env, pid_of(THETA), 3) is not None
    found, right = ClosedLoop(env, pid_of)(THETA, 3), rollout(env, pid_of(THETA), THETA, seed=3)
    for name in ("t", "x", "u", "y", "u_control"):
        assert np.array_equal(getattr(found, name), getattr(right, name)), name


def raising(error, begin=0.3):
    """Return a function that raises beyond a state."""

    def value(x, u, d):
        if x[0] > begin:
            raise error
        return [u[0] - x[0]]

    return value


FAILING = {
    "equations that blow up": plant_by(lambda x, u, d: [u[0] + 40 * x[0] ** 2]),
    "equations that are stiff": plant_by(lambda x, u, d: [1e7 * (u[0] - x[0])]),
    "a rate that cannot be": plant_by(raising(ZeroDivisionError())),
    "a rate that is not a number": plant_by(lambda x, u, d: [u[0] - x[0] if x[0] < 0.3 else np.nan]),
}


@pytest.mark.parametrize("what", FAILING)
def test_equations_that_fail_are_left_to_a_rollout(what):
    env = lag_env(FAILING[what])
    assert compiled_run(env, pid_of(THETA), 0) is None
    assert_close(ClosedLoop(env, pid_of)(THETA), rollout(env, pid_of(THETA), THETA))


@pytest.mark.parametrize("error", [KeyError("valve"), KeyboardInterrupt()])
def test_what_an_equation_raises_is_raised(error):
    for plant in (plant_by(raising(error)), plant_by(lambda x, u, d: u - x, raising(error))):
        with pytest.raises(type(error)):
            ClosedLoop(lag_env(plant), pid_of)(THETA)


def test_equations_that_return_too_many_numbers_are_a_mistake():
    with pytest.raises(PlantError, match="1 values"):
        ClosedLoop(lag_env(plant_by(lambda x, u, d: [u[0] - x[0], 0.0])), pid_of)(THETA)


def test_a_run_may_fail_behind_an_unsafe_state():
    env = lag_env(plant_by(raising(ValueError())), unsafe=lambda x: bool(x[0] > 0.2))
    assert compiled_run(env, pid_of(THETA), 0) is not None
    found = ClosedLoop(env, pid_of)(THETA)
    assert found.end is End.UNSAFE
    assert_close(found, rollout(env, pid_of(THETA), THETA))


def test_compiled_equations_run_as_in_python():
    def f(x, u, d):
        return np.array([u[0] - x[0] ** 3])

    plain, fast = (ClosedLoop(lag_env(plant_by(each)), pid_of)(THETA) for each in (f, numba.njit(f)))
    assert compiled_run(lag_env(plant_by(numba.njit(f))), pid_of(THETA), 0) is not None
    assert_close(fast, plain)


def test_what_is_compiled_ahead_serves_every_run():
    for seed, plant_of in product(range(10), (random_plant, random_equations)):
        random = np.random.default_rng([seed, 7])
        plant, task = random_task(random, plant_of(random))
        compiled_run(PlantEnv(plant, task), random_controller(random, plant)(THETA), seed)
    for linear in (True, False):
        (kernel,) = of_compiled_runs(linear=linear)
        kernel.function.compile(kernel.types)
    assert len(kernel.function.signatures) == 2
