"""Cars that the MPC does not know: highway-env's own bicycle, and one with tyres."""

from math import atan, cos, tan

import numpy as np
import pytest

from prefcal_env.errors import PlantError
from prefcal_env.plants.bicycle import Bicycle
from prefcal_env.plants.cars import DynamicParams, SlipParams, dynamic_bicycle, slip_bicycle

NONE = np.zeros(0)


@pytest.mark.parametrize("steering", [-0.5, 0.02, 0.7])
def test_the_slip_bicycle_is_that_of_highway_env(steering):
    kinematics = pytest.importorskip("highway_env.vehicle.kinematics")
    car = kinematics.Vehicle(None, [-2.25, 0.0], speed=14.0)
    car.LENGTH = 4.5
    n, T = 4000, 1.0
    for _ in range(n):  # its Euler steps; v_ref 18 m/s with its controller's lag
        car.act({"steering": steering, "acceleration": (18.0 - car.speed) / 0.6})
        car.step(T / n)
    front = car.position + 2.25 * np.array([np.cos(car.heading), np.sin(car.heading)])
    x = np.array([0.0, 0.0, 0.0, 14.0])
    ours = slip_bicycle().hold(x, np.array([18.0, steering]), NONE, np.array([T]))[0]
    assert ours == pytest.approx([*front, car.heading, car.speed], abs=0.01)


def test_the_slip_bicycle_runs_along_the_circles_of_the_kinematic_one():
    v, steering, t = 14.0, 0.4, np.array([0.3, 1.0])
    slip = slip_bicycle().hold(np.array([0.0, 0.0, 0.0, v]), np.array([v, steering]), NONE, t)
    front = v * cos(atan(tan(steering) / 2)) / cos(steering)
    exact = Bicycle().hold(np.zeros(3), np.array([front, steering]), NONE, t)
    assert slip[:, :3] == pytest.approx(exact, abs=1e-6)


def test_with_stiff_tyres_the_dynamic_bicycle_does_not_slip():
    u, t = np.array([14.0, 0.02]), np.array([1.0, 3.0])
    stiff = DynamicParams(front_stiffness=8e5, rear_stiffness=8e5)
    x = dynamic_bicycle(stiff).hold(np.array([0.0, 0.0, 0.0, 14.0, 0.0, 0.0]), u, NONE, t)
    # it needs a moment to begin to turn, and its v is that of the center of mass
    assert x[:, 2] == pytest.approx(Bicycle().hold(np.zeros(3), u, NONE, t)[:, 2], rel=0.05)


def test_a_neutral_car_turns_at_the_rate_of_its_geometry():
    # equal axles and tyres: r = v δ / L at any speed, for small angles
    x = np.array([0.0, 0.0, 0.0, 14.0, 0.0, 0.0])
    end = dynamic_bicycle().hold(x, np.array([14.0, 0.01]), NONE, np.array([5.0]))[0]
    assert end[5] == pytest.approx(14.0 * 0.01 / 4.5, rel=1e-3)


def test_the_speed_lags_behind_its_reference():
    for plant, lag in ((slip_bicycle(), 0.6), (dynamic_bicycle(), 0.3)):
        x = np.zeros(len(plant.states))
        x[3] = 14.0
        end = plant.hold(x, np.array([18.0, 0.0]), NONE, np.array([lag]))[0]
        assert end[3] == pytest.approx(18 - 4 / np.e, abs=1e-4)


def test_the_outputs_are_the_pose():
    for plant in (slip_bicycle(), dynamic_bicycle()):
        x = np.arange(float(len(plant.states)))
        assert plant.g(x, np.zeros(2), NONE).tolist() == [0, 1, 2]


@pytest.mark.parametrize("bad", [0.0, -1.0, np.inf, np.nan])
def test_impossible_parameters_are_refused(bad):
    with pytest.raises(PlantError, match="lag"):
        SlipParams(lag=bad)
    with pytest.raises(PlantError, match="mass"):
        DynamicParams(mass=bad)
