"""The model of a step's computation time."""

from dataclasses import replace

import numpy as np
import pytest

from prefcal_env.errors import SettingsError
from prefcal_env.experiments.control import Measurement
from prefcal_env.mpc import LinearMPC, MPCSettings
from prefcal_env.mpc.computation import Processor, StepSize
from prefcal_env.plants.bicycle import Bicycle

CAR = MPCSettings(
    T_s=0.1, N_p=12, N_u=5, Q_y=np.eye(3), Q_du=np.eye(2),
    y_min=[-np.inf, 3.0, -1.0], y_max=[np.inf, np.inf, 1.0],
)  # fmt: skip
SLOW = Processor("slow", step=2.0, iteration=0.5, building=1e3, solving=1e4)


@pytest.mark.parametrize(
    "change", [{}, {"y_min": None, "y_max": None}, {"N_u": 12}, {"linearization": "trajectory"}]
)
def test_sizes_are_those_of_the_problem_that_the_mpc_solves(change):
    settings = replace(CAR, **change)
    m = Measurement(0.0, np.zeros(3), np.array([13.0, 0.0]), np.zeros(0), np.zeros(3))
    qp = next(LinearMPC(Bicycle(), settings).problems(m))
    size = StepSize.of(Bicycle(), settings)
    assert (size.rows, size.variables) == qp.G.shape
    assert size.models == (12 if settings.linearization == "trajectory" else 1)


def test_the_time_by_hand():
    size = StepSize.of(Bicycle(), CAR)
    n, m = 11, 18 + 36 + 1
    assert (size.variables, size.rows) == (n, m)
    assert size.iterating == pytest.approx(m * n**2 + n**3 / 3 + 8 * m * n + 4 * n**2)
    seconds = SLOW.t_comp(size, np.array([0, 7]))
    assert seconds[0] == pytest.approx(2.0 + size.building / 1e3)
    assert seconds[1] - seconds[0] == pytest.approx(7 * (0.5 + size.iterating / 1e4))


@pytest.mark.parametrize("change", [{"N_u": 6}, {"N_p": 13}, {"linearization": "trajectory"}])
def test_more_of_anything_takes_longer(change):
    one, other = (StepSize.of(Bicycle(), s) for s in (CAR, replace(CAR, **change)))
    assert SLOW.t_comp(other, np.array([9])) > SLOW.t_comp(one, np.array([9]))


def test_a_slower_processor_takes_so_many_times_as_long():
    size, iterations = StepSize.of(Bicycle(), CAR), np.array([5, 12])
    slower = SLOW.slower(3.0, "slower")
    assert slower.name == "slower"
    np.testing.assert_allclose(slower.t_comp(size, iterations), 3 * SLOW.t_comp(size, iterations))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"step": -1.0}, "'slow': step must be 0 s or more"),
        ({"iteration": np.nan}, "iteration must be 0 s or more"),
        ({"solving": 0.0}, "solving must be positive"),
        ({"building": np.nan}, "building must be positive"),
    ],
)
def test_an_impossible_processor_is_refused(change, message):
    with pytest.raises(SettingsError, match=message):
        replace(SLOW, **change)


@pytest.mark.parametrize("factor", [0.0, -1.0, np.inf, np.nan])
def test_an_impossible_factor_is_refused(factor):
    with pytest.raises(SettingsError, match="factor must be positive"):
        SLOW.slower(factor, "none")
