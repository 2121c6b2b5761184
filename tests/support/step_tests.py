"""A record of a step test, simulated by scipy, as a table."""

import numpy as np
from scipy import signal

ROWS = 200
T = np.arange(ROWS, dtype=float)
U = np.where(T < 20, 40.0, 46.0)
GAIN, LAG, DELAY, NOISE = 1.8, 20.0, 5, 0.05


def response(seed=1):
    """The output of a lag with dead time, at 52 before the step."""
    num, den, _ = signal.cont2discrete(([GAIN], [LAG, 1.0]), 1.0, "zoh")
    late = np.concatenate([np.zeros(DELAY), U - 40])[:ROWS]
    return (
        52
        + signal.lfilter(np.ravel(num), den, late)
        + NOISE * np.random.default_rng(seed).standard_normal(ROWS)
    )


def table(*headings, columns=()):
    """The columns as CSV: time, valve and temperature if none are given."""
    rows = (",".join(f"{v:g}" for v in row) for row in zip(*(columns or (T, U, response())), strict=True))
    return "\n".join([",".join(headings or ("time [s]", "valve [%]", "temperature [°C]")), *rows]) + "\n"
