"""Write raw results as a Parquet file that others can use, and read the curves of worth from it.

raw.parquet (raw.csv without pyarrow) has a row for each comparison, and for each
experiment that was never a challenger:

    agent, loop, taste, seed   the study: its agent, problem, calibrator and seed
    n_init, n_max              experiments before the agent learns, and in all
    after                      number of experiments run when the answer was given
    experiment, incumbent      the two compared; experiments count from 0
    answer                     -1: the experiment is better, 0: tie, 1: the incumbent is
    answers                    number of answers so far, with this one
    theta                      θ of the experiment, in the order of the problem's knobs
    kpis, kpi_names            KPIs of the experiment and their names, as two lists
    worth                      worth of the θ that the agent would return after `after` experiments
    simulated                  number of θ that the agent simulated in the study; else missing
    agent_version, problem_version, prefcal

Lists of numbers and of names are read by pandas, polars and DuckDB alike; in CSV they are JSON. The
incumbent's θ and KPIs are in the row of the same study whose experiment it is.
"""

import csv
import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from importlib.util import find_spec
from itertools import chain, islice
from pathlib import Path
from typing import Any

import pandas as pd

from prefcal_bench.cells.cell import Result
from prefcal_bench.cells.roster import entry, package_version
from prefcal_bench.problems import problem
from prefcal_env.disk import whole_file
from prefcal_env.errors import PrefcalError, SettingsError
from prefcal_env.tables.sheet import pyarrow

VERSIONS = ("agent_version", "problem_version")
_KINDS = {
    "agent": "word",
    "loop": "word",
    "taste": "word",
    "seed": "integer",
    "n_init": "integer",
    "n_max": "integer",
    "after": "integer",
    "experiment": "integer",
    "incumbent": "integer",
    "answer": "sign",
    "answers": "integer",
    "theta": "numbers",
    "kpis": "numbers",
    "kpi_names": "words",
    "worth": "number",
    "simulated": "integer",
    "agent_version": "word",
    "problem_version": "word",
    "prefcal": "word",
}
"""Columns, and what they hold."""
_BATCH = 500  # number of studies that are converted at a time: memory stays small for a large campaign


def raw_file(folder: Path) -> Path:
    """Return the file of raw results in a folder: raw.csv if pyarrow is missing."""
    return folder / ("raw.csv" if find_spec("pyarrow") is None else "raw.parquet")


def write_raw(results: Iterable[Result], path: Path) -> Path:
    """Write the raw results of all finished cells to `path`, and return it.

    Equal results give equal bytes, with the same versions of pyarrow and prefcal. The file appears
    whole or not at all.

    Raises:
        SettingsError: If the file cannot be written.
        MissingExtraError: If it is not called .csv, and pyarrow is not installed.
    """
    write = _as_csv if path.suffix == ".csv" else partial(_as_parquet, pyarrow())
    ordered = iter(sorted((r for r in results if not r.failure), key=lambda r: r.cell))
    try:
        with whole_file(path) as part:
            write(ordered, part)
    except OSError as error:
        raise SettingsError(f"cannot write {path}: {error}") from error
    return path


def read_curves(path: str | Path) -> pd.DataFrame:
    """Return the curves of worth in a raw file, with a row for each experiment of each study.

    Its columns are agent, loop, taste, seed, experiment (from 0), answers (up to that
    experiment), worth (float32), agent_version, problem_version, n_init and n_max. Studies without
    a worth, such as those of test functions, are left out.

    Raises:
        SettingsError: If there is no such file, or it holds something else.
    """
    place, budget = ["agent", "loop", "taste", "seed"], ["n_init", "n_max"]
    study = [*place, *budget, *VERSIONS]
    frame = read(path, [*study, "after", "answers", "worth"]).dropna(subset="worth")
    last = frame.drop_duplicates([*study, "after"], keep="last")
    found = last.assign(experiment=last["after"] - 1, worth=last["worth"].astype("float32"))
    order = [*place, "experiment", "answers", "worth", *VERSIONS, *budget]
    return found[order].reset_index(drop=True)


def read(path: str | Path, columns: Sequence[str]) -> pd.DataFrame:
    """Return columns of a Parquet file, or of a CSV file of that name.

    Raises:
        SettingsError: If there is no such file, or it lacks one of the columns.
        MissingExtraError: If it is Parquet, and pyarrow is not installed.
    """
    try:
        if Path(path).suffix == ".csv":
            missing = {"worth": [""]}  # elsewhere, an empty cell is an empty word
            return pd.read_csv(path, usecols=list(columns), keep_default_na=False, na_values=missing)
        pyarrow()
        return pd.read_parquet(path, columns=list(columns))
    except (OSError, ValueError) as error:  # pyarrow's are ValueErrors, too
        words = str(error).splitlines()[0]
        raise SettingsError(f"{path} holds no results of the benchmark: {words}") from error


def _as_csv(results: Iterator[Result], path: Path) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(_KINDS)
        for row in chain.from_iterable(map(_rows, results)):
            writer.writerow(json.dumps(c) if isinstance(c, list | tuple) else c for c in row)


def _as_parquet(pa: Any, results: Iterator[Result], path: Path) -> None:
    word, number = pa.dictionary(pa.int32(), pa.string()), pa.float64()
    types = {
        "word": word,
        "words": pa.list_(word),
        "numbers": pa.list_(number),
        "number": number,
        "integer": pa.int32(),
        "sign": pa.int8(),
    }
    schema = pa.schema([(name, types[kind]) for name, kind in _KINDS.items()])
    with pa.parquet.ParquetWriter(path, schema, compression="zstd") as writer:
        while batch := list(islice(results, _BATCH)):
            rows = chain.from_iterable(map(_rows, batch))
            columns = dict(zip(_KINDS, map(list, zip(*rows, strict=True)), strict=True))
            writer.write_table(pa.table(columns, schema=schema))


def _rows(result: Result) -> Iterator[tuple[object, ...]]:
    """Yield the rows of one study, in the order of the columns."""
    cell = result.cell
    study = (cell.agent, cell.problem, cell.calibrator, cell.seed, cell.n_init, cell.n_max)
    versions = (version_of(entry, cell.agent), version_of(problem, cell.problem), package_version("prefcal"))
    answered = 0
    for newest, total in enumerate(result.questions):
        told = result.comparisons[answered:total]
        asked: list[tuple[int, int | None, int | None, int]] = [
            (challenger, incumbent, answer, answered + number)
            for number, (challenger, incumbent, answer) in enumerate(told, start=1)
        ]
        if newest not in {challenger for challenger, *_ in asked}:
            asked.insert(0, (newest, None, None, answered if told else total))
        worth = None if result.worth is None else result.worth[newest]
        for challenger, incumbent, answer, answers in asked:
            kpis = result.kpis[challenger] if result.kpis else ()
            yield (
                *study,
                newest + 1,
                challenger,
                incumbent,
                answer,
                answers,
                result.thetas[challenger],
                kpis,
                result.kpi_names,
                worth,
                result.simulated,
                *versions,
            )
        answered = total


def version_of(find: Callable[[str], Any], name: str) -> str:
    """Return the version of what `find`, `entry` or `problem`, finds; empty if it is not here."""
    try:
        return str(find(name).version)
    except PrefcalError:
        return ""
