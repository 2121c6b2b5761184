"""The dense grid does not depend on the sampling time, and no instant comes twice."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefcal_env.experiments.experiment import instants


@given(k=st.integers(0, 500), T_s=st.floats(0.01, 6.0), step=st.sampled_from([0.05, 0.1, 1 / 3]))
def test_instants_are_the_grid_and_the_end(k, T_s, step):
    start, end = k * T_s, (k + 1) * T_s
    t = instants(start, end, step)
    assert (t[0], t[-1]) == (start, end)
    assert np.all(np.diff(t) > 1e-10 * step)
    assert t[1:-1] == pytest.approx(np.round(t[1:-1] / step) * step, rel=1e-12)
    inside = [i * step for i in range(int(start / step), int(end / step) + 2)]
    close = 1e-6 * step
    expected = [g for g in inside if start + close < g < end - close]
    assert len(t) - 2 == len(expected)


@pytest.mark.parametrize("T_s", [0.25, 0.05, 0.1, 0.3, 1.5])
def test_sampling_instants_on_the_grid_come_once(T_s):
    steps = [instants(k * T_s, (k + 1) * T_s, 0.05)[1:] for k in range(40)]
    t = np.concatenate(steps)
    assert t == pytest.approx(np.arange(1, len(t) + 1) * 0.05)
