"""Draw the pictures of the gallery: what examples save, and two experiments of each model."""

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from prefcal_app.looking import look
from prefcal_scenarios import load

EXAMPLES: Mapping[str, tuple[str, str, str, str]] = {
    "reactor": (
        "gallery/reactor.md",
        "reactor.png",
        "gallery_reactor.png",
        "{'index before': cstr.cost(first), 'index after': cstr.cost(best)}",
    ),
    "overtaking": (
        "overtaking.md#In Python",
        "overtaking.png",
        "gallery_overtaking.png",
        "{'T_s of the best': float(agent.best[0])}",
    ),
    "pid": (
        "pid.md#A PID for a heater",
        "pid.png",
        "gallery_pid.png",
        "{'recovery': heater.run(found.best).kpis['recovery']}",
    ),
    "step-test": (
        "step_test.md",
        "step.png",
        "gallery_step_test.png",
        "{'models': len(json.loads(pathlib.Path('step.plant.json').read_text('utf-8'))['models'])}",
    ),
    "servo": (
        "loops.md#Tune the servo drive",
        "servo.png",
        "gallery_servo.png",
        "{'settling time': best.kpis['settling_time']}",
    ),
    "cart-pole": (
        "loops.md#Tune the pole on a cart",
        "cart_pole.png",
        "gallery_cart_pole.png",
        "{'integrated error': best.kpis['error']}",
    ),
    "fmu": (
        "fmu.md#In Python",
        "fmu.png",
        "gallery_fmu.png",
        "{'integrated error': loop(found.best).kpis['integrated error of level']}",
    ),
    "opc-ua": ("live.md#In Python", "opc_ua.png", "gallery_opc_ua.png", "{'restored': int(fast.restored)}"),
    "own-agent": (
        "own_agent.md#In Python",
        "own_agent.png",
        "gallery_own_agent.png",
        "{'gap of StepSearch': float(after['StepSearch'])}",
    ),
    "benchmark": (
        "benchmarks.md#A small benchmark",
        "small/gap-experiments.png",
        "gallery_benchmark.png",
        "{'rows': len(table)}",
    ),
    "reinforcement-learning": (
        "gallery/reinforcement-learning.md",
        "rl.png",
        "gallery_rl.png",
        "{'index of PPO': float(after['PPO'])}",
    ),
}
"""Of each example: its page and section, the file that it saves, the figure, numbers to keep."""
SAVED = tuple(figure for _, _, figure, _ in EXAMPLES.values())  # figures that the code of examples saves
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
DRAWN = tuple(figure for _, figure, _, _ in MODELS.values())  # figures of two experiments of a model
Gallery = tuple[dict[str, bytes], Mapping[str, float]]  # pictures by file, and the numbers to keep
_BLOCK = re.compile(r"(<!-- not executed:[^>]*-->\s*)?^```(python|console)\n(.*?)^```", re.M | re.S)
_FIRST = re.compile(r"^<!-- run first: ([\w.]+) -->", re.M)
_COMMAND = "from prefcal_app.cli import main; main()"


def examples(docs: Path, folder: Path) -> Gallery:
    """Run the code of every example, and return the pictures and the numbers to keep.

    `folder` is empty, for the files that the examples make.
    """
    pictures, story = {}, {}
    for example, (source, saved, figure, expression) in EXAMPLES.items():
        place = folder / example
        place.mkdir()
        for path in docs.glob("*.py"):
            shutil.copy(path, place)  # a reader has them at hand
        page, _, heading = source.partition("#")
        for name, value in _run(docs / page, heading, place, expression).items():
            story[f"{example}: {name}"] = value
        pictures[figure] = (place / saved).read_bytes()
    return pictures, story


def models(docs: Path, folder: Path) -> Gallery:
    """Draw two experiments of every model, from the code that its page shows; see `examples`."""
    pictures: dict[str, bytes] = {}
    story: dict[str, float] = {}
    sys.path.insert(0, str(folder))  # a file of a page may import another one
    try:
        for model, (page, picture, source, thetas) in MODELS.items():
            _write_files(docs / page, folder, docs)
            scenario = load(f"{folder}/{source}")
            runs = [scenario.run(np.array(theta, dtype=float)) for theta in thetas]
            named = ([*zip(scenario.space.knobs, theta, strict=True)] for theta in thetas)
            left, right = (", ".join(f"{k.name} = {v:g}" for k, v in knobs) for knobs in named)
            pictures[picture] = look(*runs, names=(left, right)).png()
            for side, run in zip(("left", "right"), runs, strict=True):
                # Not the settling time, which is infinite or jumps: this one changes smoothly.
                kpi = next(k.name for k in scenario.kpis if k.name.startswith("integrated error"))
                story[f"{model}: {kpi}, {side}"] = float(run.kpis[kpi])
    finally:
        sys.path.remove(str(folder))
    return pictures, story


def _write_files(page: Path, place: Path, scripts: Path) -> None:
    """Write the files that a page shows into a folder, and run there what it says to run first."""
    text = page.read_text("utf-8")
    for code in _blocks(text, "python"):
        for name in re.findall(r"\A# (\w+\.py)\n", code):
            (place / name).write_text(code, "utf-8")
    for script in _FIRST.findall(text):
        _python(place, str(scripts / script))


def _blocks(text: str, kind: str) -> list[str]:
    """Return the code of a kind that is executed."""
    return [code for skipped, found, code in _BLOCK.findall(text) if found == kind and not skipped]


def _run(page: Path, heading: str, place: Path, expression: str) -> dict[str, float]:
    """Run what a section shows in the folder `place`; return the value of `expression` after it.

    Without a heading it is the whole page. The files that a page shows are there for each section.
    """
    whole = page.read_text("utf-8")
    text = whole.split(f"\n## {heading}\n", 1)[1].split("\n## ", 1)[0] if heading else whole
    _write_files(page, place, place)
    for line in "".join(_blocks(text, "console")).splitlines():
        if line.startswith(("$ prefcal bench ", "$ prefcal identify ")):
            _python(place, "-c", _COMMAND, *line.split()[2:])
    told = f"import json, pathlib\npathlib.Path('told.json').write_text(json.dumps({expression}))"
    codes = ["import sys; sys.path.insert(0, '')", *_blocks(text, "python"), told]
    _python(place, "-c", "\n".join(codes))
    found: dict[str, float] = json.loads((place / "told.json").read_text("utf-8"))
    return found


def _python(place: Path, *words: str) -> None:
    path = os.pathsep.join(entry or "." for entry in sys.path)
    subprocess.run(
        [sys.executable, *words],
        cwd=place,
        check=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=os.environ | {"PYTHONPATH": path},
    )
