"""Find study files, open them safely, list them, and show one."""

import json as json_
import re
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import msgspec
from rich.cells import cell_len, set_cell_size
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from prefcal_app.cli.options import Options
from prefcal_app.cli.parameters import kept_by
from prefcal_app.report.export import jsonable
from prefcal_app.report.record import VERDICTS
from prefcal_app.summary.counts import Counts
from prefcal_env.errors import PrefcalError, SettingsError, StudyError
from prefcal_env.preferences.answer import Mark
from prefcal_env.study import State, StudyFile, data_folder, studies_in_data_folder, study_path
from prefcal_env.wording import did_you_mean
from prefcal_scenarios.presentation.wording import labeled, mark_text, number, printable

EXPERIMENT = re.compile(r"(.+):(\d+|best)")
"""An experiment of a study, as people name it: MINE:3, MINE:best."""


def numbered(name: str, which: str, state: State) -> int:
    """Return the index of the experiment that people call `which` in the study called `name`.

    Raises:
        SettingsError: If the study has no such experiment.
    """
    index = state.history.incumbent if which == "best" else int(which) - 1
    if index is None or index not in state.finished:
        there = ", ".join(str(k + 1) for k in sorted(state.finished)) or "none"
        raise SettingsError(f"study {name!r} has no experiment {which}; there are {there}")
    return index


def wall_clock() -> str:
    """Return the time in UTC, for the record; no result depends on it."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")


def existing(name: str) -> Path:
    """Return the file of a study. Raises StudyError if there is none."""
    path = study_path(name)
    if path.is_file():
        return path
    if path.parent != data_folder():
        raise StudyError(f"there is no study {name!r}: no file {path}")
    hint = did_you_mean(name, [p.stem for p in studies_in_data_folder()])
    raise StudyError(f"there is no study {name!r}.{hint} `prefcal studies list` shows yours")


class _Knob(msgspec.Struct):
    name: str
    unit: str


class _Agent(msgspec.Struct):
    agent: str


class _Configuration(msgspec.Struct):
    """Fields of a study's configuration that the command line reads."""

    scenario: str
    name: str
    title: str
    seed: int
    knobs: list[_Knob]
    agent: _Agent
    options: dict[str, Any]
    versions: dict[str, Any]


def open_described(path: Path, *, writing: bool = False) -> StudyFile:
    """Open a study that `prefcal calibrate` could have made, for reading unless `writing`.

    The configuration is checked, since a study file can hold any plain data, and one imported
    file must not break the list of all studies.

    Raises:
        StudyError: If the file cannot be opened, or its configuration is invalid.
    """
    file = StudyFile.open(path, clock=wall_clock, reading=not writing)
    problem = _problem(file.state.configuration)
    if problem:
        file.close()
        raise StudyError(f"{path} is not a study of prefcal calibrate: {problem}")
    return file


def _problem(configuration: Mapping[str, Any]) -> str:
    """Return what is wrong with a configuration, or "" if it is valid."""
    try:
        options = msgspec.convert(dict(configuration), _Configuration).options
    except msgspec.ValidationError as error:
        return _in_words(error)
    if "calibrator" not in options:
        return "its options must name a calibrator"
    for name, (parameter, _) in kept_by(Options).items():
        try:
            if name in options:
                msgspec.convert(options[name], parameter.type)
        except msgspec.ValidationError:
            return f"its option {name} cannot be {options[name]!r:.40}"
    return ""


def _in_words(error: msgspec.ValidationError) -> str:
    """Return a parser message like "Expected `str`, got `int` - at `$.name`" in our words."""
    problem, _, where = str(error).replace("`", "").partition(" - at $.")
    problem = problem[:1].lower() + problem[1:]
    return f"its {where}: {problem}" if where else f"its configuration: {problem}"


def print_list(*, json: bool) -> None:
    """Print a row for each study in the data folder, including unreadable ones."""
    rows = [_row(path) for path in studies_in_data_folder()]
    if json:
        print(as_text(rows))
        return
    if not rows:
        print("No studies yet: `prefcal calibrate cstr` starts one.")
        return
    # Plain lines, however long: a table that breaks names would keep them from being copied.
    cells = [_HEADINGS, *([printable(cell) for cell in _cells(row)] for row in rows)]
    widths = [max(map(cell_len, column)) for column in zip(*cells, strict=True)]
    for line in cells:
        padded = (set_cell_size(text, width) for text, width in zip(line, widths, strict=True))
        print("  ".join(padded).rstrip())


_HEADINGS = ["study", "scenario", "experiments", "answers", "started", "state"]


def _cells(row: Mapping[str, Any]) -> list[str]:
    """Return a row for people: the date, no folders, a scenario without its configuration."""
    if "scenario" not in row:
        return [str(row["study"]), "", "", "", "", str(row["state"])]
    named = str(row["scenario"]).partition("{")[0].strip()
    scenario = named.replace("\\", "/").rpartition("/")[2]
    done = f"{row['experiments']} of {row['n_max']}"
    return [row["study"], scenario, done, str(row["answers"]), row["begun"][:10], row["state"]]


def _row(path: Path) -> dict[str, Any]:
    try:
        with open_described(path) as file:
            state = file.state
    except PrefcalError as error:
        why = str(error).replace(f" {path}", "")
        return {"study": path.stem, "file": str(path), "state": f"cannot be read: {why}"}
    return {"study": path.stem, "file": str(path), **summary(state)}


def summary(state: State) -> dict[str, Any]:
    """Return a summary of a study, for people and programs."""
    counts = Counts.of(state)
    return {
        "scenario": state.configuration["scenario"],
        "experiments": counts.experiments,
        "n_max": state.n_max,
        "answers": counts.comparisons,
        "begun": _minute(state.created),
        "state": state.ended or "open",
    }


def print_study(name: str, *, json: bool) -> None:
    """Print one study: configuration, best θ, and every answer."""
    path = existing(name)
    with open_described(path) as file:
        state = file.state
    configuration = state.configuration
    content = {
        "study": name,
        "file": str(path),
        **summary(state),
        "best": best_theta(state),
        "calibrator": configuration["options"]["calibrator"],
        "agent": configuration["agent"]["agent"],
        "seed": configuration["seed"],
        "versions": configuration["versions"],
        "questions": list(_answers(state)),
        "notes": [{"at": at, "text": text} for at, text in state.notes],
    }
    if json:
        print(as_text(content))
        return
    console = Console(emoji=False)
    shown = ("study", "file", "scenario", "calibrator", "agent", "seed", "begun", "state")
    lines = [f"{key:<12}{content[key]}" for key in shown]
    lines.append(f"{'experiments':<12}{content['experiments']} of {state.n_max}")
    units = {knob["name"]: knob["unit"] for knob in configuration["knobs"]}
    for knob, value in (content["best"] or {}).items():
        lines.append(f"best {labeled(knob, units[knob])} = {number(value)}")
    for line in lines:
        console.print(printable(line), markup=False, highlight=False, soft_wrap=True)
    if content["questions"]:
        console.print(_table(content["questions"]))


def _minute(at: str) -> str:
    """Return a UTC time of the record without its seconds."""
    return at[:16].replace("T", " ")


def best_theta(state: State) -> dict[str, float] | None:
    """Return the best θ so far by knob name; None before the first experiment."""
    best = state.history.incumbent
    if best is None:
        return None
    names = [knob["name"] for knob in state.configuration["knobs"]]
    return dict(zip(names, map(float, state.history.samples[best].theta), strict=True))


def _answers(state: State) -> Iterator[dict[str, Any]]:
    for closed in state.answers:
        again = closed.repeats is not None
        yield {
            "at": _minute(closed.at),
            "challenger": closed.challenger + 1,
            "incumbent": None if closed.incumbent is None else closed.incumbent + 1,
            "verdict": VERDICTS[closed.answer.preference],
            "marks": [mark.value for mark in closed.answer.marks],
            "automatic": [mark.value for mark in closed.answer.automatic],
            "comment": closed.comment,
            "blind": closed.blind,
            "said": "asked again" if again else "retracted" if closed.retracted else "",
        }


def _table(answers: list[Mapping[str, Any]]) -> Table:
    table = Table()
    columns = ("at", "challenger", "incumbent", "verdict", "marks", "comment", "said")
    for heading in ("when", "experiment", "against", "verdict", "marks", "comment", ""):
        table.add_column(heading, overflow="fold")
    for answer in answers:
        marks = (mark_text(Mark(m), automatic=m in answer["automatic"]) for m in answer["marks"])
        shown = {**answer, "marks": ", ".join(marks)}
        table.add_row(*(escape(printable(shown[key])) for key in columns))
    return table


def as_text(content: Any) -> str:
    """Return what programs read: strict, indented JSON, with null for missing numbers."""
    return json_.dumps(jsonable(content), indent=2, ensure_ascii=False, allow_nan=False)
