"""Linear systems of python-control are plants and controllers."""

import pickle

import numpy as np
import pytest

from prefcal_env import LTILoop, Plant
from support.held import A, B, C, D, Held, driven

control = pytest.importorskip("control")


def test_transfer_functions_step_as_python_control_says():
    entry = [[[2.0], [1.0, 3.0]], [[1.0], [4.0]]], [[[3.0, 1.0], [1.0, 2.0, 5.0]], [[1, 1], [1, 2]]]
    plant = Plant.of(control.tf(*entry))
    run = driven(plant, Held([1.0, 1.0], 0.4))
    for i in range(2):
        y = sum(control.step_response(control.tf(entry[0][i][j], entry[1][i][j]), run.t)[1] for j in range(2))
        assert run.y[:, i] == pytest.approx(y, abs=1e-9)


def test_names_come_from_python_control_and_a_plant_survives_pickling():
    named = control.ss(A, B, C, D, inputs=["a", "b"], outputs=["c", "d"], states=["e", "f"])
    plant = pickle.loads(pickle.dumps(Plant.of(named)))
    found = [[c.name for c in cs] for cs in (plant.inputs, plant.outputs, plant.states)]
    assert found == [["a", "b"], ["c", "d"], ["e", "f"]]
    assert [c.name for c in Plant.of(control.ss(A, B, C, D)).inputs] == ["u1", "u2"]


def test_a_discrete_loop_is_that_of_python_control():
    plant, law = control.tf([0.2], [1, -0.8], 0.1), control.tf([1.0, -0.7], [1, -1], 0.1)
    run = LTILoop(plant, lambda theta: theta[0] * law, horizon=5.0)([1.5])
    t, y = control.step_response(control.feedback(1.5 * law * plant), np.arange(50) * 0.1)
    at = np.searchsorted(run.t, t - 1e-9)
    assert run.y[at, 0] == pytest.approx(y, abs=1e-9)
