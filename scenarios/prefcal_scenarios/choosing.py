"""Choose among runs that already ran: rows of a table, or trials of an Optuna study."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from prefcal_env.errors import RecordError, ScenarioError, SettingsError
from prefcal_env.experiments.experiment import Channels, End, Experiment
from prefcal_env.experiments.kpis import as_read
from prefcal_env.knobs import Constraint, Knob, KnobSpace
from prefcal_env.optional import world
from prefcal_env.sources.source import Source
from prefcal_env.tables.historian import row_numbers
from prefcal_env.tables.sheet import Sheet, parts_of, sheet_of

from .scenario import KPI, Scenario

# --- Read a table of runs: its numbers, what they are called, and which rows hold a run.


@dataclass(frozen=True, slots=True, eq=False)
class Runs:
    """A table of runs.

    Args:
        sheet: The table; a column without a heading is not used.
        what: What a row is called: "row", or "trial" in Optuna.
        ids: Number of each row, shape (K,): rows count from 1 below the headings.
        knobs: Names of the columns that are Optuna's parameters.
        better: Directions that Optuna knows, "lower" or "higher", by name of the column.
        done: Which rows hold a run, shape (K,): trials that failed or were pruned are none.
    """

    sheet: Sheet
    what: str
    ids: Int[np.ndarray, " K"]
    knobs: tuple[str, ...]
    better: Mapping[str, str]
    done: Bool[np.ndarray, " K"]
    numbers: dict[str, Float[np.ndarray, " K"]] = field(default_factory=dict)
    """Columns of numbers by name, each of shape (K,)."""
    text: dict[str, Sequence[Any]] = field(default_factory=dict)
    """All other columns by name."""

    def __post_init__(self) -> None:
        import pandas as pd

        sheet, numbering = self.sheet, set(row_numbers(self.sheet))
        for i, heading in enumerate(sheet.headings):
            if not heading.strip():
                continue
            sheet.column(sheet.name(i), sheet.name(i))  # says if there are several
            if sheet.is_almost_numeric(i):
                sheet.numbers(i)  # says which cell holds no number
            numeric = pd.api.types.is_numeric_dtype(sheet.frame[i].dtype) and i not in numbering
            into: dict[str, Any] = self.numbers if numeric else self.text
            into[sheet.name(i)] = sheet.numbers(i) if numeric else sheet.frame[i].tolist()
        if mixed := sheet.mixed([sheet.column(name, name) for name in self.numbers]):
            raise RecordError(mixed)

    def unit(self, name: str) -> str:
        """Return the unit of a column by its heading."""
        return self.sheet.unit(self.sheet.column(name, name), None)

    def counted(self, config: Mapping[str, Any]) -> dict[str, str]:
        """Return the columns that count with their direction, "" if it is not known.

        They are those that `config` names; if it names none, all numbers but Optuna's parameters.

        Raises:
            RecordError: If there is no such column, or it holds no numbers.
            SettingsError: If one is named twice.
        """
        found: dict[str, str] = {}
        for key, way in (("lower", "lower"), ("higher", "higher"), ("kpis", "")):
            for word in config.get(key, ()):
                place = self.sheet.column(word, word)
                self.sheet.numbers(place)  # says which cell holds no number
                name = self.sheet.name(place)
                if name in found:
                    raise SettingsError(f"column {name!r} is named twice: name it once, after one option")
                found[name] = way or self.better.get(name, "")
        free = {name: self.better.get(name, "") for name in self.numbers if name not in self.knobs}
        named = found or free
        return {name: named[name] for name in self.numbers if name in named}


def runs_of(name: str, config: Mapping[str, Any]) -> Runs:
    """Read the table in a file, or an Optuna study by the URL of its storage.

    Raises:
        RecordError: If there is none, or it is no table of runs.
        ScenarioError: If its rows are not those that `config` was made for, see `pinned`.
        MissingExtraError: If what reads it is not installed.
    """
    better: Mapping[str, str] = {}
    if "://" in name:
        frame, better = world("optuna").inside("prefcal_scenarios").trials(name, config.get("of"))
        sheet = sheet_of(frame)
    else:
        sheet = sheet_of(Path(name))
    if sheet.uneven:
        raise RecordError(f"{name}: {sheet.uneven}")
    if "digest" in config:
        count = int(config["rows"])
        if _digest(sheet, count) != config["digest"]:
            raise ScenarioError(
                f"the first {count} rows of {name!r} have changed since the study began: restore them, or "
                "start another study"
            )
        sheet = sheet.taken(np.arange(count))
    headings = [heading.strip() for heading in sheet.headings]
    if {"number", "state"} <= {*headings}:
        return _trials(sheet, headings, better)
    ids = np.arange(1, len(sheet.frame) + 1)
    return Runs(sheet, "row", ids, (), {}, np.ones(len(ids), dtype=bool))


def pinned(name: str, config: Mapping[str, Any]) -> dict[str, Any]:
    """Return `config` with the number of rows there are and their digest: a table may grow, not change."""
    sheet = runs_of(name, config).sheet
    return {**config, "rows": len(sheet.frame), "digest": _digest(sheet, len(sheet.frame))}


def _digest(sheet: Sheet, count: int) -> str:
    frame = sheet.frame.set_axis(list(sheet.headings), axis=1).iloc[:count]
    # Later trials may have columns that these have not.
    return sha256(frame.dropna(axis=1, how="all").to_csv(index=False).encode()).hexdigest()[:16]


_NO_RESULT = re.compile(r"(number|state|datetime_\w+|duration|system_attrs_.*)?")
_PREFIX = re.compile(r"(params|user_attrs)_(?=.)|values_(?=\D)")


def _trials(sheet: Sheet, headings: list[str], better: Mapping[str, str]) -> Runs:
    """Return the trials in what `trials_dataframe()` of Optuna returns."""
    states = sheet.frame[headings.index("state")].astype(str).str.rpartition(".")[2]
    ids = sheet.numbers(headings.index("number")).astype(np.int64)
    short = [_PREFIX.sub("", heading, count=1) for heading in headings]
    used = [
        "" if _NO_RESULT.fullmatch(h) else h if short.count(s) > 1 else s
        for h, s in zip(headings, short, strict=True)
    ]
    renamed = replace(sheet, headings=tuple(used))
    knobs = tuple(parts_of(u)[0] for u, h in zip(used, headings, strict=True) if h.startswith("params_"))
    ways = {u: better[h] for u, h in zip(used, headings, strict=True) if h in better}
    return Runs(renamed, "trial", ids, knobs, ways, np.asarray(states == "COMPLETE"))


# --- Which rows are candidates, and what is left out, in words.

_MOST = 10_000  # number of candidates: with more, people wait for the next question
_NAMED = 8  # number of names in a sentence


@dataclass(frozen=True, slots=True, eq=False)
class Choice:
    """The candidates of a table, and what counts.

    Args:
        runs: The table.
        counted: Columns that count with their direction, "" if it is not known.
        rows: Places of the candidates in the table, shape (m,).
        said: What was left out and why, in sentences.
    """

    runs: Runs
    counted: Mapping[str, str]
    rows: Int[np.ndarray, " m"]
    said: tuple[str, ...]

    @classmethod
    def of(cls, runs: Runs, counted: Mapping[str, str]) -> "Choice":
        """Return the rows that hold a run with all numbers that count, each once.

        Raises:
            RecordError: If there are fewer than two that differ.
        """
        said, rows = list[str](), np.arange(len(runs.ids))

        def keep(kept: Bool[np.ndarray, " m"], why: str) -> None:
            nonlocal rows
            if not kept.all():
                said.append(f"Left out: {_listed(runs.what, runs.ids[rows[~kept]])}, {why}.")
            rows = rows[kept]

        keep(runs.done[rows], "which did not complete")
        table = np.array(list(runs.numbers.values())).T.reshape(len(runs.ids), len(runs.numbers))
        if counted:
            values = table[:, [name in counted for name in runs.numbers]]
            keep(~np.isnan(values[rows]).any(axis=1), f"without a value of {' or '.join(_few(counted))}")
        first = {row.tobytes(): k for k, row in reversed([*enumerate(table[rows])])}
        keep(np.isin(np.arange(len(rows)), list(first.values())), "with the numbers of an earlier one")
        read = {name: as_read(runs.numbers[name][rows]) for name in counted}
        alike = [name for name, values in read.items() if not len(values) or (values == values[0]).all()]
        if len(rows) < 2 or len(alike) == len(counted):
            raise RecordError(
                f"a choice needs two {runs.what}s or more that differ in what counts, got {len(rows)} of "
                f"{len(runs.ids)}{' that read the same' if len(rows) > 1 else ''}. {' '.join(said)}".rstrip()
            )
        if alike:
            said.append(f"The same in all, so that it says nothing: {', '.join(_few(alike))}.")
        if len(rows) > _MOST:
            said.append(f"{_MOST:,} of {len(rows):,} {runs.what}s are candidates, evenly spaced.")
            rows = rows[np.linspace(0, len(rows) - 1, _MOST).astype(np.int64)]
        return cls(runs, {n: way for n, way in counted.items() if n not in alike}, rows, tuple(said))

    @property
    def brief(self) -> str:
        """Return what is chosen among, and by what, in sentences."""
        runs, ways = self.runs, {"": "your answers show the direction"}
        counts = [f"{n} ({ways.get(way, f'{way} is better')})" for n, way in self.counted.items()]
        shown = [name for name in runs.numbers if name not in self.counted]
        found = [f"Which {runs.what} of {len(self.rows):,} would you rather have?"]
        found.append(f"What counts: {', '.join(_few(counts))}.")
        found += [f"Only shown: {', '.join(_few(shown))}."] if shown else []
        found += [f"Only in best.json: {', '.join(_few(runs.text))}."] if runs.text else []
        return " ".join((*found, *self.said))

    def kpis(self) -> Iterator[KPI]:
        """Yield the KPIs: those of an unknown direction are learned both ways."""
        for name in self.runs.numbers:
            unit, way = self.runs.unit(name), self.counted.get(name, None)
            yield KPI(name, name, unit, better=way or None)  # type: ignore[arg-type]
            if way == "":
                yield KPI(f"less {name}", name, unit, better="lower", of=name)
                yield KPI(f"more {name}", name, unit, better="higher", of=name)


def _few(names: Any) -> list[str]:
    there = [str(name) for name in names]
    more = len(there) - _NAMED
    return there if more <= 0 else [*there[:_NAMED], f"{more} more"]


def _listed(what: str, ids: Int[np.ndarray, " m"]) -> str:
    return f"{what}{'s' if len(ids) > 1 else ''} {', '.join(_few(ids))}"


# --- The rows as a source: θ is the number of a row.


class Rows(Source):
    """The candidates of a table; nothing runs, since all did. θ is the number of a row or trial."""

    channels, signals = Channels((), (), ()), ()

    def __init__(self, choice: Choice) -> None:
        self.choice = choice
        ids = choice.runs.ids[choice.rows]
        self.candidates = ids[:, None].astype(float)
        self._place = dict(zip(ids.tolist(), choice.rows.tolist(), strict=True))

    def run(self, theta: Float[np.ndarray, " n"], seed: int = 0) -> Experiment:
        """Return the numbers of the row θ, shape (1,)."""
        place, numbers = self._place[int(theta[0])], self.choice.runs.numbers
        found = {n: float(v[place]) for n, v in numbers.items() if not np.isnan(v[place])}
        return Experiment.blank(theta, Channels((), (), ()), End.TIME_UP, found)

    def settings(self, theta: Float[np.ndarray, " n"]) -> dict[str, Any]:
        """Return the number of the row θ, shape (1,), and what stands in it beside what counts."""
        place, runs = self._place[int(theta[0])], self.choice.runs
        beside = {n: float(v[place]) for n, v in runs.numbers.items() if n not in self.choice.counted}
        line = {} if runs.sheet.lines is None else {"line": int(runs.sheet.lines[place])}
        text = {name: cells[place] for name, cells in runs.text.items()}
        return {runs.what: int(theta[0]), **line, **beside, **text}


def choice_of(name: str, config: Mapping[str, Any]) -> Scenario:
    """Return the scenario of a choice among the runs of a table.

    Args:
        name: Path of a CSV, Parquet or Excel file, or the URL of an Optuna storage.
        config: Columns that count as lists: `lower` and `higher` are better, or `kpis` without a
            direction; `of`, the study in the storage; and what `pinned` adds.

    Raises:
        RecordError: If the table cannot be read, or there is nothing to choose.
        SettingsError: If a column is named twice, or there is no such study.
        ScenarioError: If a key is unknown, or the table has changed since the study began.
        MissingExtraError: If what reads it is not installed.
    """
    if unknown := config.keys() - {"lower", "higher", "kpis", "of", "rows", "digest"}:
        raise ScenarioError(
            f"{name!r}: {sorted(unknown)[0]!r} says nothing about a table of runs: leave it out"
        )
    runs = runs_of(name, config)
    source = Rows(Choice.of(runs, runs.counted(config)))
    ids = source.candidates[:, 0]
    knob = Knob(
        runs.what, int(ids.min()), int(ids.max()), integer=True, about="Its number; the order means nothing."
    )

    def allowed(theta: Mapping[str, Any]) -> Any:
        return np.where(np.isin(theta[runs.what], ids), 0.0, 1.0)

    title = re.sub(r".*://+|[?].*", "", name)
    return Scenario(
        re.sub(r"\W+", "-", Path(title).stem).strip("-") or "runs",
        f"Choose among {Path(title).name}",
        KnobSpace([knob], [Constraint(f"{runs.what}s that can be chosen", allowed, vectorized=True)]),
        source,
        kpis=tuple(source.choice.kpis()),
        settings=source.settings,
        brief=source.choice.brief,
        simulated=True,
    )
