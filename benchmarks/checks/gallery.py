"""Draw two experiments of each model in the gallery, from the code that its page shows."""

import re
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from prefcal_app.looking import look
from prefcal_scenarios import load

Story = Mapping[str, float]
_FIRST = re.compile(r"^<!-- run first: ([\w.]+) -->", re.M)
_FILE = re.compile(r"^```python\n(# (\w+\.py)\n.*?)^```", re.M | re.S)

MODELS: Mapping[str, tuple[str, str, str, tuple[tuple[float, float], tuple[float, float]]]] = {
    "python-control": (
        "gallery/linear-systems.md",
        "gallery_python_control.png",
        "heater.py:scenario",
        ((0.6, 6), (1.2, 14)),
    ),
    "scipy": ("gallery/linear-systems.md", "gallery_scipy.png", "servo.py:scenario", ((2, 0.6), (9, 0.94))),
    "casadi": (
        "gallery/casadi.md",
        "gallery_casadi.png",
        "pendulum.py:scenario",
        ((0.003, 0.001), (0.3, 0.1)),
    ),
    "do-mpc": ("gallery/do-mpc.md", "gallery_do_mpc.png", "tank.py:scenario", ((0.1, 10), (5, 4))),
    "quadruple-tank": (
        "mpc.md",
        "gallery_quadruple_tank.png",
        "quadruple_tank.py:tanks",
        ((10, 0.05), (30, 5)),
    ),
    "simulink": (
        "fmu.md",
        "gallery_simulink.png",
        'Tank.fmu {"knobs": {"K_p": "0.1:100:log", "T_i": "1:60 s"}, '
        '"show": ["level", "valve"], "reference": {"level": 2}}',
        ((1, 4), (8, 20)),
    ),
}
"""Page of each model, its figure and scenario, and the two θ to draw, in physical units."""
FIGURES = tuple(file for _, file, _, _ in MODELS.values())


def gallery(docs: Path, folder: Path) -> tuple[dict[str, bytes], Story]:
    """Draw every model; return the figures and the KPIs to keep.

    Args:
        docs: Folder of the documentation.
        folder: Empty folder for the files that the pages show.
    """
    pictures: dict[str, bytes] = {}
    story: dict[str, float] = {}
    sys.path.insert(0, str(folder))  # a file of a page may import another one
    try:
        for model, (page, picture, source, thetas) in MODELS.items():
            text = (docs / page).read_text("utf-8")
            for content, name in _FILE.findall(text):
                (folder / name).write_text(content, "utf-8")
            for script in _FIRST.findall(text):
                subprocess.run(
                    [sys.executable, docs / script], cwd=folder, check=True, stdout=subprocess.DEVNULL
                )
            scenario = load(f"{folder}/{source}")
            runs = [scenario.run(np.array(theta, dtype=float)) for theta in thetas]
            names = [
                ", ".join(f"{k.name} = {v:g}" for k, v in zip(scenario.space.knobs, t, strict=True))
                for t in thetas
            ]
            pictures[picture] = look(*runs, names=(names[0], names[1])).png()
            for side, run in zip(("left", "right"), runs, strict=True):
                # Not the settling time, which is infinite or jumps: this one changes smoothly.
                kpi = next(k.name for k in scenario.kpis if k.name.startswith("integrated error"))
                story[f"{model}: {kpi}, {side}"] = float(run.kpis[kpi])
    finally:
        sys.path.remove(str(folder))
    return pictures, story
