"""Draw the pictures of the README and of docs/, each with the command that its page names.

    python benchmarks/checks/figures.py  # all that need no campaign: two minutes
    python benchmarks/checks/figures.py --only reactor window
    python benchmarks/checks/figures.py --campaigns FOLDER  # those of the benchmark
    python benchmarks/checks/figures.py --check  # for CI: draw into another folder, and compare

The seeds are those of the commands, so a picture changes only with prefcal. The file
`docs/figures/made.json` keeps what the pages state about them (counts, indices). `--check` fails if
that has changed, or if a page shows a figure that nothing here draws. `--list` prints every figure
and the command that draws it.
"""

import argparse
import csv
import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from io import BytesIO
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from algorithm import algorithm
from examples import DRAWN, SAVED, examples, models
from matplotlib.figure import Figure
from measured import measured
from PIL import Image
from reactor_pictures import hole, lowest, rows_of, theta
from rich.console import Console
from screens import calibrating, looking, maneuvers

from prefcal_bench.published.plan import read_published
from prefcal_bench.results import campaign_of
from prefcal_bench.results.pictures import Material, draw_loops, draw_overview
from prefcal_scenarios import load
from prefcal_scenarios.style import png, style

ROOT = Path(__file__).parents[2]
FIGURES, TABLE = ROOT / "docs" / "figures", Path(__file__).parent / "reactor_index.csv"
MADE = "made.json"
Pictures = Mapping[str, bytes]
Story = Mapping[str, float]

CAMPAIGNS = {"benchmark_gaps.png": ("results", "gap-experiments.png", "docs/benchmarks.md")}
"""Campaign folder and file of each figure, and the page with its command."""

REACTOR = ("best_trajectory.png", "course.png", "tried.png")
WORTH = {
    "worth_summary.png": "worth-summary.png",
    "worth_drift.png": "worth-drift.png",
    "worth_experiments.png": "worth-experiments-priorities.png",
    "worth_answers.png": "worth-answers-priorities.png",
}
"""File of each figure of worth on the page of the benchmark."""


def prefcal(*words: str) -> str:
    """Run the command; return its standard output."""
    code = "from prefcal_app.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code, *words],
        check=True,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )
    return done.stdout


def study(scenario: str, folder: Path, *words: str) -> Mapping[str, Any]:
    """Calibrate `scenario` unattended with the default seed; return the result.

    The result is that of `--json`, with the number of "initial" experiments, and the "costs" of all
    by experiment. The report is in `folder`.
    """
    given = ["--study", str(folder / "study.prefcal"), "--out", str(folder), *words]
    result = json.loads(prefcal("calibrate", scenario, "--calibrator", "synthetic", "--json", *given))
    costs: dict[int, float] = {}
    with (folder / "comparisons.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            for side in ("challenger", "incumbent"):
                costs[int(row[f"{side} experiment"])] = float(row[f"{side} cost"] or "nan")
    best = json.loads((folder / "best.json").read_text("utf-8"))
    return {**result, "costs": costs, "initial": int(best["study"]["initial experiments"])}


def reactor(folder: Path) -> tuple[Pictures, Story]:
    """Draw GLISp's study of the reactor: the figures of its report."""
    found = study("cstr", folder, "--agent", "glisp")
    pictures = {name: (folder / name).read_bytes() for name in REACTOR}
    story = {
        "experiments": len(found["costs"]),
        "initial": found["initial"],
        "comparisons": found["questions"],
        "index of the first": found["costs"][1],
        "index of the best": found["cost"],
    }
    return pictures, story


def overtaking(folder: Path) -> tuple[Pictures, Story]:
    """Draw an overtaking: the best run beside the first one."""
    found = study("overtake", folder, "--agent", "glisp")
    story = {"experiments": found["experiments"], "comparisons": found["questions"]}
    return {"overtaking.png": (folder / "overtaking.png").read_bytes()}, story


def reactor_index(folder: Path) -> tuple[Pictures, Story]:
    """Draw the hole of the reactor's index, from the table of best known indices."""
    scenario, rows = load("cstr"), rows_of(TABLE)
    assert scenario.cost is not None
    story = {
        name: float(scenario.cost(scenario.run(theta(lowest(rows[kind])))))
        for kind, name in (("calm", "broad basin"), ("all", "hole"))
    }
    return {"reactor_index.png": drawn(lambda: hole(scenario, TABLE))}, story


def query_window(folder: Path) -> tuple[Pictures, Story]:
    """Film a whole study on the page, answered like by a person who wants to settle soon."""
    found = study("servo", folder, "--cost", "settling_time")
    told = json.loads(prefcal("studies", "show", str(folder / "study.prefcal"), "--json"))
    moving, still, answers = calibrating(folder, [asked["verdict"] for asked in told["questions"]])
    story = {"answers": answers, "settling time before": found["costs"][1], "after": found["cost"]}
    story["overshoot after"] = found["kpis"]["overshoot"]
    return {"calibrating.webp": moving, "query_window.png": still}, story


def worth(folder: Path) -> tuple[Pictures, Story]:
    """Draw the worth on closed loops from the published studies."""
    material = Material(campaign_of((), read_published()))
    shown = [*draw_overview(material), *draw_loops(material)]
    drawn_now = {one.file: one.content for one in shown}
    ends = material.worths[material.worths["unit"] == "experiments"]
    ours = ends[(ends["agent"] == material.baseline) & (ends["after"] == ends["n_max"])]
    story = {f"GLISp, {row.taste}": int(row.worth) for row in ours.itertuples()}
    return {name: drawn_now[file] for name, file in WORTH.items()}, story


PICTURED = {
    "environment_cstr.png": ("CSTR-v0", {}),
    "environment_cstr_tuning.png": ("CSTRTuning-v0", {}),
    "environment_overtake.png": ("Overtake-v0", {"config": {"lanes_count": 3, "vehicles_count": 3}}),
    "environment_overtake_tuning.png": ("OvertakeTuning-v0", {}),
}
"""Environments in docs/environments.md, with their settings."""


def environments(folder: Path) -> tuple[Pictures, Story]:
    """Draw the environments: tuning with the paper's θ, and a plant under its controller."""
    pictures, story = {}, {}
    for file, (name, settings) in PICTURED.items():
        scenario = load(name.removesuffix("-v0").removesuffix("Tuning").lower())
        theta = scenario.references["paper, preferences"]
        env = gym.make(f"prefcal_env:prefcal/{name}", render_mode="rgb_array", **settings)
        env.reset(seed=0, options=None if "Tuning" in name else {"T_s": theta[0]})
        if "Tuning" in name:
            story[name] = float(env.step(2 * scenario.space.encode(theta) - 1)[1])
        else:
            until = 6.5 if name == "Overtake-v0" else np.inf
            story[name] = drive(env.unwrapped, scenario.controller(theta), until)
        buffer = BytesIO()
        Image.fromarray(env.render()).save(buffer, format="PNG", optimize=True)
        pictures[file] = buffer.getvalue()
        env.close()
    return pictures, story


def drive(loop: Any, controller: Any, until: float) -> float:
    """Let `controller` drive until a time or the end; return the time."""
    while loop.end is None and loop.measurement().t < until:
        loop.apply(controller.move(loop.measurement()).u)
    return float(loop.measurement().t)


Maker = Callable[[Path], tuple[Pictures, Story]]
MAKERS: Mapping[str, tuple[Maker, tuple[str, ...]]] = {
    "reactor": (reactor, REACTOR),
    "overtaking": (overtaking, ("overtaking.png",)),
    "examples": (lambda folder: examples(ROOT / "docs", folder), SAVED),
    "environments": (environments, tuple(PICTURED)),
    "index": (reactor_index, ("reactor_index.png",)),
    "window": (query_window, ("calibrating.webp", "query_window.png")),
    "algorithm": (lambda folder: algorithm(), ("learning.png", "simulated.png")),
    "tracking": (lambda folder: measured(), ("tracking.png",)),
    "look": (looking, ("look.png",)),
    "maneuvers": (maneuvers, ("maneuvers.png",)),
    "worth": (worth, tuple(WORTH)),
    "gallery": (lambda folder: models(ROOT / "docs", folder), DRAWN),
}
"""Functions that draw the figures, by name."""
SHOWN = re.compile(r"""(?:\]\(|src(?:set)?=")(?:[\w./]*/)?figures/([\w.-]+)[")]""")
"""How pages show a figure, in Markdown or in HTML."""
UNCHECKED = ("examples",)
"""Too slow for `--check`, unless `--only` names them; the tests of the docs run the examples."""


def drawn(draw: Callable[[], Figure]) -> bytes:
    """Draw a figure as PNG, in the common style."""
    with style():
        return png(draw())


def made_by() -> dict[str, str]:
    """Return every figure and the command that makes it."""
    here = "python benchmarks/checks/figures.py"
    makers = {f: f"{here} --only {name}" for name, (_, files) in MAKERS.items() for f in files}
    campaigns = {
        f: f"{here} --campaigns FOLDER, as described in {page}" for f, (_, _, page) in CAMPAIGNS.items()
    }
    return makers | campaigns


def shown() -> dict[str, list[str]]:
    """Return every figure that a page shows, and the pages."""
    found: dict[str, list[str]] = {}
    for page in (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))):
        for name in SHOWN.findall(page.read_text("utf-8")):
            found.setdefault(name, []).append(str(page.relative_to(ROOT)))
    return found


def complaints() -> Iterator[str]:
    """Yield the mismatches between pages, files and functions."""
    makers, files = made_by(), {path.name for path in FIGURES.iterdir() if path.name != MADE}
    for name, pages in shown().items():
        if name not in makers:
            yield f"{', '.join(pages)} shows {name}, which nothing draws"
        if name not in files:
            yield f"{', '.join(pages)} shows {name}, which is not in docs/figures"
    for name in sorted(files - set(shown())):
        yield f"docs/figures/{name} is on no page"


def differences(name: str, now: Story, before: Story) -> Iterator[str]:
    """Yield what has changed in the stated results: any count, or an index by more than 0.02."""
    for what, value in now.items():
        kept = before.get(what)
        if kept is None or abs(value - kept) > (0 if isinstance(value, int) else 0.02):
            yield f"{name}: {what} is {value:.6g} now, the figures in docs say {kept}"


def make(names: list[str], folder: Path, say: Callable[[str], None]) -> dict[str, Story]:
    """Draw the figures of `names` into `folder`; return the results to state for each."""
    stories = {}
    for name in names:
        maker, files = MAKERS[name]
        with tempfile.TemporaryDirectory() as work:
            pictures, stories[name] = maker(Path(work))
        assert set(pictures) == set(files), (name, sorted(pictures))
        for file, content in pictures.items():
            (folder / file).write_bytes(content)
        say(f"{name}: {', '.join(files)}")
    return stories


def check(names: list[str], say: Callable[[str], None]) -> int:
    """Draw everything into another folder and compare it with docs; return the exit code."""
    kept = json.loads((FIGURES / MADE).read_text("utf-8"))
    with tempfile.TemporaryDirectory() as folder:
        stories = make(names, Path(folder), say)
    wrong = [*complaints()]
    for name, story in stories.items():
        wrong += differences(name, story, kept.get(name, {}))
    for words in wrong:
        say(f"[red]{words}[/]")
    if wrong:
        say("To draw them again: python benchmarks/checks/figures.py")
    return 1 if wrong else 0


def from_campaigns(results: Path, say: Callable[[str], None]) -> None:
    """Copy the figures of campaigns from their folders."""
    for name, (campaign, file, page) in CAMPAIGNS.items():
        source = results / campaign / file
        if source.exists():
            (FIGURES / name).write_bytes(source.read_bytes())
            say(f"{name}: from {source}")
        else:
            say(f"{name}: left as it is, there is no {source} (see {page})")


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", choices=list(MAKERS))
    parser.add_argument(
        "--check", action="store_true", help="change nothing; exit with 1 if anything differs"
    )
    parser.add_argument("--list", action="store_true", help="every figure and its command")
    parser.add_argument("--campaigns", type=Path, help="folder with results")
    options = parser.parse_args()
    console = Console(soft_wrap=True, highlight=False)
    if options.list:
        console.print_json(json.dumps({"made by": made_by(), "wrong": list(complaints())}))
        return 0
    if options.check:
        unnamed = [name for name in MAKERS if name not in UNCHECKED]
        return check(options.only or unnamed, console.print)
    if options.campaigns:
        from_campaigns(options.campaigns, console.print)
        return 0
    path = FIGURES / MADE
    stories = json.loads(path.read_text("utf-8")) if path.exists() else {}
    stories |= make(options.only or list(MAKERS), FIGURES, console.print)
    path.write_text(json.dumps(stories, indent=2) + "\n", "utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
