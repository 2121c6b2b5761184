"""The MPC of the loops: offset-free, within limits, with the horizons of its knobs."""

import numpy as np
import pytest

from prefcal_scenarios.cases.loops import LOOPS
from prefcal_scenarios.cases.loops.vary import random

PREDICTIVE = [name for name in LOOPS if name.startswith("mpc-")]
every = pytest.mark.parametrize("name", PREDICTIVE)


def middle(made, **values):
    theta = made.space.decode(np.full(len(made.space), 0.5))
    for name, value in values.items():
        theta[made.space.names.index(name)] = value
    return theta


@every
def test_neither_step_nor_disturbance_leaves_an_offset(name):
    made = LOOPS[name](random(np.random.default_rng(7)))
    run = made.run(middle(made))
    step = made.task.target[0] - made.task.x0[made.measured[0]]
    t, error = run.t, run.output(0) - made.task.target[0]
    for until in (made.timing.disturbed_at, made.timing.horizon):
        last = (t > until - 0.1 * made.timing.horizon) & (t < until)
        assert abs(error[last].mean()) < 0.05 * abs(step)


@every
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


@every
def test_the_control_horizon_is_cut_to_the_prediction_horizon(name):
    made = LOOPS[name]()
    N_p, N_u = (int(knob.low if knob.name == "N_p" else knob.high) for knob in made.space.knobs[:2])
    theta = dict(zip(made.space.names, middle(made, N_p=N_p, N_u=N_u), strict=True))
    settings = made.controller.controller(theta, made._course(10, 0))._mpc.settings
    assert (settings.N_p, settings.N_u) == (N_p, min(N_u, N_p))


@every
def test_a_heavier_move_is_gentler(name):
    made = LOOPS[name]()
    knob = made.space.knobs[made.space.names.index("Q_du")]
    calm, lively = (made.run(middle(made, Q_du=v)).kpis for v in (knob.high, knob.low))
    assert calm["input_noise"] < lively["input_noise"]
    assert calm["error"] > lively["error"]
