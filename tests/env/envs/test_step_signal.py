"""Signals that step: alone and over many times."""

import numpy as np

from prefcal_env.envs.task import StepSignal


def test_each_value_holds_from_its_time_on():
    signal = StepSignal((0.0, 1.0), ((2.0, (3.0, 4.0)), (5.0, (-1.0, 1.0))))
    t = np.array([0.0, 1.9, 2.0, 4.9, 5.0, 9.0])
    wanted = [[0, 1], [0, 1], [3, 4], [3, 4], [-1, 1], [-1, 1]]
    assert signal.over(t).tolist() == [signal(at).tolist() for at in t] == wanted
