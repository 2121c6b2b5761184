"""Choose among runs that already ran: rows of a table, or trials of an Optuna study."""

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from prefcal_env.errors import RecordError, SettingsError
from prefcal_env.experiments.experiment import Channels, End, Experiment
from prefcal_env.experiments.kpis import as_read
from prefcal_env.knobs import Constraint, Knob, KnobSpace
from prefcal_env.optional import world
from prefcal_env.sources.source import Source
from prefcal_env.tables.historian import row_numbers
from prefcal_env.tables.sheet import Sheet, parts_of, sheet_of

from .scenario import KPI, Scenario

_MOST = 10_000  # number of candidates: with more, people wait for the next question
_WAYS = {"lower": "Lower is better", "higher": "Higher is better", "": "Your answers show which way"}
_NO_RESULT = re.compile(r"(number|state|datetime_\w+|duration|system_attrs_.*)?")
_PREFIX = re.compile(r"(params|user_attrs)_(?=.)|values_(?=\D)")
"""How `trials_dataframe()` of Optuna heads its columns."""


def choice_of(name: str, config: Mapping[str, Any]) -> Scenario:
    """Return the scenario of a choice among the runs of a table.

    Args:
        name: Path of a CSV, Parquet or Excel file, or the URL of an Optuna storage.
        config: Lists of the columns in which `lower` or `higher` is better, and of those (`kpis`) whose
            direction is not known; of a storage, the study `of` and the last trial, `until`.

    Raises:
        RecordError: If the table cannot be read, or leaves nothing to choose.
        SettingsError: If a column is named twice, or there is no such study; a file holds none.
        MissingExtraError: If what reads it is not installed.
    """
    if "://" in name:
        trials = world("optuna").inside("prefcal_scenarios").trials
        frame, better = trials(name, config.get("of"), config.get("until"))
        source = Rows(sheet_of(frame), config, better)
    elif config.get("of") is not None:
        raise SettingsError(f"of names a study in a storage, and {name!r} is a file, got {config['of']!r}")
    else:
        try:
            source = Rows(sheet_of(Path(name)), config, {})
        except RecordError as error:
            raise RecordError(f"{name}: {error}") from error
    ids = source.candidates[:, 0]

    def violation(theta: Mapping[str, Any]) -> Any:
        return np.where(np.isin(theta[source.what], ids), 0.0, 1.0)

    about = "Its number, whose order means nothing."
    file = Path(name.partition("://")[2].partition("?")[0] or name)
    knob = Knob(source.what, int(ids.min()), int(ids.max()), integer=True, about=about)
    return Scenario(
        re.sub(r"\W+", "-", file.stem).strip("-") or "runs",
        f"Choose among {file.name}",
        KnobSpace([knob], [Constraint(f"{source.what}s to choose from", violation, vectorized=True)]),
        source,
        kpis=tuple(source.kpis()),
        settings=source.settings,
        brief=source.brief,
        simulated=True,
    )


class Rows(Source):
    """The rows of a table as experiments that ran; θ is the number of a row, or of an Optuna trial.

    Args:
        sheet: Table; rows count from 1 below its headings.
        config: Names of the columns that count; see `choice_of`.
        better: Directions that Optuna knows, by heading.

    Raises:
        RecordError: If a column cannot be read, or fewer than two rows differ in what counts.
        SettingsError: If a column is named twice.
    """

    channels, signals = Channels((), (), ()), ()

    def __init__(self, sheet: Sheet, config: Mapping[str, Any], better: Mapping[str, str]) -> None:
        if sheet.uneven:
            raise RecordError(sheet.uneven)
        self._sheet, self._said = sheet, list[str]()
        self.what, self._ids = "row", np.arange(1, len(sheet.frame) + 1)
        self._knobs: tuple[str, ...] = ()
        if {"number", "state"} <= {*sheet.headings}:
            better = self._take_trials(better)
        self._numbers, self._text = _columns(self._sheet)
        self.counted = self._counts(config, better)
        rows = self._rows()
        self._place = dict(zip(self._ids[rows].tolist(), rows.tolist(), strict=True))
        self.candidates: Float[np.ndarray, "m 1"] = self._ids[rows, None].astype(float)

    def _take_trials(self, better: Mapping[str, str]) -> Mapping[str, str]:
        """Keep the trials that completed, with params_K_p as K_p unless that is something else, too."""
        sheet, headings = self._sheet, self._sheet.headings
        states = sheet.frame[headings.index("state")].astype(str).str.rpartition(".")[2]
        ids, done = sheet.numbers(headings.index("number")).astype(np.int64), states == "COMPLETE"
        short = [_PREFIX.sub("", heading) for heading in headings]
        names = {h: s if short.count(s) == 1 else h for h, s in zip(headings, short, strict=True)}
        names |= {h: "" for h in headings if _NO_RESULT.fullmatch(h)}
        self._sheet = replace(sheet.take(np.flatnonzero(done)), headings=tuple(names[h] for h in headings))
        self._knobs = tuple(parts_of(names[h])[0] for h in headings if h.startswith("params_"))
        self.what, self._ids = "trial", ids[done]
        self._leave_out(ids[~done], "which did not complete")
        return {names[h]: way for h, way in better.items()}

    def _leave_out(self, ids: Int[np.ndarray, " m"], why: str) -> None:
        if len(ids):
            self._said.append(f"Left out: {self.what}{'s' if len(ids) > 1 else ''} {_few(ids)}, {why}.")

    def _counts(self, config: Mapping[str, Any], better: Mapping[str, str]) -> dict[str, str]:
        """Return the columns that count, all numbers but Optuna's parameters if none is named."""
        named: dict[str, str] = {}
        for key, way in (("lower", "lower"), ("higher", "higher"), ("kpis", "")):
            for word in config.get(key, ()):
                place = self._sheet.column(word, "")
                self._sheet.numbers(place)  # says which cell holds no number
                name = self._sheet.name(place)
                if name in named:
                    raise SettingsError(f"column {name!r} is named twice: name it after one option only")
                named[name] = way or better.get(name, "")
        free = {n: better.get(n, "") for n in self._numbers if n not in self._knobs}
        return {name: (named or free)[name] for name in self._numbers if name in (named or free)}

    def _rows(self) -> Int[np.ndarray, " m"]:
        """Return the places of the rows with all that counts, each once."""
        table = np.array([*self._numbers.values()], dtype=float).reshape(len(self._numbers), len(self._ids)).T
        lacks = np.isnan(table[:, [name in self.counted for name in self._numbers]]).any(axis=1)
        self._leave_out(self._ids[lacks], "without a number in all that counts")
        first = {row.tobytes(): k for k, row in reversed([*enumerate(table)]) if not lacks[k]}
        rows = np.array(sorted(first.values()), dtype=np.int64)
        again = np.setdiff1d(np.flatnonzero(~lacks), rows) if self._numbers else rows[:0]
        self._leave_out(self._ids[again], "with the numbers of an earlier one")
        read = {name: {*as_read(self._numbers[name][rows]).tolist()} for name in self.counted}
        if alike := [name for name, values in read.items() if len(values) < 2]:
            self._said.append(f"The same in all, so it does not count: {_few(alike)}.")
        self.counted = {name: way for name, way in self.counted.items() if name not in alike}
        if not self.counted:
            raise RecordError(
                f"a choice needs two {self.what}s or more that differ in a number that counts, got "
                f"{len(rows)} of {len(self._ids)}, with numbers in {_few(self._numbers) or 'no column'}. "
                f"{' '.join(self._said)}".rstrip()
            )
        if len(rows) <= _MOST:
            return rows
        self._said.append(f"{_MOST:,} of {len(rows):,} {self.what}s are candidates, evenly spaced.")
        return np.asarray(rows[np.linspace(0, len(rows) - 1, _MOST).astype(np.int64)])

    @property
    def brief(self) -> str:
        """Return what is chosen, what counts, and what was left out, in sentences."""
        told = {said: [n for n, w in self.counted.items() if w == way] for way, said in _WAYS.items()}
        told["Only shown"] = [name for name in self._numbers if name not in self.counted]
        told["Only in best.json"] = [*self._text]
        words = (f"{said}: {_few(names)}." for said, names in told.items() if names)
        return " ".join(
            [f"Which {self.what} of {len(self._place):,} would you rather have?", *words, *self._said]
        )

    def run(self, theta: Float[np.ndarray, " n"], seed: int = 0) -> Experiment:
        """Return the row θ, shape (1,): its numbers, and no curves."""
        place = self._place[int(theta[0])]
        found = {name: float(v[place]) for name, v in self._numbers.items() if not np.isnan(v[place])}
        return Experiment.blank(theta, Channels((), (), ()), End.TIME_UP, found)

    def settings(self, theta: Float[np.ndarray, " n"]) -> dict[str, Any]:
        """Return the number of the row θ, shape (1,), and all in it that does not count."""
        place = self._place[int(theta[0])]
        beside = {n: float(v[place]) for n, v in self._numbers.items() if n not in self.counted}
        return {self.what: int(theta[0]), **beside, **{n: cells[place] for n, cells in self._text.items()}}

    def kpis(self) -> Iterator[KPI]:
        """Yield all numbers; those that count in an unknown direction are learned both ways."""
        for name in self._numbers:
            unit, way = self._sheet.unit(self._sheet.column(name, name), None), self.counted.get(name)
            yield KPI(name, name, unit, better=way or None)  # type: ignore[arg-type]
            if way == "":
                yield KPI(f"less {name}", name, unit, better="lower", of=name)
                yield KPI(f"more {name}", name, unit, better="higher", of=name)


def _columns(sheet: Sheet) -> tuple[dict[str, Float[np.ndarray, " K"]], dict[str, list[Any]]]:
    """Return the columns of numbers by name, and those of text and of numbers of rows."""
    import pandas as pd

    numbers, text, numbering = {}, {}, {*row_numbers(sheet)}
    for i, heading in enumerate(sheet.headings):
        if not heading.strip():
            continue
        name = sheet.name(sheet.column(sheet.name(i), sheet.name(i)))  # says if there are several
        if sheet.is_almost_numeric(i):
            sheet.numbers(i)  # says which cell holds no number
        if pd.api.types.is_numeric_dtype(sheet.frame[i].dtype) and i not in numbering:
            numbers[name] = sheet.numbers(i)
        else:
            text[name] = sheet.frame[i].tolist()
    if mixed := sheet.mixed([sheet.column(name, name) for name in numbers]):
        raise RecordError(mixed)
    return numbers, text


def _few(names: Iterable[Any], most: int = 8) -> str:
    there = [str(name) for name in names]
    return ", ".join(there if len(there) <= most else [*there[:most], f"{len(there) - most} more"])
