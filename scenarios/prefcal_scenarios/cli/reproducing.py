"""What `prefcal reproduce` does."""

import json as json_
import shlex
from collections.abc import Sequence
from contextlib import closing
from dataclasses import asdict
from pathlib import Path

from rich.console import Console

from prefcal_env.errors import BenchmarkError
from prefcal_scenarios.bench import Processes
from prefcal_scenarios.bench.engine import Lost, each
from prefcal_scenarios.bench.executors import usable_cores
from prefcal_scenarios.cli.bench_display import BenchDisplay
from prefcal_scenarios.cli.interrupt import INTERRUPTED, interruption
from prefcal_scenarios.report.folder import folder_for
from prefcal_scenarios.reproduce import Study, tasks, write_page


def run(seeds: int, jobs: int | None, out: Path, *, json: bool) -> int:
    """Run all studies, write the page, say where it is; return the exit code.

    Raises:
        SettingsError: `out` is a file, or cannot be made or written to.
        BenchmarkError: a study ended without a result.
    """
    folder, messages = folder_for(out), Console(stderr=True)
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


def _studies(seeds: int, jobs: int, display: BenchDisplay) -> Sequence[Study]:
    """Every study, by seed and case."""
    waiting = tasks(range(seeds))
    display.begin("studies", len(waiting), 0)
    results: dict[int, Study] = {}
    with closing(each(waiting, Processes(min(jobs, len(waiting))))) as landing:
        for number, result in landing:
            if isinstance(result, Lost):
                raise BenchmarkError(f"a study ended without a result: {result.why}")
            results[number] = result
            display.landed(f"{result.case}, seed {result.seed}")
    return [results[number] for number in range(len(waiting))]
