"""Measure what starting costs: processor seconds of commands, cold (nothing compiled) and warm.

    python benchmarks/speed/startup.py [--rounds 3] [--scenarios cstr overtake servo]

Every command is compared with `import numpy` in the same round, since processors differ; cold and
warm runs of one scenario follow each other, in a cache folder of their own.
"""

import argparse
import os
import signal
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

NUMPY = ("-c", "import numpy")
STARTS = {
    "prefcal --help": ("-m", "prefcal_app", "--help"),
    "import prefcal_env": ("-c", "import prefcal_env"),
    "import numba": ("-c", "import numba"),
    "load('cstr')": ("-c", "import prefcal_scenarios; prefcal_scenarios.load('cstr')"),
}
CALIBRATORS = {"cstr": "synthetic", "overtake": "synthetic"}
"""Calibrators by scenario; the closed loops have others."""


def seconds(words: Sequence[str], folder: Path, until_link: bool = False) -> float:
    """Return the processor seconds of a Python command, or until it has printed its link."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder / "cache")}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)  # an installed prefcal has its bytecode
    process = subprocess.Popen(
        [sys.executable, *words],
        cwd=folder,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    assert process.stdout is not None
    if until_link:
        process.stdout.readline()
        process.send_signal(signal.SIGKILL)
    else:
        process.stdout.read()
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    process.stdout.close()
    if process.returncode and not until_link:
        raise SystemExit(f"{' '.join(words)} ended with code {process.returncode}")
    return used.ru_utime + used.ru_stime


def calibrate(scenario: str, *words: str) -> tuple[str, ...]:
    """Return the words of a calibration."""
    return ("-m", "prefcal_app", "calibrate", scenario, *words)


def unattended(scenario: str, folder: Path) -> float:
    """Return the processor seconds of a calibration with 3 experiments and its report."""
    calibrator = CALIBRATORS.get(scenario, "hidden")
    with tempfile.TemporaryDirectory(dir=folder) as out:
        kept = ("--study", f"{out}/one.prefcal", "--out", f"{out}/report")
        words = calibrate(scenario, "--agent", "glisp", "--calibrator", calibrator, "--n-max", "3", *kept)
        return seconds(words, folder)


def linked(scenario: str, folder: Path) -> float:
    """Return the processor seconds of a calibration until its link."""
    with tempfile.TemporaryDirectory(dir=folder) as out:
        kept = ("--study", f"{out}/one.prefcal", "--out", f"{out}/report", "--no-browser")
        return seconds(calibrate(scenario, *kept), folder, until_link=True)


def one_round(scenarios: Sequence[str]) -> dict[str, float]:
    """Return the processor seconds of everything once."""
    found = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        found["import numpy"] = seconds(NUMPY, folder)
        for words in STARTS.values():
            seconds(words, folder)  # writes bytecode
        found |= {title: seconds(words, folder) for title, words in STARTS.items()}
    for scenario in scenarios:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            cold = unattended(scenario, folder)
            warm = unattended(scenario, folder)
            found[f"calibrate {scenario}, 3 experiments, warm"] = warm
            found[f"calibrate {scenario}, compilation (cold - warm)"] = cold - warm
            found[f"calibrate {scenario}, to its link"] = linked(scenario, folder)
    return found


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--scenarios", nargs="*", default=["cstr", "overtake", "servo"])
    given = parser.parse_args()
    rounds = [one_round(given.scenarios) for _ in range(given.rounds)]
    table = Table("what", "CPU [s]", "times import numpy")
    for title in rounds[0]:
        ratio = statistics.median(each[title] / each["import numpy"] for each in rounds)
        table.add_row(title, f"{statistics.median(e[title] for e in rounds):.2f}", f"{ratio:.1f}")
    Console().print(table)


if __name__ == "__main__":
    main()
