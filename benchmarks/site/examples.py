"""Draw the pictures of gallery pages whose own code saves them."""

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

PAGES: Mapping[str, tuple[str, str, str]] = {
    "reactor": ("reactor.png", "gallery_reactor.png",
                "{'index before': cstr.cost(first), 'index after': cstr.cost(best)}"),
    "overtaking": ("overtaking.png", "gallery_overtaking.png",
                   "{'T_s of the best': float(agent.best[0])}"),
    "pid": ("pid.png", "gallery_pid.png",
            "{'recovery': heater.run(found.best).kpis['recovery']}"),
    "servo": ("servo.png", "gallery_servo.png", "{'settling time': best.kpis['settling_time']}"),
    "cart-pole": ("cart_pole.png", "gallery_cart_pole.png",
                  "{'integrated error': best.kpis['error']}"),
    "fmu": ("fmu.png", "gallery_fmu.png",
            "{'integrated error': loop(found.best).kpis['integrated error of level']}"),
    "opc-ua": ("opc_ua.png", "gallery_opc_ua.png", "{'restored': int(fast.restored)}"),
    "own-agent": ("own_agent.png", "gallery_own_agent.png",
                  "{'gap of StepSearch': float(after['StepSearch'])}"),
    "benchmark": ("small/gaps.png", "gallery_benchmark.png", "{'rows': len(table)}"),
    "reinforcement-learning": ("rl.png", "gallery_rl.png",
                               "{'index of PPO': float(after['PPO'])}"),
}  # fmt: skip
"""Of each page: the file that its code saves, the figure, and the numbers to keep."""
FIGURES = tuple(figure for _, figure, _ in PAGES.values())
_BLOCK = re.compile(r"(<!-- not executed:[^>]*-->\s*)?^```(python|console)\n(.*?)^```", re.M | re.S)
_FIRST = re.compile(r"^<!-- run first: ([\w.]+) -->", re.M)
_COMMAND = "from prefcal_bench.cli.program import main; main()"


def examples(docs: Path, folder: Path) -> tuple[dict[str, bytes], Mapping[str, float]]:
    """Run the code of every page, and return the pictures and the numbers to keep.

    Args:
        docs: Folder of the documentation.
        folder: Empty folder for the files that the pages make.
    """
    pictures, story = {}, {}
    for page, (saved, figure, expression) in PAGES.items():
        place = folder / page
        place.mkdir()
        for path in docs.glob("*.py"):
            shutil.copy(path, place)  # a reader has them at hand
        for name, value in _run(docs / "gallery" / f"{page}.md", place, expression).items():
            story[f"{page}: {name}"] = value
        pictures[figure] = (place / saved).read_bytes()
    return pictures, story


def _run(page: Path, place: Path, expression: str) -> dict[str, float]:
    """Run what a page shows in the folder `place`; return the value of `expression` after it."""
    text = page.read_text("utf-8")
    blocks = [(kind, code) for skipped, kind, code in _BLOCK.findall(text) if not skipped]
    codes = [code for kind, code in blocks if kind == "python"]
    for code in codes:
        for name in re.findall(r"\A# (\w+\.py)\n", code):
            (place / name).write_text(code, "utf-8")
    for script in _FIRST.findall(text):
        _python(place, script)
    lines = [line for kind, shown in blocks if kind == "console" for line in shown.splitlines()]
    for line in lines:
        if line.startswith("$ prefcal bench "):
            _python(place, "-c", _COMMAND, *line.split()[2:])
    told = f"import json, pathlib\npathlib.Path('told.json').write_text(json.dumps({expression}))"
    _python(place, "-c", "\n".join(["import sys; sys.path.insert(0, '')", *codes, told]))
    found: dict[str, float] = json.loads((place / "told.json").read_text("utf-8"))
    return found


def _python(place: Path, *words: str) -> None:
    path = os.pathsep.join(entry or "." for entry in sys.path)
    subprocess.run([sys.executable, *words], cwd=place, check=True, stdout=subprocess.DEVNULL,
                   stderr=subprocess.DEVNULL, env=os.environ | {"PYTHONPATH": path})  # fmt: skip
