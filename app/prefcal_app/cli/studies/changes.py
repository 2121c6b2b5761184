"""Manage study files: rename, remove, export, import and check them."""

import sys
from collections.abc import Sequence
from pathlib import Path

from prefcal_env.errors import PrefcalError, StudyError
from prefcal_env.study import (
    StudyFile,
    data_folder,
    export_json,
    import_json,
    make_data_folder,
    remove_study,
    rename_study,
    study_path,
    verify,
)
from prefcal_env.study.exports import FORMATS as EXPORTS
from prefcal_scenarios.presentation.wording import printable

from .files import existing, open_described, summary, wall_clock


def rename(old: str, new: str) -> Path:
    """Rename the study called `old`; return its new file.

    Raises:
        StudyError: If there is no such study, `new` exists, or another process has it open.
    """
    source, target = existing(old), study_path(new)
    if target.exists():
        raise StudyError(f"there is a study {new!r} already: choose another name")
    make_data_folder(target)
    rename_study(source, target)
    return target


def remove(names: Sequence[str], *, yes: bool) -> int:
    """Remove the studies called `names`, each after confirmation unless `yes`; return exit code.

    Raises:
        StudyError: If there is no such study, a file is not a study, or another process has it
            open; the studies named before it are removed.
    """
    named = {name: existing(name) for name in names}  # check all names before removing anything
    described = {name: _described(name, path) for name, path in named.items()}
    if not yes and not sys.stdin.isatty():
        raise StudyError("cannot ask for confirmation here: add --yes to remove without a question")
    kept = 0
    for name, path in named.items():
        if not yes and not _confirmed(described[name]):
            kept += 1
            continue
        remove_study(path)
        print(f"Removed: {printable(name)}")
    return 1 if kept else 0


def _described(name: str, path: Path) -> str:
    """Return a short description of the study. Raises StudyError if the file is not a study."""
    try:
        with open_described(path) as file:
            row = summary(file.state)
    except PrefcalError as error:
        if path.parent != data_folder():
            raise StudyError(f"{path} is not removed: {error}") from error
        return f"study {name!r}, which cannot be read"
    counts = f"{row['experiments']} experiments, {row['answers']} answers"
    return f"study {name!r} ({printable(row['scenario'])}, {counts})"


def _confirmed(what: str) -> bool:
    try:
        return input(f"Remove {what} for good? [y/N] ").strip().lower() in ("y", "yes")
    except EOFError:
        return False


def export_study(name: str, format_: str, out: Path | None) -> Path:
    """Write a study as JSON, CSV or Parquet; return the path."""
    path = existing(name)
    if out is not None and out.exists() and out.samefile(path):
        raise StudyError(f"{out} is the study itself: export it to another file")
    with StudyFile.open(path, clock=wall_clock, reading=True) as file:
        if format_ in EXPORTS:
            return EXPORTS[format_](file, Path(path.stem) if out is None else out)
        text = export_json(file)
    target = Path(f"{path.stem}.json") if out is None else out
    _write(target, text)
    return target


def import_study(source: Path, name: str | None) -> Path:
    """Create a study file from exported JSON; return its path."""
    try:
        text = source.read_text(encoding="utf-8")
    except OSError as error:
        raise StudyError(f"cannot read {source}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise StudyError(f"cannot read {source}: it is not an exported study") from error
    target = study_path(source.stem if name is None else name)
    if target.exists():
        raise StudyError(f"there is a study {target} already: name this one with --study")
    import_json(text, target)
    return target


def findings_of(name: str) -> tuple[int, tuple[str, ...]]:
    """Return the number of events of a study, and the problems found in them."""
    path = existing(name)
    findings = verify(path)
    if findings:
        return 0, tuple(findings)
    with StudyFile.open(path, clock=wall_clock, reading=True) as file:
        return sum(1 for _ in file.events()), ()


def _write(target: Path, text: str) -> None:
    try:
        target.write_text(text, encoding="utf-8")
    except OSError as error:
        raise StudyError(f"cannot write {target}: {error.strerror or error}") from error
