"""What `prefcal studies` does with study files."""

import json as json_
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from prefcal_env.errors import PrefcalError, StudyError
from prefcal_env.preference import Mark
from prefcal_env.studies import (
    Closed,
    State,
    StudyFile,
    export_csv,
    export_json,
    import_json,
    studies_in_data_folder,
    study_path,
    verify,
)
from prefcal_scenarios.cli.clock import wall_clock
from prefcal_scenarios.cli.described import open_described
from prefcal_scenarios.export import jsonable
from prefcal_scenarios.interview.memory import believed_best
from prefcal_scenarios.report.record import verdict_text
from prefcal_scenarios.report.wording import earlier_text, labelled, mark_text, number, printable


def existing(name: str) -> Path:
    """The file of a study. Raises StudyError if there is none."""
    path = study_path(name)
    if not path.is_file():
        raise StudyError(f"there is no study {name!r}: no file {path}")
    return path


def print_list(*, json: bool) -> None:
    """A row for each study in the data folder, those that cannot be read too."""
    rows = [_row(path) for path in studies_in_data_folder()]
    if json:
        print(_dumps(rows))
        return
    if not rows:
        print("No studies yet: prefcal calibrate cstr begins one.")
        return
    table = Table()
    for heading in ("study", "scenario", "experiments", "answers", "begun", "state"):
        table.add_column(heading, overflow="fold")
    for row in rows:
        table.add_row(*(escape(printable(row.get(k, ""))) for k in _COLUMNS))
    Console().print(table)


_COLUMNS = ("study", "scenario", "experiments", "answers", "begun", "state")


def _row(path: Path) -> dict[str, Any]:
    try:
        with open_described(path) as file:
            state = file.state
    except PrefcalError as error:
        return {"study": path.stem, "state": f"cannot be read: {error}"}
    return {"study": path.stem, **summary(state)}


def summary(state: State) -> dict[str, Any]:
    """A study in a few words, for people and programs."""
    return {
        "scenario": state.configuration["scenario"],
        "experiments": len(state.finished),
        "n_max": state.n_max,
        "answers": max(len(state.closed) - 1, 0) + len(state.further),
        "begun": _minute(state.created),
        "state": state.ended or "open",
    }


def print_study(name: str, *, json: bool) -> None:
    """One study: configuration, best θ, every answer."""
    path = existing(name)
    with open_described(path) as file:
        state = file.state
    content = {
        "study": name, "file": str(path), **summary(state), "best": best_theta(state),
        "calibrator": state.configuration["options"]["calibrator"],
        "agent": state.configuration["agent"]["agent"], "seed": state.configuration["seed"],
        "versions": state.configuration["versions"],
        "questions": list(_answers(state)),
        "earlier": state.configuration.get("earlier"),
        "notes": [{"at": at, "text": text} for at, text in state.notes],
    }  # fmt: skip
    if json:
        print(_dumps(content))
        return
    console = Console()
    for key in ("study", "file", "scenario", "calibrator", "agent", "seed", "begun", "state"):
        line = printable(f"{key:<12}{content[key]}")
        console.print(line, markup=False, highlight=False, soft_wrap=True)
    if content["earlier"]:
        line = printable(f"{'from':<12}{earlier_text(content['earlier'])}")
        console.print(line, markup=False, highlight=False, soft_wrap=True)
    done = f"{content['experiments']} of {state.n_max}"
    console.print(f"{'experiments':<12}{done}", highlight=False)
    units = {knob["name"]: knob["unit"] for knob in state.configuration["knobs"]}
    for knob, value in (content["best"] or {}).items():
        text = f"best {labelled(knob, units[knob])} = {number(value)}"
        console.print(printable(text), markup=False, highlight=False)
    if content["questions"]:
        console.print(_table(content["questions"]))


def _minute(at: str) -> str:
    """A time of the record, UTC, without seconds."""
    return at[:16].replace("T", " ")


def best_theta(state: State) -> dict[str, float] | None:
    """θ of the best so far by knob; None before the first experiment."""
    best = believed_best(state)
    if best is None:
        return None
    names = [knob["name"] for knob in state.configuration["knobs"]]
    return dict(zip(names, map(float, np.array(state.samples[best].theta)), strict=True))


def _answers(state: State) -> Iterator[dict[str, Any]]:
    for closed in state.answers:
        yield {
            "at": _minute(closed.at),
            "challenger": closed.challenger + 1,
            "incumbent": None if closed.incumbent is None else closed.incumbent + 1,
            "verdict": verdict_text(closed.answer),
            "marks": [mark.value for mark in closed.answer.marks],
            "automatic": [mark.value for mark in closed.answer.automatic],
            "comment": closed.comment,
            "blind": closed.blind,
            "said": _said(closed),
        }


def _said(closed: Closed) -> str:
    if closed.repeats is not None:
        return "asked again"
    return "retracted" if closed.retracted else ""


def _table(answers: list[Mapping[str, Any]]) -> Table:
    table = Table()
    columns = ("at", "challenger", "incumbent", "verdict", "marks", "comment", "said")
    for heading in ("when", "new", "best", "verdict", "marks", "comment", ""):
        table.add_column(heading, overflow="fold")
    for answer in answers:
        marks = (mark_text(Mark(m), automatic=m in answer["automatic"]) for m in answer["marks"])
        shown = {**answer, "marks": ", ".join(marks)}
        table.add_row(*(escape(printable(shown[key])) for key in columns))
    return table


def export_study(name: str, format_: str, out: Path | None) -> Path:
    """Write a study as JSON or CSV; return where."""
    path = existing(name)
    if out is not None and out.exists() and out.samefile(path):
        raise StudyError(f"{out} is the study itself: export it to another file")
    with StudyFile.open(path, clock=wall_clock) as file:
        if format_ == "csv":
            target = Path(path.stem) if out is None else out
            export_csv(file, target)
            return target
        target = Path(f"{path.stem}.json") if out is None else out
        text = export_json(file)
    try:
        target.write_text(text, encoding="utf-8")
    except OSError as error:
        raise StudyError(f"cannot write {target}: {error.strerror}") from error
    return target


def import_study(source: Path, name: str | None) -> Path:
    """Make a study file of exported JSON; return where."""
    try:
        text = source.read_text(encoding="utf-8")
    except OSError as error:
        raise StudyError(f"cannot read {source}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise StudyError(f"cannot read {source}: it is no text, nor an exported study") from error
    target = study_path(source.stem if name is None else name)
    if target.exists():
        raise StudyError(f"there is a study {target} already: name this one with --study")
    import_json(text, target)
    return target


def findings_of(name: str) -> tuple[int, tuple[str, ...]]:
    """How many events a study has, and what is wrong with them."""
    path = existing(name)
    findings = verify(path)
    if findings:
        return 0, tuple(findings)
    with StudyFile.open(path, clock=wall_clock) as file:
        return sum(1 for _ in file.events()), ()


def _dumps(content: Any) -> str:
    return json_.dumps(jsonable(content), indent=2, ensure_ascii=False, allow_nan=False)
