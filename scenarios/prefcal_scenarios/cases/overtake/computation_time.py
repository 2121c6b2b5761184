"""Model t_comp of a car experiment on the paper's laptop: criterion (i) of section IV-B.

The time is computed from the solver's iterations and the size of its problem, so that it is
repeatable. `Experiment.solve_time` is measured and varies from run to run.
"""

import numpy as np
from jaxtyping import Float, Int

from prefcal_env.envs.overtake.rules import Phase
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.mpc import MPCSettings

from .controller import mpc_settings
from .scene import phase_at_control

SLOWER = 268.0
"""How much slower than our server core (x86-64 with AVX-512, 2023) the paper's MATLAB on a laptop
is: so much that the paper's optimum takes the paper's worst t_comp, 0.0808 s."""
_STEP, _ITERATION = 7.5e-5 * SLOWER, 7.5e-6 * SLOWER  # s, whatever the size of the problem
_BUILDING, _SOLVING = 4.9e8 / SLOWER, 2.2e10 / SLOWER  # operations per second
# Measured on that core: 5 to 95 % of the steps took 0.9 to 1.15 of the modeled time. How the
# paper's time splits up is not known; the shares are those of the core.

N_X, N_U, N_Y = 3, 2, 3
"""Numbers of states, inputs and outputs of the bicycle."""
_PRODUCTS = 20
"""Matrix products in one exact discretization: the series and some squarings."""


def problem_size(settings: MPCSettings) -> tuple[int, int]:
    """Return the numbers of variables and rows of the QP, including its slack."""
    assert settings.y_min is not None
    assert settings.y_max is not None
    limited = int(np.isfinite([*settings.y_min, *settings.y_max]).sum())
    return settings.N_u * N_U + 1, (2 * settings.N_u - 1) * N_U + limited * settings.N_p + 1


def building(settings: MPCSettings) -> float:
    """Return the number of operations to build the QP and to check its solution.

    This counts the discretization, the backward recursion of every stage, the prediction of states
    and limited outputs as functions of the variables, and three products with the rows in the
    check.
    """
    n_s, (n, m) = N_X + N_U, problem_size(settings)
    discretizing = _PRODUCTS * 2 * (n_s + 1) ** 3
    stage = 2 * (n_s + N_Y + 2 * N_U) * (n_s + N_U) * (n_s + N_U + 1)
    predicted = 2 * N_X * n_s * (n + 1) + 2 * N_Y * n_s * (n + 1)
    return float(discretizing + settings.N_p * (stage + predicted) + 6 * m * n + 4 * n**2)


def iterating(settings: MPCSettings) -> float:
    """Return the number of operations in one iteration of an interior-point solver.

    This counts forming and factorizing its normal matrix, and two solves with their products.
    """
    n, m = problem_size(settings)
    return float(m * n**2 + n**3 / 3 + 8 * m * n + 4 * n**2)


def step_times(settings: MPCSettings, iterations: Int[np.ndarray, " N"]) -> Float[np.ndarray, " N"]:
    """Return the computation time of steps with these solver iterations [s], shape (N,)."""
    once = _STEP + building(settings) / _BUILDING
    return np.asarray(once + iterations * (_ITERATION + iterating(settings) / _SOLVING))


def t_comp(experiment: Experiment) -> Float[np.ndarray, " N"]:
    """Return the modeled computation time of each control step [s], shape (N,)."""
    phases = phase_at_control(experiment)
    seconds = np.zeros(len(phases))
    for phase in Phase:
        here = phases == phase
        settings = mpc_settings(experiment.theta, phase)
        seconds[here] = step_times(settings, experiment.iterations[here])
    return seconds


def overrun(experiment: Experiment) -> float:
    """Return the share by which the worst t_comp exceeds T_s; 0 if the MPC runs in real time."""
    ratio = float(t_comp(experiment).max()) / float(experiment.theta[0])
    return max(ratio - 1.0, 0.0)
