"""Run `prefcal reproduce`: all studies of the paper, and their page."""

import json as json_
import shlex
from collections.abc import Sequence
from contextlib import closing
from dataclasses import asdict
from pathlib import Path

from rich.console import Console

from prefcal_app.cli.calibrate import INTERRUPTED, interruption
from prefcal_bench.cells.engine import Processes, each
from prefcal_bench.reproduce import PaperStudy, tasks, write_page
from prefcal_env.errors import BenchmarkError, RunError
from prefcal_env.workers import usable_cores
from prefcal_scenarios.wording import folder_for

from .display import BenchDisplay


def run(seeds: int, jobs: int | None, out: Path, *, json: bool) -> int:
    """Run all studies, write the page, and print its path; return the exit code.

    Raises:
        SettingsError: If `out` is a file, or cannot be made or written to.
        BenchmarkError: If a study ended without a result.
    """
    folder, messages = folder_for(out), Console(stderr=True, emoji=False)
    with interruption() as pressed, BenchDisplay(messages) as display:
        try:
            with pressed.allowed():
                studies = _studies(seeds, jobs or usable_cores(), display)
        except KeyboardInterrupt:
            display.say("Stopped; nothing was written.")
            return INTERRUPTED
    words = ["prefcal", "reproduce", "paper", "--seeds", str(seeds), "--out", str(out)]
    messages.print("Drawing the page …", highlight=False)
    page = write_page(studies, folder, shlex.join(words))
    if json:
        print(json_.dumps({"page": str(page), "studies": [asdict(s) for s in studies]}, indent=2))
    else:
        Console(soft_wrap=True).print(f"Page: {page}", highlight=False, markup=False)
    return 0


def _studies(seeds: int, jobs: int, display: BenchDisplay) -> Sequence[PaperStudy]:
    """Run all studies; return them sorted by seed and case."""
    waiting = dict(enumerate(tasks(range(seeds))))
    display.begin("studies", len(waiting), 0)
    results: dict[int, PaperStudy] = {}
    with closing(each(waiting, Processes(min(jobs, len(waiting))))) as landing:
        for number, result in landing:
            if isinstance(result, RunError):
                raise BenchmarkError(f"a study ended without a result: {result}")
            results[number] = result
            display.landed(f"{result.case}, seed {result.seed}")
    return [results[number] for number in waiting]
