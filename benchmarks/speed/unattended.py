"""Show where the processor time of an unattended calibration goes, from start to exit.

    python benchmarks/speed/unattended.py
    python benchmarks/speed/unattended.py overtake --n-max 100 --rounds 3

Prints a Markdown table: processor seconds of every part of `prefcal calibrate SCENARIO
--calibrator synthetic --seed 0`, each part without the parts inside it, and as multiples of a fixed
piece of numpy work timed beside it, since machines differ. The median of several rounds counts,
each in a process of its own.
"""

import argparse
import builtins
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

PARTS = {
    "agent": "prefcal_agents.glisp.agent:GLISp._propose,_follow_up,_final,surrogate",
    "study file": "prefcal_env.study:StudyFile.append,experiment,create,open",
    "compiled code": "prefcal_scenarios.app.session.interview:Interview.prepare",
    "report": "prefcal_scenarios.app.cli.report:Reporter.write,tell",
}
"""Methods whose time counts as a part."""


class Parts:
    """Processor seconds of each part, without the parts called inside it."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self._open, self._since = ["the rest"], 0.0

    def enter(self, part: str) -> None:
        """Count what follows as `part`."""
        self._count()
        self._open.append(part)

    def leave(self) -> None:
        """Count what follows as the part before the last `enter`."""
        self._count()
        self._open.pop()

    def _count(self) -> None:
        now = time.process_time()
        self.seconds[self._open[-1]] += now - self._since
        self._since = now

    def timed(self, part: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return `function`, whose time counts as `part`."""

        def called(*args: Any, **kwargs: Any) -> Any:
            self.enter(part)
            try:
                return function(*args, **kwargs)
            finally:
                self.leave()

        return called


def inside(arguments: list[str]) -> None:
    """Run the command in this process, and print the seconds of its parts as JSON."""
    parts = Parts()
    builtins.__import__ = parts.timed("imports", builtins.__import__)
    from prefcal_scenarios.app.cli import calibrate_run, main

    for part, where in PARTS.items():
        module, _, names = where.partition(":")
        kind, _, methods = names.partition(".")
        owner = getattr(__import__(module, fromlist=[kind]), kind)
        for name in methods.split(","):
            found = vars(owner)[name]
            if isinstance(found, classmethod):
                setattr(owner, name, classmethod(parts.timed(part, found.__func__)))
            else:
                setattr(owner, name, parts.timed(part, found))
    load = calibrate_run.load

    def timed_load(name: str) -> Any:
        scenario = load(name)
        return replace(scenario, run=parts.timed("experiments", scenario.run))

    calibrate_run.load = timed_load
    sys.argv = ["prefcal", "calibrate", *arguments]
    try:
        main()
    finally:
        parts.enter("the rest")
        children = resource.getrusage(resource.RUSAGE_CHILDREN)
        parts.seconds["other processes"] = children.ru_utime + children.ru_stime
        print(json.dumps(parts.seconds), file=sys.stderr)


def measured(arguments: list[str]) -> dict[str, float]:
    """Return the seconds of the parts of one run of the command."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, __file__, "--inside", *arguments, "--out", f"{folder}/report"]
        done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=folder)
    return dict(json.loads(done.stderr.splitlines()[-1]))


def yardstick() -> float:
    """Return the processor time of a fixed piece of numpy work, in seconds."""
    a = np.eye(50) + 1 / (1 + np.arange(50)[:, None] + np.arange(50))
    start = time.process_time()
    for _ in range(1000):
        np.linalg.inv(a) @ (a * a + 1.0)
    return time.process_time() - start


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenario", nargs="?", default="cstr")
    parser.add_argument("--n-max", type=int, default=50)
    parser.add_argument("--rounds", type=int, default=5)
    args = parser.parse_args()
    arguments = [args.scenario, "--calibrator", "synthetic", "--seed", "0"]
    arguments += ["--n-max", str(args.n_max)]
    measured(arguments)  # compiles
    rounds, beside = [], []
    for _ in range(args.rounds):
        beside.append(yardstick())
        rounds.append(measured(arguments))
    print("| part | CPU s | times the yardstick |\n| --- | --- | --- |")
    for part in [*sorted(rounds[0], key=lambda part: -rounds[0][part]), "all"]:
        found = [sum(r.values()) if part == "all" else r[part] for r in rounds]
        ratio = np.median(np.divide(found, beside))
        print(f"| {part} | {np.median(found):.2f} | {ratio:.1f} |")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--inside"]:
        inside(sys.argv[2:])
    else:
        main()
