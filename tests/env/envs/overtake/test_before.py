"""The paper's scene is what it was before it was put on highway-env's road.

`before.npz` holds two drives of the plain environment of then: inputs, and every ninth instant.
"""

from pathlib import Path

import numpy as np
import pytest

from prefcal_env.envs.closed_loop import rollout
from prefcal_env.envs.overtake import Course
from prefcal_scenarios.cases.overtake import compute_kpis
from prefcal_scenarios.cases.overtake.controller import STEERING_LIMITS, controller

BEFORE = np.load(Path(__file__).parent / "before.npz")
NAMES = ("paper_step", "slow_step")


@pytest.mark.parametrize("name", NAMES)
def test_the_same_inputs_drive_the_same_way(name):
    driven = Course()
    driven.reset(options={"T_s": BEFORE[f"{name}.theta"][0]})
    for u in BEFORE[f"{name}.u_control"]:
        driven.apply(u)
    record = driven.record()
    for what, now in [("t", record.t), ("x", record.x), *record.signals.items()]:
        if f"{name}.{what}" in BEFORE:
            np.testing.assert_allclose(now[::9], BEFORE[f"{name}.{what}"], rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_an_experiment_has_the_same_indicators(name):
    theta = BEFORE[f"{name}.theta"]
    driver = controller(theta, STEERING_LIMITS["per step"])
    e = rollout(Course(), driver, theta, kpis=compute_kpis)
    np.testing.assert_allclose(list(e.kpis.values()), BEFORE[f"{name}.kpis"], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(e.x[::9], BEFORE[f"{name}.x"], rtol=0, atol=1e-9)
