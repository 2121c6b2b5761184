"""The applied move is right: against 300 digits, over the paper's box, on the way to the target.

In full: `pytest -m campaign tests/env/mpc/test_exact.py` (some 12,000 problems a backend).
"""

import itertools

import numpy as np
import pytest

from prefcal_env.experiments.experiment import Measurement
from prefcal_env.mpc import LinearMPC, MPCSettings, control_horizon
from prefcal_env.mpc.controller import BACKENDS
from prefcal_env.plants.cstr import CSTR, FEED

pytest.importorskip("gmpy2")
from support.exact_mpc import minimize, single_input_problem, with_precision

PLANT, TARGET = CSTR(), np.array([0.0, 2.0])
T_S, N_P = (0.25, 0.31, 0.5, 0.8, 1.1, 1.25, 1.5), (4, 9, 15, 22, 26, 33, 40)
LOG_Q = (-5.0, -3.0, -1.79, -0.91, 0.5, 1.5, 3.0)


def settings(T_s, N_p, log_q, backend="piqp"):
    return MPCSettings(
        T_s=T_s,
        N_p=N_p,
        N_u=control_horizon(1 / 3, N_p),
        Q_y=np.diag([0, 1]),
        Q_du=[[10.0**log_q]],
        du_min=[-10],
        du_max=[10],
        backend=backend,
    )


def on_the_way(theta, until=30.0):
    """States and last inputs at the sampling instants of a closed loop from C_A = 8.56."""
    controller = LinearMPC(PLANT, settings(*theta))
    x, u = PLANT.steady_state_at_concentration(8.56)
    visited = []
    for _ in range(int(until / theta[0])):
        visited.append((x, u))
        u = controller.move(Measurement(0.0, x, u, FEED, TARGET)).u
        x = PLANT.hold(x, u, FEED, np.array([theta[0]]))[0]
    return visited


VISITED = [s for theta in ((0.25, 26, -0.91), (0.31, 26, -1.79), (1.25, 12, 1.0)) for s in on_the_way(theta)]


def error(theta, state, backend):
    """Distance from the exact move [K]; None where the controller says that it is unsolved."""
    x, u = state
    mpc = settings(*theta, backend)
    controller = LinearMPC(PLANT, mpc)
    move = controller.move(Measurement(0.0, x, u, FEED, TARGET))
    if not move.solved:
        return None
    start = controller._plan[:, 0] - u[0]  # saves the reference most of its iterations
    exact = with_precision(_first_exact_move, mpc, x, u, start)
    return abs(move.u[0] - u[0] - exact)


def _first_exact_move(mpc, x, u, start):
    return float(minimize(single_input_problem(PLANT, x, u, FEED, TARGET, mpc), start)[0])


def check(problems, backend):
    errors = [error(theta, state, backend) for theta, state in problems]
    unsolved = sum(e is None for e in errors)
    worst = max(e for e in errors if e is not None)
    print(f"{backend}: {len(errors)} moves, {unsolved} unsolved, worst error {worst:.2g} K")
    assert unsolved == 0
    assert worst < 1e-3


def grid(every):
    thetas = list(itertools.product(T_S, N_P, LOG_Q))
    return [(t, VISITED[(7 * i + 13 * k) % len(VISITED)]) for i, t in enumerate(thetas) for k in range(every)]


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_move_is_right_to_a_millikelvin_over_the_papers_box(backend):
    check(grid(1)[::3], backend)


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_move_is_right_where_no_plan_stabilizes_the_model(backend):
    """Long periods, long horizons, on the way through the ignition: the hardest corner."""
    hottest = sorted(VISITED, key=lambda s: abs(s[0][0] - 341.0))[:6]
    thetas = itertools.product((1.25, 1.5), (18, 33, 40), (-5.0, -0.91, 3.0))
    check([(t, s) for i, t in enumerate(thetas) for s in hottest[i % 3 :: 3]], backend)


@pytest.mark.campaign
@pytest.mark.parametrize("backend", BACKENDS)
def test_campaign_the_move_is_right_over_the_whole_grid(backend):
    check(grid(36), backend)
