"""Run `prefcal bench`."""

import json as json_
import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
from rich.console import Console
from rich.text import Text

from prefcal_app.cli.interrupt import INTERRUPTED, interruption
from prefcal_app.report.export import jsonable
from prefcal_bench.cells.engine import Processes
from prefcal_bench.cells.runner import Finished, run_suite
from prefcal_bench.cells.store import Store
from prefcal_bench.cells.suite import Suite
from prefcal_bench.published.raw import raw_file, write_raw
from prefcal_bench.results import duel_table, print_table, table, write
from prefcal_bench.results.curves import curves_of, frame_of, joined
from prefcal_bench.results.rows import worth_table
from prefcal_env.errors import SettingsError
from prefcal_env.workers import usable_cores
from prefcal_scenarios.presentation.wording import printable

from .display import BenchDisplay
from .options import BenchOptions, CompareOptions

_WIDTH = 110
"""Width of the output in characters if it goes to a file or a pipe."""


def command_of(options: BenchOptions) -> str:
    """Return the command line that repeats the benchmark."""
    words = ["prefcal", "bench", *(["--quick"] if options.quick else [])]
    for name in ("agents", "problems", "calibrators", "seeds", "n_init", "n_max"):
        if (value := getattr(options, name)) is not None:
            words += [f"--{name.replace('_', '-')}", str(value)]
    return shlex.join([*words, "--out", str(options.out)])


def suite_of(options: BenchOptions) -> Suite:
    """Return the suite that the options select.

    Raises:
        SettingsError: If a name is unknown, a number is invalid, or nothing is left to run.
        ScenarioError: If the file of a user's own agent cannot be loaded.
    """
    suite = Suite.quick() if options.quick else Suite.full()
    given: dict[str, Any] = {
        name: tuple(word.strip() for word in value.split(","))
        for name in ("agents", "problems", "calibrators")
        if (value := getattr(options, name)) is not None
    }
    for name in ("seeds", "n_max"):
        if (value := getattr(options, name)) is not None:
            given[name] = value
    n_init = options.n_init
    if n_init is None:
        n_init = min(suite.n_init, max(1, given.get("n_max", suite.n_max) // 2))
    n_max = given.get("n_max", suite.n_max)
    if n_init > n_max:
        raise SettingsError(
            f"--n-max must be at least --n-init, got --n-max {n_max} and --n-init {n_init}"
        )
    suite = replace(suite, **given, n_init=n_init)
    if not suite.cells:
        raise SettingsError(f"there is nothing to run: {'; '.join(suite.left_out)}")
    return suite


def workers_of(options: BenchOptions | CompareOptions) -> Processes:
    """Return the workers that run the benchmark.

    Raises:
        SettingsError: If the time limit is invalid.
    """
    return Processes(
        usable_cores() if options.jobs is None else options.jobs,
        limit=options.cell_timeout,
        last_words="the benchmark was killed, by an agent or from outside. The results "
        f"so far are kept in {options.out}; the same command resumes.",
    )


def run(options: BenchOptions) -> int:
    """Run the missing cells, write the page, and print the result; return the exit code.

    Raises:
        PrefcalError: If the options are invalid, or the folder cannot be used.
    """
    suite = suite_of(options)
    finished = run_all(suite, options)
    if finished is None:
        return INTERRUPTED
    page = write(
        finished.results, finished.duels, options.out, command=command_of(options),
        digest=finished.digest, notes=(*suite.left_out, *finished.trouble), baseline=suite.baseline,
    )  # fmt: skip
    write_raw(finished.results, raw_file(options.out))
    if options.json:
        print(as_json(finished, suite, page))
    else:
        show(finished, page, suite.baseline)
    return 1 if finished.failures or finished.trouble else 0


def run_all(suite: Suite, options: BenchOptions | CompareOptions) -> Finished | None:
    """Run the missing cells of a suite with a progress bar; return None after Ctrl-C.

    Raises:
        PrefcalError: If the options are invalid, or the folder cannot be used.
    """
    workers, messages = workers_of(options), Console(stderr=True)
    for words in suite.left_out:
        messages.print(Text(f"Left out: {words}"), soft_wrap=True)
    with interruption() as pressed:  # from here on, Ctrl-C prints its own message
        store = Store(options.out)
        with BenchDisplay(messages) as display:
            try:
                with pressed.allowed():
                    return run_suite(suite, store, workers, display)
            except KeyboardInterrupt:
                display.say(
                    f"Stopped; {display.done} results are kept in {options.out}. "
                    "The same command resumes."
                )
                return None


def worths(
    finished: Finished, baseline: str, published: pd.DataFrame | None = None
) -> list[dict[str, Any]]:
    """Return the table of worth; empty if no closed loop was run."""
    return worth_table(curves_of(joined(frame_of(finished.results), published)), baseline)


def show(
    finished: Finished, page: Path, baseline: str, published: pd.DataFrame | None = None
) -> None:
    """Print tables that compare with `baseline`, failures, the digest, and the page's path."""
    console = _paper()
    print_table(console, finished.results, finished.duels, baseline=baseline, published=published)
    for words in finished.trouble:
        console.print(Text(printable(words), style="red"), soft_wrap=True)
    console.print(Text.assemble("Digest: ", (finished.digest, "bold")), soft_wrap=True)
    console.print(Text.assemble("Page: ", (str(page), "bold")), soft_wrap=True)


def as_json(
    finished: Finished, suite: Suite, page: Path, published: pd.DataFrame | None = None
) -> str:
    """Return the result as one strict JSON object, with null for missing numbers."""
    content: dict[str, Any] = {
        "digest": finished.digest,
        "cells": len(finished.results),
        "worth": worths(finished, suite.baseline, published),
        "table": table(finished.results, baseline=suite.baseline),
        "duels": duel_table(finished.duels),
        "failures": [
            {**result.cell.to_dict(), "failure": result.failure} for result in finished.failures
        ],
        "trouble": finished.trouble,
        "left_out": suite.left_out,
        "page": str(page),
    }
    return json_.dumps(jsonable(content), indent=2, ensure_ascii=False, allow_nan=False)


def _paper() -> Console:
    """Return standard output, wide enough for agent names if it is not a terminal."""
    console = Console()
    return console if console.is_terminal else Console(width=_WIDTH)
