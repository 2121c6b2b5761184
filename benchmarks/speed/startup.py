"""Measure what starting costs: processor seconds of commands, cold (nothing compiled) and warm.

    python benchmarks/speed/startup.py [--rounds 3] [--scenarios cstr overtake servo]
    python benchmarks/speed/startup.py --experiments 1000 --agents glisp --scenarios lag

Every command is compared with `import numpy` in the same round, since processors differ; cold and
warm runs of one scenario follow each other, in a cache folder of their own.

With --experiments, a study of so many random θ, most of them near the best one, is written by the library
alone. It is opened twice, since the first time all is learned anew and then kept beside the study (with
screening and 1,000 experiments this takes many minutes). Each time it prints the seconds and processor
seconds to the first question of the page, and those to the next one, answered at once.
"""

import argparse
import itertools
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from prefcal_app.cli.choices import open_study
from prefcal_env.preferences.answer import Answer, Preference, completed
from prefcal_env.preferences.history import Sample
from prefcal_env.study import Answered, Finished, Shown, StudyFile, Suggested
from prefcal_scenarios import load
from prefcal_scenarios.runs import outcome

sys.path.insert(0, str(Path(__file__).parents[1] / "stress"))

from kills import Visitor

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


def write_study(path: Path, name: str, agent: str, count: int) -> None:
    """Write a person's study of a scenario with so many experiments, by the sum of the logarithms of KPIs."""
    scenario, rng = load(name), np.random.default_rng(0)
    simulate = {} if agent == "screening" else {"simulate": 0}
    given = {"scenario": name, "study": str(path), "agent": agent, "n_max": count + 100, **simulate}
    file, _, _ = open_study(given, scenario)
    known, space = list[Any](), scenario.space
    while (history := file.state.history).answered < count:
        index, best, z = history.answered, history.incumbent, rng.random(len(space))
        if best is not None and rng.random() < 0.6:
            z = np.clip(np.array(history.samples[best].z) + 0.15 * rng.standard_normal(len(z)), 0.0, 1.0)
        sample = Sample.of(space, space.snap(z))
        if file.find_experiment(np.array(sample.theta)) is not None:
            continue
        experiment = scenario.run(np.array(sample.theta))
        kpis = [np.log(min(abs(value), 1e6) + 1e-6) for value in experiment.kpis.values()]
        known.append((experiment, outcome(scenario, experiment), float(np.nansum(kpis))))
        file.append(Suggested(index, sample.z, sample.theta), (Finished(index), experiment))
        answer_next(file, known, index, best)
    file.close()


def answer_next(file: StudyFile, known: Sequence[Any], index: int, best: int | None) -> None:
    """Answer the question about the latest experiment."""
    (new, told, cost), question = known[index], None
    old, rival, least = (None, None, cost) if best is None else known[best]
    if best is not None:
        (question,) = file.append(Shown(index, best, index % 2 == 0))
    verdict = None if best is None else Preference(int(np.sign(cost - least)))
    answer = completed(Answer(verdict), new, old, (told, rival))
    file.append(Answered(question, index, best, answer))


def used(pid: int | str) -> float:
    """Return the processor seconds of a process and of all that it started."""
    try:
        numbers = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        tasks = list(Path(f"/proc/{pid}/task").glob("*/children"))
        children = [child for task in tasks for child in task.read_text().split()]
    except OSError:  # it has ended
        return 0.0
    return sum(map(int, numbers[11:15])) / os.sysconf("SC_CLK_TCK") + sum(map(used, children))


def reopened(scenario: str, study: Path, answers: int) -> tuple[tuple[float, float], list[float]]:
    """Return seconds and processor seconds to the first question, and the latter to each further one."""
    words = calibrate(scenario, "--study", str(study), "--out", f"{study}-report", "--no-browser")
    environment = {**os.environ}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)  # an installed prefcal has its bytecode
    quiet = {"stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL, "text": True, "env": environment}
    began, asked, found = time.perf_counter(), None, [0.0]
    process = subprocess.Popen([sys.executable, *words], cwd=study.parent, **quiet)
    visitor, firsts = Visitor(process.stdout.readline().strip()), (0.0, 0.0)
    for given in itertools.count():
        while (now := visitor.get("api/now"))["phase"] != "question" or now["question"]["id"] == asked:
            time.sleep(0.02)
        total = used(process.pid)
        firsts = firsts if given else (time.perf_counter() - began, total)
        found.append(total - found[0])
        if given == answers:
            break
        asked, found[0] = now["question"]["id"], used(process.pid)
        choice = ("left", "right", "same")[given % 3]
        visitor.post("answer", question=asked, choice=choice, comment="", blind=False)
    process.send_signal(signal.SIGINT)  # it keeps what was learned
    process.wait()
    return firsts, found[2:]


def long_studies(given: argparse.Namespace) -> None:
    """Measure and print how long studies are opened, and go on."""
    table = Table("study", "opened", "to a question [s]", "CPU [s]", "next: median CPU [s]", "worst")
    for scenario, agent in itertools.product(given.scenarios, given.agents):
        with tempfile.TemporaryDirectory() as name:
            study = Path(name) / "long.prefcal"
            write_study(study, scenario, agent, given.experiments)
            for when in ("anew", "again"):
                (seconds, cpu), others = reopened(scenario, study, given.answers)
                shown = (seconds, cpu, statistics.median(others), max(others))
                table.add_row(f"{scenario}, {agent}", when, *(f"{each:.2f}" for each in shown))
    Console().print(table, f"load: {os.getloadavg()}")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--scenarios", nargs="*", default=["cstr", "overtake", "servo"])
    parser.add_argument("--experiments", type=int, help="number of experiments of a study to open")
    parser.add_argument("--agents", nargs="*", default=["glisp", "screening"])
    parser.add_argument("--answers", type=int, default=10)
    given = parser.parse_args()
    if given.experiments is not None:
        long_studies(given)
        return
    rounds = [one_round(given.scenarios) for _ in range(given.rounds)]
    table = Table("what", "CPU [s]", "times import numpy")
    for title in rounds[0]:
        ratio = statistics.median(each[title] / each["import numpy"] for each in rounds)
        table.add_row(title, f"{statistics.median(e[title] for e in rounds):.2f}", f"{ratio:.1f}")
    Console().print(table)


if __name__ == "__main__":
    main()
