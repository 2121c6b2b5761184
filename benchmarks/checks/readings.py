"""Run the paper's θ with other readings of the paper, for the figures that claims.py computes."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from unittest import mock

import numpy as np

from prefcal_env.envs import cstr as reactor
from prefcal_env.envs.closed_loop import rollout
from prefcal_env.envs.overtake import Course
from prefcal_env.envs.overtake.scene import DrivePhase
from prefcal_env.experiments.experiment import Controller, Experiment, Measurement, Move
from prefcal_env.mpc import LinearMPC, MPCSettings, kernels
from prefcal_env.plants import CSTR
from prefcal_env.plants.cstr import FEED
from prefcal_env.qp import QP, PIQPSolver
from prefcal_scenarios.cases import cstr as cstr_tuning
from prefcal_scenarios.cases.cstr import compute_kpis as cstr_kpis
from prefcal_scenarios.cases.cstr import performance_index
from prefcal_scenarios.cases.overtake import controller as car_tuning
from prefcal_scenarios.cases.overtake.controller import Supervisor
from prefcal_scenarios.cases.overtake.kpis import compute_kpis as car_kpis

AUTOMATED, PREFERRED = (0.25, 26.0, -0.91), (0.31, 26.0, -1.79)
CAR = (0.085, 0.31, 16.0, 0.261, 0.918)  # θ found in the paper
Change = Callable[[MPCSettings], MPCSettings]


def same(settings: MPCSettings) -> MPCSettings:
    return settings


def up_to_last_but_one(settings: MPCSettings) -> MPCSettings:
    """Weigh y_0 ... y_Np-1: without D this is a horizon one step shorter with the same inputs.

    The soft limits of the car's last step are dropped, too.
    """
    N_p = settings.N_p - 1
    return replace(settings, N_p=N_p, N_u=min(settings.N_u, N_p))


def one_more(settings: MPCSettings) -> MPCSettings:
    """Leave u_Nu free as well, as the last line of eq. MPC_constraints reads."""
    return replace(settings, N_u=min(settings.N_u + 1, settings.N_p))


def react(theta: Sequence[float], change: Change = same, base: float = 10.0) -> Experiment:
    """Run one experiment of the reactor."""
    T_s, N_p, log_Q = theta
    at = np.array([T_s, N_p, log_Q * np.log10(base)])
    driver: Controller = LinearMPC(CSTR(), change(cstr_tuning.mpc_settings(at)))
    return rollout(reactor.cstr_env(), driver, np.array(theta), kpis=cstr_kpis)


def index(theta: Sequence[float], change: Change = same, base: float = 10.0) -> float:
    return performance_index(react(theta, change, base))


def drive(
    theta: Sequence[float],
    change: Change = same,
    fixed: car_tuning.Fixed = car_tuning.PAPER,
    base: float = 10.0,
) -> Experiment:
    """Run one overtaking."""
    at = np.array(theta, dtype=float)
    at[3:] *= np.log10(base)
    driver = Supervisor({p: change(car_tuning.mpc_settings(at, p, fixed)) for p in DrivePhase})
    return rollout(Course(), driver, np.array(theta, dtype=float), kpis=car_kpis)


def first_unlimited(mpc: LinearMPC, m: Measurement) -> Move:
    """Decide within the limits of k = 1 ... N_p, as printed: only the plant limits the first input.

    In place of `LinearMPC.move`.
    """
    n_u = len(m.u)
    _, _, _, U, G, low, high = kernels.decide(*mpc._data(m), *mpc._problem, mpc._solver)
    low[:n_u], high[:n_u] = -np.inf, np.inf
    n = G.shape[1]
    solution = PIQPSolver(mpc.settings.tolerances).solve(QP(np.eye(n), np.zeros(n), G, low, high))
    v = solution.z[: U.shape[2] - 1]
    return Move(m.u + U[0] @ np.append(v, 1.0), solution.iterations, solution.solved)


def heat() -> list[float]:
    """Return C_A of the steady states at T_c = 298 K, with +H (heats) and then with -H."""
    T, p = np.linspace(250, 450, 200_001), CSTR().params
    k = p.k_0 * np.exp(-p.E / (p.R * T))  # eq. ratelaw
    C_A = FEED[1] / (1 + k)
    dT = p.F_V * (FEED[0] - T) - p.H / p.rho_Cp * k * C_A - p.US_V / p.rho_Cp * (T - 298.0)
    zeros = np.flatnonzero(np.sign(dT[:-1]) != np.sign(dT[1:]))
    return [float(c) for c in (*CSTR().steady_states_at_input(298.0)[:, 1], *C_A[zeros])]


def starts() -> list[float]:
    """Return the index of both θ from C_A = 8.56, then from the steady state at T_c0 = 298 K."""
    there = CSTR().steady_states_at_input(298.0)
    x0, u0 = there[int(np.argmax(there[:, 1]))], np.array([298.0])
    task = replace(reactor.cstr_task(), x0=x0, u0=u0)
    with mock.patch.object(reactor, "cstr_task", return_value=task):
        runs = [react(theta) for theta in (AUTOMATED, PREFERRED)]
    with mock.patch("prefcal_scenarios.cases.cstr._T_C_START", u0):
        moved = [performance_index(run) for run in runs]
    return [index(AUTOMATED), index(PREFERRED), *moved]
