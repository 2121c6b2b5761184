"""Time and error of simulating the reactor for one sampling period.

python benchmarks/speed/integrator.py
"""

import time

import numpy as np
from scipy.integrate import solve_ivp

from prefcal_env.plants.cstr import CSTR, FEED

CASES = (
    (311.0, 8.5, 298.0, 0.25), (345.0, 5.0, 305.0, 1.5),
    (356.0, 9.0, 310.0, 0.25), (400.0, 9.95, 310.0, 0.05),
)  # fmt: skip


def main() -> None:
    plant, repeats = CSTR(), 1000
    for T, C_A, T_c, T_s in CASES:
        x, u = np.array([T, C_A]), np.array([T_c])
        times = np.append(np.arange(0.05, T_s - 1e-9, 0.05), T_s)
        ours = plant.hold(x, u, FEED, times)[-1]
        start = time.process_time()
        for _ in range(repeats):
            plant.hold(x, u, FEED, times)
        microseconds = (time.process_time() - start) / repeats * 1e6
        exact = solve_ivp(
            lambda t, x, u=u: plant.f(x, u, FEED), (0, T_s), x, "DOP853", rtol=1e-13, atol=1e-13
        ).y[:, -1]
        error = np.abs(ours / exact - 1).max()
        print(f"from {T:g} K, {T_s:g} h: {microseconds:.1f} µs, relative error {error:.0e}")


if __name__ == "__main__":
    main()
