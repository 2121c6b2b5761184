"""The named closed loops: plants, gains, KPIs, roughness, simulation."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from prefcal_env.errors import KnobError, ScenarioError
from prefcal_env.experiments.experiment import Channel, Channels, End, Move
from prefcal_env.plants.jacobians import derivative
from prefcal_scenarios.cases.loops import LOOPS, loop, named
from prefcal_scenarios.cases.loops.family import nominal
from prefcal_scenarios.cases.loops.loop import Actuator, TunedLQR, TunedPID, compute_kpis
from prefcal_scenarios.cases.loops.plants import FEEDBACK, PID, CartPole, Linear, packed, simulate
from prefcal_scenarios.runs import INTERRUPTED, outcome
from prefcal_scenarios.scenario import with_ranges
from support.equations import evaluated
from support.short_runs import short_run
from support.varied import random

every = pytest.mark.parametrize("name", LOOPS)


@every
def test_a_loop_starts_in_a_steady_state_that_its_inputs_can_hold(name):
    rng = np.random.default_rng(0)
    for vary in (nominal, *(random(rng) for _ in range(20))):
        made = LOOPS[name](vary)
        x0, u0 = made.task.x0, made.task.u0
        dx = made.plant.f(x0, u0, made.task.disturbance(0.0))
        assert dx == pytest.approx(np.zeros(len(x0)), abs=1e-9)
        assert all(c.low <= u <= c.high for c, u in zip(made.plant.inputs, u0, strict=True))


@every
def test_theta_outside_the_space_is_refused_until_the_range_is_widened(name):
    scenario = named(name)
    theta = scenario.space.decode(np.full(len(scenario.space), 0.5))
    theta[0] = scenario.space.knobs[0].high * 1.1
    with pytest.raises(KnobError, match=scenario.space.names[0]):
        scenario.run(theta)
    first = scenario.space.knobs[0]
    wide = type(first)(first.name, first.low, 2 * first.high, first.unit, scale=first.scale)
    space = type(scenario.space)([wide, *scenario.space.knobs[1:]])
    assert with_ranges(scenario, space).run(theta).theta[0] == theta[0]


def test_an_unknown_name_is_refused_with_the_nearest_one():
    with pytest.raises(ScenarioError, match="Did you mean 'oscillatory'"):
        named("oscilatory")


def test_a_theta_without_a_controller_is_a_failed_run(monkeypatch):
    def refuse(*matrices):
        raise np.linalg.LinAlgError("no finite solution")

    monkeypatch.setattr(loop, "solve_discrete_are", refuse)
    scenario = named("cart-pole")
    run = scenario.run(scenario.space.decode(np.full(len(scenario.space), 0.5)))
    assert run.end is End.FAILED
    assert len(run.t) == 0
    assert outcome(scenario, run)[INTERRUPTED] == 1.0


TANK = LOOPS["tank"]()


class Proportional:
    """What the law of a PID does with a gain alone."""

    T_s = 2.0

    def __init__(self, gain, fails=()):
        self.gain, self.fails, self.seen = gain, fails, []

    def move(self, m):
        self.seen.append(m)
        u = TANK.task.u0[0] + self.gain * (m.y_ref[0] - m.x[0])
        return Move(np.array([u]), iterations=3, solved=len(self.seen) not in self.fails)


def test_it_does_what_the_compiled_law_does():
    driven = TANK.by_controller(Proportional(200.0), 2, seed=1)
    values = {"K": 200.0, "T_i": np.inf, "T_t": np.inf, "b": 1.0}
    gains = TANK.controller.make(values, TANK.plant, TANK.task, 2.0)
    same = TANK.by_law(gains, 2, seed=1)
    np.testing.assert_allclose(driven.x, same.x, rtol=1e-12)
    steps = 2 * np.arange(len(driven.solved))
    np.testing.assert_allclose(driven.u[steps], same.u[steps], rtol=1e-12)


def test_steps_are_recorded_and_an_unsolved_one_holds_the_input():
    ticks = itertools.count(0.0, 0.5)
    driven = TANK.by_controller(Proportional(50.0, fails=(4,)), 2, 1, lambda: next(ticks))
    assert len(driven.solved) == len(range(0, len(driven.x) - 1, 2)) == 300
    assert np.flatnonzero(~driven.solved).tolist() == [3]
    assert (driven.iterations == 3).all()
    assert (driven.solve_time == 0.5).all()
    assert driven.u[6] == driven.u[5] != driven.u[8]


def test_it_sees_noisy_measurements_and_no_other_state():
    controller = Proportional(50.0)
    driven = TANK.by_controller(controller, 2, seed=1)
    seen = np.array([m.x for m in controller.seen])
    steps = 2 * np.arange(len(seen))
    assert (seen[:, 0] == driven.x[steps, 0] + TANK.noise(1)[steps, 0]).all()
    assert (seen[:, 1] == TANK.task.x0[1]).all()
    assert [m.u[0] for m in controller.seen[1:]] == driven.u[steps[:-1], 0].tolist()


@pytest.mark.parametrize("hold", [2, 7, 1000])
def test_it_stops_where_a_state_is_unsafe_or_time_is_up(hold):
    high = TANK.by_controller(Proportional(2000.0), hold, seed=1)
    assert (high.x[:-1, 0] <= 1.0).all()
    assert len(high.x) == len(high.u)
    assert len(high.solved) == len(range(0, len(high.x) - 1, hold))
    ended = TANK.end(high.x)
    assert ended is (End.UNSAFE if high.x[-1, 0] > 1.0 else End.TIME_UP)


TWICE = Linear(A=((0.0, 1.0), (0.0, 0.0)), B=((0.0,), (1.0,)), E=((0.0,), (1.0,)))
"""A double integrator."""


def rows(controller, values, n_u=1, T_s=1e-3):
    """The gains for a double integrator at 0, whose inputs rest at 0.5."""
    lag = LOOPS["lag"]()
    inputs = tuple(Channel(f"u{i}", low=-1.0, high=2.0) for i in range(n_u))
    plant = replace(lag.plant, parameters=TWICE, inputs=inputs)
    task = replace(lag.task, x0=np.zeros(2), u0=np.full(n_u, 0.5))
    return controller.make(values, plant, task, T_s).rows


def test_a_pid_has_every_value_in_its_column():
    values = {"K": 2.0, "T_i": 3.0, "T_d": 0.4, "T_f": 0.1, "b": 0.6, "T_t": 1.5}
    row = rows(TunedPID(), values)
    assert row.tolist() == [[2.0, 3.0, 0.4, 0.1, 0.6, 1.5, 0.5, -1.0, 2.0, 0.0, 0.0]]


def test_the_anti_windup_follows_the_integral_time_if_it_is_not_tuned():
    assert rows(TunedPID(), {"K": 1.0, "T_i": 3.0})[0, 5] == 3.0


def test_two_pids_have_their_own_values_and_signs():
    controller = TunedPID(suffixes=("_1", "_2"), signs=(1.0, -1.0), fixed={"b": 0.3})
    found = rows(controller, {"K_1": 2.0, "K_2": 4.0, "T_i": 3.0}, n_u=2)
    assert found[:, 0].tolist() == [2.0, -4.0]
    assert found[:, 1].tolist() == [3.0, 3.0]
    assert found[:, 4].tolist() == [0.3, 0.3]


def test_the_outer_controller_of_a_cascade_has_the_range_of_the_inner_reference():
    cascade = TunedPID(("_outer", "_inner"), inner=(4.0, -20.0, 30.0))
    outer, inner = rows(cascade, {"K_outer": 2.0, "K_inner": 5.0})
    assert outer[[0, 6, 7, 8]].tolist() == [2.0, 4.0, -20.0, 30.0]
    assert inner[[0, 6, 7, 8]].tolist() == [5.0, 0.5, -1.0, 2.0]


def test_the_linearization_of_the_cart_with_a_pole_is_that_of_the_textbook():
    cart = CartPole(cart=1.0, pole=0.2, length=0.5, friction=0.0)
    J = replace(LOOPS["cart-pole"]().plant, parameters=cart).jacobians(np.zeros(4), np.zeros(1), np.zeros(1))
    A, B = J.A, J.B
    assert A[2, 1] == pytest.approx(-0.2 * 9.81, rel=1e-6)  # -m g / M
    assert A[3, 1] == pytest.approx(1.2 * 9.81 / 0.5, rel=1e-6)  # (M + m) g / (M l)
    assert B[:, 0] == pytest.approx([0.0, 0.0, 1.0, -2.0], abs=1e-6)


def test_fast_sampling_gives_the_gains_of_the_continuous_regulator():
    # Without integral action, x1'' = u with weights Q_1 = R = 1 has K = (1, sqrt(2)).
    row = rows(TunedLQR(), {"Q_1": 1.0, "Q_z": 1e-8, "R": 1.0})[0]
    assert row[:2] == pytest.approx([1.0, np.sqrt(2)], rel=0.01)
    assert row[3:].tolist() == [0.5, -1.0, 2.0]


def test_the_closed_loop_of_the_regulator_is_stable_at_any_sampling_time():
    for hold in (10, 500):
        T_s = 1e-3 * hold
        row = rows(TunedLQR(), {"Q_1": 1.0, "Q_z": 1.0, "R": 1.0}, T_s=T_s)[0]
        A = np.array([[1.0, T_s, 0.0], [0.0, 1.0, 0.0], [T_s, T_s**2 / 2, 1.0]])
        B = np.array([T_s**2 / 2, T_s, T_s**3 / 6])
        assert np.abs(np.linalg.eigvals(A - np.outer(B, row[:3]))).max() < 1.0


CHANNELS = Channels(
    (Channel("level", "m"), Channel("flow")), (Channel("valve", "%"),), (Channel("level", "m"),)
)


def kpis(level, valve, *, disturbed_at=4.0, flow=None, beside=None):
    n = len(valve)
    flow = np.zeros(n + 1) if flow is None else np.array(flow)
    u = np.array(valve, dtype=float)[:, None]
    run = short_run(
        [1.0],
        t=np.arange(n + 1.0),
        x=np.column_stack([level, flow]),
        u=np.vstack([u, u[-1:]]),
        t_control=np.arange(float(n)),
        u_control=u,
        y_ref=np.full((n, 1), 2.0),
        iterations=np.zeros(n, dtype=int),
        solve_time=np.zeros(n),
        solved=np.ones(n, dtype=bool),
        channels=CHANNELS,
        end=End.TIME_UP,
    )
    return compute_kpis(run, disturbed_at, 50.0, beside)


def test_each_kpi_is_what_its_sentence_says():
    found = kpis([1, 2.2, 1.98, 2.0, 2.0, 1.5, 2.0], [50, 53, 54, 54, 54, 50])
    assert found["overshoot"] == pytest.approx(20.0)
    assert found["settling_time"] == 2.0
    assert found["error"] == pytest.approx(1 + 0.2 + 0.02 + 0.5)
    assert found["disturbance_peak"] == pytest.approx(0.5)
    assert found["effort"] == pytest.approx(np.sqrt((9 + 3 * 16) / 6))
    assert found["input_noise"] == pytest.approx(8 / 5)  # mean of 3, 1, 0, 0, 4
    assert found["switches"] == 3


def test_an_output_that_is_outside_at_the_disturbance_has_never_settled():
    assert kpis([1, 1.5, 2, 1.5, 2, 2, 2], [50] * 6)["settling_time"] == np.inf


def test_a_run_that_stopped_before_the_disturbance_has_no_finite_peak():
    found = kpis([1, 2.0, 2.0], [50, 50])
    assert found["settling_time"] == np.inf
    assert found["disturbance_peak"] == np.inf


def test_the_side_effect_counts_from_the_start_to_the_disturbance():
    found = kpis([1, 2, 2, 2, 2], [50] * 4, flow=[3, 3.5, 1, 3, 9], beside=1)
    assert found["side_effect"] == 2.0


def at_rest(name):
    """The plant of a loop, and its state, inputs and disturbance at the start."""
    made = LOOPS[name]()
    return made.plant, made.task.x0, made.task.u0, made.task.disturbance(0.0)


@pytest.mark.parametrize("name", LOOPS)
def test_it_rests_where_the_loop_starts_and_holds_like_the_plant(name):
    plant, x, u, d = at_rest(name)
    assert plant.f(x, u, d) == pytest.approx(np.zeros(len(x)), abs=1e-9)
    assert (plant.g(x, u, d) == x[list(plant.measured)]).all()
    times = plant.max_step * np.array([1.0, 2.5, 6.0])
    resting = plant.hold(x, u, d, times)
    assert resting == pytest.approx(np.tile(x, (3, 1)), abs=1e-9)


@pytest.mark.parametrize("name", LOOPS)
def test_its_compiled_equations_are_its_own(name):
    plant, x0, u, d = at_rest(name)
    x = x0 + 0.1
    J = plant.jacobians(x, u, d)
    matrices = np.concatenate([m.ravel() for m in (J.A, J.B, J.C, J.D)])
    for equation, values in (("f", plant.f(x, u, d)), ("g", plant.g(x, u, d)), ("jacobians", matrices)):
        found = evaluated(plant.equations, equation, len(values), x, u, d)
        np.testing.assert_array_equal(found, values)


def test_its_jacobians_are_those_of_the_equations():
    L, C, R, supply, r = 0.2, 0.47, 12.0, 12.0, 0.15
    point = np.array([20.0, 3.0, 0.4])

    def f(p):
        return np.array([((1 - p[2]) * p[1] - p[0] / R) / C, (supply - r * p[1] - (1 - p[2]) * p[0]) / L])

    J = LOOPS["boost-converter"]().plant.jacobians(point[:2], point[2:], np.zeros(1))
    exact = derivative(f, point)
    np.testing.assert_allclose(np.hstack([J.A, J.B]), exact, atol=1e-7)


def test_a_read_only_state_is_not_changed():
    plant, x0, u, d = at_rest("tank")
    x = x0.copy()
    x.setflags(write=False)
    plant.jacobians(x, u, d)
    assert (x == x0).all()


PREDICTIVE = [name for name in LOOPS if name.startswith("mpc-")]
predictive = pytest.mark.parametrize("name", PREDICTIVE)


def middle(made, **values):
    theta = made.space.decode(np.full(len(made.space), 0.5))
    for name, value in values.items():
        theta[made.space.names.index(name)] = value
    return theta


@predictive
def test_neither_step_nor_disturbance_leaves_an_offset(name):
    made = LOOPS[name](random(np.random.default_rng(7)))
    run = made.run(middle(made))
    step = made.target.start[0] - made.task.x0[made.plant.measured[0]]
    t, error = run.t, run.output(0) - made.target.start[0]
    for until in (made.disturbed_at, made.task.horizon):
        last = (t > until - 0.1 * made.task.horizon) & (t < until)
        assert abs(error[last].mean()) < 0.05 * abs(step)


@predictive
def test_the_solver_is_recorded_as_it_was(name):
    run = LOOPS[name]().run(middle(LOOPS[name]()))
    assert 40 <= len(run.t_control) <= 150
    assert run.solved.all()
    assert (run.solve_time > 0).all()


@pytest.mark.parametrize("name", ["mpc-oscillatory", "mpc-boost-converter"])
def test_an_eager_controller_needs_iterations_at_its_limits(name):
    made = LOOPS[name]()
    eager = next(knob.low for knob in made.space.knobs if knob.name == "Q_du")
    run = made.run(middle(made, Q_du=eager))
    assert run.solved.all()
    assert run.iterations.max() > 0


@predictive
def test_the_control_horizon_is_cut_to_the_prediction_horizon(name):
    made = LOOPS[name]()
    N_p, N_u = (int(knob.low if knob.name == "N_p" else knob.high) for knob in made.space.knobs[:2])
    theta = dict(zip(made.space.names, middle(made, N_p=N_p, N_u=N_u), strict=True))
    settings = made.controller.make(theta, made.plant, made.task, 0.5)._mpc.settings
    assert (settings.N_p, settings.N_u) == (N_p, min(N_u, N_p))


@predictive
def test_a_heavier_move_is_gentler(name):
    made = LOOPS[name]()
    knob = made.space.knobs[made.space.names.index("Q_du")]
    calm, lively = (made.run(middle(made, Q_du=v)).kpis for v in (knob.high, knob.low))
    assert calm["input_noise"] < lively["input_noise"]
    assert calm["error"] > lively["error"]


def lag(**changes):
    return replace(LOOPS["lag"](), **changes)


THETA = LOOPS["lag"]().space.decode(np.full(6, 0.5))


def test_a_rough_actuator_stands_at_its_steps_within_its_limits():
    u = lag(actuators=(Actuator(resolution=12.5),)).run(THETA).u[:, 0]
    assert set(np.unique(u)) <= set(np.arange(0, 101, 12.5))
    assert len(np.unique(u)) > 1


def test_an_actuator_that_sticks_moves_by_more_than_its_stiction_or_not_at_all():
    u = lag(actuators=(Actuator(stiction=3.0),)).run(THETA).u[:, 0]
    moves = np.abs(np.diff(u))
    assert (moves[moves > 0] > 3.0).all()
    assert moves.any()


def test_backlash_takes_up_small_turns():
    noisy = lag().run(THETA).u[:, 0]
    played = lag(actuators=(Actuator(backlash=2.0),)).run(THETA).u[:, 0]
    assert np.count_nonzero(np.diff(played)) < np.count_nonzero(np.diff(noisy)) / 2


def test_actuators_that_do_nothing_change_nothing():
    assert lag(actuators=(Actuator(),), resolution=(0.0,)).run(THETA) == lag().run(THETA)


def test_a_coarse_sensor_shows_its_steps_to_the_controller():
    fine, coarse = (lag(resolution=r).run(THETA).kpis["input_noise"] for r in ((), (5.0,)))
    assert fine != coarse


def test_the_controller_acts_at_every_nth_sample():
    space = LOOPS["lag"]().space
    knob = type(space.knobs[0])("every", 1, 8, integer=True)
    slow = lag(space=type(space)([*space.knobs, knob]))
    once, fourth = (slow.run(np.append(THETA, n)) for n in (1.0, 4.0))
    assert len(once.t_control) == pytest.approx(4 * len(fourth.t_control), abs=4)
    assert np.array_equal(once.x, lag().run(THETA).x)


def test_a_second_set_point_is_followed_and_counts_in_overshoot_and_settling_time():
    made = lag()
    task = replace(made.task, y_ref=replace(made.target, steps=((100.0, (43.0,)),)))
    one, two = made.run(THETA), lag(task=task).run(THETA)
    assert set(two.y_ref[:, 0]) == {50.0, 43.0}
    assert two.output(0)[-1] == pytest.approx(43.0, abs=2)
    before = two.t < 100
    assert np.array_equal(one.x[: before.sum()], two.x[: before.sum()])
    assert two.kpis["settling_time"] > one.kpis["settling_time"]


LAG = Linear(A=((-1.0,),), B=((2.0,),), E=((1.0,),))
"""ẋ = -x + 2 u + d, in seconds."""
WIDE = np.array([[-100.0, 100.0]])


def pid(K=0.0, T_i=np.inf, T_d=0.0, T_f=0.0, b=1.0, T_t=np.inf, bias=0.0, low=-10.0, high=10.0):
    return np.array([[K, T_i, T_d, T_f, b, T_t, bias, low, high, 0.0, 0.0]])


def run(gains, *, target=1.0, d=0.0, noise=None, delay=0, hold=1, limits=WIDE, law=PID, T=10.0):
    dt = 0.01
    count = round(T / dt) + 1
    return simulate(
        (*packed(LAG), np.array([0])),
        (law, gains, np.zeros((0, 4)), np.zeros(0)),
        (
            np.full((count, 1), target),
            np.full((count, 1), d),
            np.zeros((count, 1)) if noise is None else noise,
        ),
        (dt, hold, delay, 0.0),
        (np.zeros(1), np.zeros(1), limits),
    )


def test_a_constant_input_gives_the_exact_step_response():
    x, u, valid = run(pid(bias=0.5))
    assert valid == len(x) == 1001
    assert (u == 0.5).all()
    t = 0.01 * np.arange(1001)
    np.testing.assert_allclose(x[:, 0], 1 - np.exp(-t), atol=1e-9)


def test_the_input_acts_after_the_dead_time():
    at_once, late = run(pid(bias=0.5))[0], run(pid(bias=0.5), delay=50)[0]
    assert not late[:51].any()
    np.testing.assert_allclose(late[50:], at_once[:-50], atol=1e-12)


def test_proportional_control_ends_where_the_formula_says():
    x, _, _ = run(pid(K=2.0))
    assert x[-1, 0] == pytest.approx(4 / 5)  # 2 K / (1 + 2 K) of the target


def test_integral_action_removes_the_error_in_spite_of_a_disturbance():
    x, u, _ = run(pid(K=2.0, T_i=0.5), d=0.6)
    assert x[-1, 0] == pytest.approx(1.0, abs=1e-4)
    assert u[-1, 0] == pytest.approx(0.2, abs=1e-4)  # 2 u + d = 1


def test_the_input_is_held_between_sampling_instants_and_limited():
    _, u, _ = run(pid(K=5.0, high=0.8), hold=20)
    assert u.max() == 0.8
    assert (np.diff(u[:, 0]).nonzero()[0] % 20 == 19).all()


def test_the_set_point_weight_scales_the_first_move():
    assert run(pid(K=2.0, T_i=1.0, b=0.25))[1][0, 0] == pytest.approx(0.5)


def test_the_anti_windup_shortens_the_overshoot():
    def peak(T_t):
        return run(pid(K=1.0, T_i=0.1, T_t=T_t, high=0.6))[0].max()

    assert peak(0.05) < peak(np.inf) - 0.05


def test_the_filter_calms_the_input():
    noise = 0.1 * np.random.default_rng(0).standard_normal((1001, 1))

    def moves(T_f):
        return np.diff(run(pid(K=2.0, T_d=0.05, T_f=T_f), noise=noise)[1], axis=0).std()

    assert moves(0.2) < moves(0.01) / 10


def test_state_feedback_integrates_the_error_away():
    gains = np.array([[1.0, 2.0, 0.0, -10.0, 10.0]])  # K, K_z, bias, low, high
    x, _, _ = run(gains, law=FEEDBACK, d=0.6)
    assert x[-1, 0] == pytest.approx(1.0, abs=1e-3)


def test_stages_with_hysteresis_switch_less():
    noise = 0.02 * np.random.default_rng(0).standard_normal((1001, 1))

    def switches(hysteresis):
        gains = pid(K=4.0, T_i=1.0, low=0.0, high=1.0)
        gains[0, -2:] = 4.0, hysteresis
        u = run(gains, noise=noise)[1]
        assert set(np.unique(u)) <= {0.0, 0.25, 0.5, 0.75, 1.0}
        return np.count_nonzero(np.diff(u[:, 0]))

    assert 0 < switches(0.5) < switches(0.0) / 2


def test_it_stops_after_the_first_state_outside_its_limits():
    x, u, valid = run(pid(bias=1.0), limits=np.array([[-1.0, 1.0]]))
    assert valid == 71  # 2 (1 - exp(-t)) passes 1 at t = ln 2
    assert x[valid - 2, 0] <= 1.0 < x[valid - 1, 0]
    assert u[valid - 1, 0] == 1.0
