"""The plants of the loops, and the MPC that uses them as models: no offset, horizons as tuned."""

import numpy as np
import pytest

from prefcal_env.plants.jacobians import derivative
from prefcal_scenarios.cases.loops import LOOPS
from support.equations import evaluated
from support.varied import random


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
