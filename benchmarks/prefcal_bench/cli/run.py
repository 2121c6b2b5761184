"""Run `prefcal bench` and `prefcal bench compare`."""

import json as json_
import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
from rich.console import Console
from rich.text import Text

from prefcal_app.cli.calibrate import INTERRUPTED, interruption
from prefcal_app.report.export import jsonable
from prefcal_bench.cells.engine import Processes
from prefcal_bench.cells.runner import SuiteResults, run_suite
from prefcal_bench.cells.store import Store
from prefcal_bench.cells.suite import Suite
from prefcal_bench.published.plan import PUBLISHED, plan, read_published
from prefcal_bench.published.raw import raw_file, write_raw
from prefcal_bench.results import campaign_of, duel_table, print_table, table, worth_table
from prefcal_bench.results.page import write
from prefcal_env.errors import SettingsError
from prefcal_env.workers import usable_cores
from prefcal_scenarios.wording import printable

from .display import BenchDisplay
from .options import BenchOptions, CompareOptions

Options = BenchOptions | CompareOptions
_WIDTH = 110  # width of the output in characters if it goes to a file or a pipe: enough for agents' names


def run(options: BenchOptions) -> int:
    """Run the missing cells, write the page, and print the result; return the exit code.

    Raises:
        PrefcalError: If the options are invalid, or the folder cannot be used.
    """
    return _run(suite_of(options), options, ["bench", *(["--quick"] if options.quick else [])])


def compare(options: CompareOptions) -> int:
    """Run the missing cells of one agent, beside published studies; see `run`.

    Raises:
        PrefcalError: If nothing is published yet, the options are invalid, or a file or folder
            cannot be used.
    """
    if options.published is None and not PUBLISHED.is_file():
        raise SettingsError("no runs come with this prefcal: name a file of yours, --published")
    given, published = _names(options), read_published(options.published)
    loops, tastes = given.get("problems"), given.get("calibrators")
    planned = plan(options.agent, published, loops, tastes, options.seeds)
    words = ["bench", "compare", options.agent]
    return _run(planned.suite, options, words, planned.published, planned.notes)


def suite_of(options: BenchOptions) -> Suite:
    """Return the suite that the options select.

    Raises:
        SettingsError: If a name is unknown, a number is invalid, or nothing is left to run.
        ScenarioError: If the file of a user's own agent cannot be loaded.
    """
    suite = Suite.quick() if options.quick else Suite.full()
    given: dict[str, Any] = _names(options)
    for name in ("seeds", "n_max"):
        if (value := getattr(options, name)) is not None:
            given[name] = value
    n_init, n_max = options.n_init, given.get("n_max", suite.n_max)
    if n_init is None:
        n_init = min(suite.n_init, max(1, n_max // 2))
    if n_init > n_max:
        raise SettingsError(f"--n-max must be at least --n-init, got --n-max {n_max} and --n-init {n_init}")
    suite = replace(suite, **given, n_init=n_init)
    if not suite.cells:
        raise SettingsError(f"there is nothing to run: {'; '.join(suite.left_out)}")
    return suite


def _names(options: Options) -> dict[str, tuple[str, ...]]:
    """Return the options that list names, as far as they are given."""
    return {
        name: tuple(word.strip() for word in value.split(","))
        for name in ("agents", "problems", "calibrators")
        if (value := getattr(options, name, None)) is not None
    }


def _command(options: Options, words: list[str]) -> str:
    """Return the command line that repeats the benchmark."""
    for name in ("agents", "published", "problems", "calibrators", "seeds", "n_init", "n_max"):
        if (value := getattr(options, name, None)) is not None:
            words += [f"--{name.replace('_', '-')}", str(value)]
    return shlex.join(["prefcal", *words, "--out", str(options.out)])


def _run(
    suite: Suite,
    options: Options,
    words: list[str],
    published: pd.DataFrame | None = None,
    notes: tuple[str, ...] = (),
) -> int:
    finished = _run_cells(suite, options)
    if finished is None:
        return INTERRUPTED
    given: dict[str, Any] = {"baseline": suite.baseline, "published": published}
    page = write(
        finished.results,
        finished.duels,
        options.out,
        command=_command(options, words),
        digest=finished.digest,
        notes=(*notes, *suite.left_out, *finished.trouble),
        **given,
    )
    write_raw(finished.results, raw_file(options.out))
    if options.json:
        print(_as_json(finished, suite, page, published))
        return 1 if finished.failures or finished.trouble else 0
    console = Console()
    console = console if console.is_terminal else Console(width=_WIDTH)
    print_table(console, finished.results, finished.duels, **given)
    for trouble in finished.trouble:
        console.print(Text(printable(trouble), style="red"), soft_wrap=True)
    console.print(Text.assemble("Digest: ", (finished.digest, "bold")), soft_wrap=True)
    console.print(Text.assemble("Page: ", (str(page), "bold")), soft_wrap=True)
    return 1 if finished.failures or finished.trouble else 0


def _run_cells(suite: Suite, options: Options) -> SuiteResults | None:
    """Run the missing cells of a suite with a progress bar; return None after Ctrl-C."""
    workers = Processes(
        usable_cores() if options.jobs is None else options.jobs,
        limit=options.cell_timeout,
        last_words="the benchmark was killed, by an agent or from outside. The results "
        f"so far are kept in {options.out}; the same command resumes.",
    )
    messages = Console(stderr=True)
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
                    f"Stopped; {display.done} results are kept in {options.out}. The same command resumes."
                )
                return None


def _as_json(finished: SuiteResults, suite: Suite, page: Path, published: pd.DataFrame | None) -> str:
    """Return the result as one strict JSON object, with null for missing numbers."""
    content: dict[str, Any] = {
        "digest": finished.digest,
        "cells": len(finished.results),
        "worth": worth_table(campaign_of(finished.results, published), suite.baseline),
        "table": table(finished.results, baseline=suite.baseline),
        "duels": duel_table(finished.duels),
        "failures": [{**result.cell.to_dict(), "failure": result.failure} for result in finished.failures],
        "trouble": finished.trouble,
        "left_out": suite.left_out,
        "page": str(page),
    }
    return json_.dumps(jsonable(content), indent=2, ensure_ascii=False, allow_nan=False)
