"""What `prefcal studies rm` and `prefcal studies rename` do."""

import sys
from collections.abc import Sequence
from pathlib import Path

from prefcal_env.errors import PrefcalError, StudyError
from prefcal_env.studies import (
    data_folder,
    make_data_folder,
    remove_study,
    rename_study,
    study_path,
)
from prefcal_scenarios.cli.described import open_described
from prefcal_scenarios.cli.shelf import existing, summary
from prefcal_scenarios.report.wording import printable


def rename(old: str, new: str) -> Path:
    """Rename the study called `old`; return its new file.

    Raises:
        StudyError: no such study, `new` exists, or another process has it open.
    """
    source, target = existing(old), study_path(new)
    if target.exists():
        raise StudyError(f"there is a study {new!r} already: choose another name")
    make_data_folder(target)
    rename_study(source, target)
    return target


def remove(names: Sequence[str], *, yes: bool) -> int:
    """Remove the studies called `names`, each after a question unless `yes`; the exit code.

    Raises:
        StudyError: no such study, no study at all, or another process has it open; what was
            named before it is removed.
    """
    named = {name: existing(name) for name in names}  # a wrong name before anything is removed
    described = {name: _described(name, path) for name, path in named.items()}
    if not yes and not sys.stdin.isatty():
        raise StudyError("nobody is here to confirm: add --yes to remove without a question")
    kept = 0
    for name, path in named.items():
        if not yes and not _confirmed(described[name]):
            kept += 1
            continue
        remove_study(path)
        print(f"Removed: {printable(name)}")
    return 1 if kept else 0


def _described(name: str, path: Path) -> str:
    """The study in a few words. Raises StudyError for a file that is none of ours."""
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
