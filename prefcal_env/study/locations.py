"""Locate, remove and rename studies: by path, or by name in the user's data folder."""

import os
import re
import sqlite3
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from pathlib import Path

from platformdirs import user_data_path

from prefcal_env.errors import StudyError

from .connection import connect, existing, open_elsewhere, publish, told, vacant

SUFFIX = ".prefcal"
SIMULATED = b"prefcal simulated 1 "
"""Beginning of a file that keeps the KPIs of simulated θ beside a study."""


def data_folder() -> Path:
    """Return the folder of named studies, which may not exist yet."""
    return user_data_path("prefcal", appauthor=False) / "studies"


def study_path(name_or_path: str) -> Path:
    """Return the file of a study: a path if it has a separator or a suffix, else by name.

    Raises:
        StudyError: If the name has characters other than letters, digits, "-" and "_".
    """
    if "/" in name_or_path or "\\" in name_or_path or Path(name_or_path).suffix:
        return Path(name_or_path)
    if not re.fullmatch(r"[A-Za-z0-9_-]{1,100}", name_or_path):
        raise StudyError(
            f"a study's name must consist of letters, digits, - and _ (a path has a / or a "
            f"suffix), got {name_or_path!r}"
        )
    return data_folder() / f"{name_or_path}{SUFFIX}"


def studies_in_data_folder() -> list[Path]:
    """Return the files of all named studies, by name."""
    return sorted(data_folder().glob(f"*{SUFFIX}"))


def simulated_beside(study: Path) -> Path:
    """Return the file that keeps the KPIs of simulated θ beside the file of a study."""
    stem = study.stem if study.suffix == SUFFIX else study.name
    return study.with_name(f"{stem}.simulated")


def is_simulated(path: Path) -> bool:
    """Return whether the file keeps KPIs of simulated θ, or is empty or missing."""
    try:
        with path.open("rb") as file:
            return file.read(len(SIMULATED)) in (SIMULATED, b"")
    except FileNotFoundError:
        return True
    except OSError:
        return False


def make_data_folder(path: Path) -> None:
    """Create the folder of named studies if `path` is in it; other folders must exist.

    Raises:
        StudyError: If it cannot be created.
    """
    if path.parent == data_folder():
        with told(path, "begin", "Nothing was recorded"):
            path.parent.mkdir(parents=True, exist_ok=True)


_PATIENCE = 0.5
"""Seconds to wait for another process to release the file."""


def remove_study(path: Path | str) -> None:
    """Remove the study file at `path`, readable or damaged.

    Raises:
        StudyError: If there is none, another process has it open, or it cannot be removed.
    """
    file = existing(path)
    with told(file, "remove", "Nothing was removed"), _alone(file):
        file.unlink()
    _remove_logs(file)
    kept = simulated_beside(file)
    if is_simulated(kept):
        kept.unlink(missing_ok=True)


def rename_study(old: Path | str, new: Path | str) -> None:
    """Move the study file at `old` to the path `new`, which must not exist.

    Raises:
        StudyError: If there is no such study, `new` exists, or another process has it open.
    """
    source, target = existing(old), vacant(new)
    with told(source, "rename", "Nothing was changed"), _alone(source):
        publish(source, target)
        source.unlink(missing_ok=True)
    _remove_logs(source)
    kept, moved = simulated_beside(source), simulated_beside(target)
    if is_simulated(kept) and is_simulated(moved):
        with suppress(OSError):  # they would be simulated again
            kept.replace(moved)


@contextmanager
def _alone(path: Path) -> Iterator[None]:
    """Lock the file: no other process has it open or can open it inside the block."""
    with ExitStack() as opened:
        try:
            connection = opened.enter_context(closing(connect(path, timeout=_PATIENCE)))
            # In this mode, the first access locks the whole file, or fails if it is in use.
            connection.execute("PRAGMA locking_mode = EXCLUSIVE")
            connection.execute("BEGIN EXCLUSIVE")
            connection.execute("COMMIT")
        except sqlite3.DatabaseError as error:
            code = getattr(error, "sqlite_errorcode", 0) & 0xFF
            if code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
                raise open_elsewhere(path) from error
            if code not in (sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_CORRUPT):
                raise
        if os.name != "posix":  # elsewhere an open file can be neither removed nor renamed
            opened.close()
        yield


def _remove_logs(path: Path) -> None:
    """Remove what SQLite may have left beside a removed file."""
    for suffix in ("-journal", "-wal", "-shm"):
        path.with_name(path.name + suffix).unlink(missing_ok=True)
