"""KPIs of a closed loop, on curves whose values are known."""

import numpy as np
import pytest

from prefcal_env.experiments.experiment import Channel, Channels, End
from prefcal_scenarios.cases.loops.loop import compute_kpis
from support.short_runs import short_run

CHANNELS = Channels(
    (Channel("level", "m"), Channel("flow")), (Channel("valve", "%"),), (Channel("level", "m"),)
)


def kpis(level, valve, *, disturbed_at=4.0, flow=None, beside=None):
    n = len(valve)
    flow = np.zeros(n + 1) if flow is None else np.array(flow)
    u = np.array(valve, dtype=float)[:, None]
    run = short_run(
        [1.0],
        t=np.arange(n + 1.0),
        x=np.column_stack([level, flow]),
        u=np.vstack([u, u[-1:]]),
        t_control=np.arange(float(n)),
        u_control=u,
        y_ref=np.full((n, 1), 2.0),
        iterations=np.zeros(n, dtype=int),
        solve_time=np.zeros(n),
        solved=np.ones(n, dtype=bool),
        channels=CHANNELS,
        end=End.TIME_UP,
    )
    return compute_kpis(run, disturbed_at, 50.0, beside)


def test_each_kpi_is_what_its_sentence_says():
    found = kpis([1, 2.2, 1.98, 2.0, 2.0, 1.5, 2.0], [50, 53, 54, 54, 54, 50])
    assert found["overshoot"] == pytest.approx(20.0)
    assert found["settling_time"] == 2.0
    assert found["error"] == pytest.approx(1 + 0.2 + 0.02 + 0.5)
    assert found["disturbance_peak"] == pytest.approx(0.5)
    assert found["effort"] == pytest.approx(np.sqrt((9 + 3 * 16) / 6))
    assert found["input_noise"] == pytest.approx(8 / 5)  # mean of 3, 1, 0, 0, 4
    assert found["switches"] == 3


def test_an_output_that_is_outside_at_the_disturbance_has_never_settled():
    assert kpis([1, 1.5, 2, 1.5, 2, 2, 2], [50] * 6)["settling_time"] == np.inf


def test_a_run_that_stopped_before_the_disturbance_has_no_finite_peak():
    found = kpis([1, 2.0, 2.0], [50, 50])
    assert found["settling_time"] == np.inf
    assert found["disturbance_peak"] == np.inf


def test_the_side_effect_counts_from_the_start_to_the_disturbance():
    found = kpis([1, 2, 2, 2, 2], [50] * 4, flow=[3, 3.5, 1, 3, 9], beside=1)
    assert found["side_effect"] == 2.0
