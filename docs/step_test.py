"""A heated tank whose valve is stepped by hand: write the record, and see what it tells of the tank.

Your own record replaces the first half.
"""

from pathlib import Path

import numpy as np
from scipy.signal import lsim

from prefcal_env.plants.identify import identify, interval
from prefcal_scenarios.described.identified import step_test

# --- What a historian would export: a step of the valve and half of it back, noise, two digits.

t = np.arange(0.0, 600.0)
valve = np.where(t < 60, 40.0, np.where(t < 350, 46.0, 43.0))
late = np.interp(t - 7.0, t, valve - 40.0)  # dead time
_, rise, _ = lsim(([1.8], [540.0, 57.0, 1.0]), late, t)
noise = 0.08 * np.random.default_rng(3).standard_normal(len(t))
rows = zip(t, valve, 52 + rise + noise, strict=True)
lines = ["time [s],valve [%],temperature [°C]", *(f"{a:g},{b:g},{c:.2f}" for a, b, c in rows)]
Path("step.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")

# --- What the record tells.

record = step_test(Path("step.csv"))
found = identify(record.t, record.u, record.y)
print(found.reason)
for name, value in found.models[found.best].numbers.items():
    low, high, _ = interval(found.models, name)
    print(f"{name}: best {value:.3g}, 90 % interval {low:.3g} to {high:.3g}")
