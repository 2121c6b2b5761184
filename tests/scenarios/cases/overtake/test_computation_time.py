"""The model of a step's computation time on the paper's laptop."""

import numpy as np
import pytest

from prefcal_env.envs.overtake.scene import Phase
from prefcal_env.experiments.experiment import Measurement
from prefcal_env.mpc import LinearMPC
from prefcal_env.plants.bicycle import Bicycle
from prefcal_scenarios.cases.overtake.controller import mpc_settings
from prefcal_scenarios.cases.overtake.kpis import building, iterating, problem_size, step_times

CAR = mpc_settings(np.array([0.1, 0.4, 12, 0.0, 0.0]), Phase.OVERTAKING)


@pytest.mark.parametrize("phase", Phase)
@pytest.mark.parametrize("share", [0.1, 0.4, 1.0])
def test_sizes_are_those_of_the_problem_that_the_mpc_solves(share, phase):
    settings = mpc_settings(np.array([0.1, share, 12, 0.0, 0.0]), phase)
    m = Measurement(0.0, np.zeros(3), np.array([14.0, 0.0]), np.zeros(0), np.zeros(3))
    qp = LinearMPC(Bicycle(), settings).problem(m)
    assert problem_size(settings)[::-1] == qp.G.shape


def test_the_time_by_hand():
    n, m = 11, 18 + 36 + 1
    assert problem_size(CAR) == (n, m)
    assert iterating(CAR) == pytest.approx(m * n**2 + n**3 / 3 + 8 * m * n + 4 * n**2)
    seconds = step_times(CAR, np.array([0, 7]))
    assert seconds[0] == pytest.approx(268 * (7.5e-5 + building(CAR) / 4.9e8))
    each = 268 * (7.5e-6 + iterating(CAR) / 2.2e10)
    assert seconds[1] - seconds[0] == pytest.approx(7 * each)


@pytest.mark.parametrize(("share", "N_p"), [(0.5, 12), (0.4, 13)])
def test_more_of_anything_takes_longer(share, N_p):
    other = mpc_settings(np.array([0.1, share, N_p, 0.0, 0.0]), Phase.OVERTAKING)
    assert step_times(other, np.array([9])) > step_times(CAR, np.array([9]))
