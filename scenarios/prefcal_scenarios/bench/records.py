"""One JSON record in one file: there whole or not at all, and known when it is damaged."""

import hashlib
import json
import os
from pathlib import Path
from typing import Any
from uuid import uuid4

from prefcal_env.errors import BenchmarkError

from .cell import FORMAT, canonical


class DamagedError(ValueError):
    """A file is no record, or only half of one; the message says how."""


def write_record(path: Path, content: Any) -> None:
    """Keep `content` at `path`: when this returns, it survives a crash of the machine.

    Whoever reads at the same time finds the old file or the new one; of two who write at the
    same time, the later one stays.

    Raises:
        BenchmarkError: it cannot be written; nothing of it is left then.
    """
    record = {"format": FORMAT, "sha256": _checksum(content), "content": content}
    half = path.with_name(f".{uuid4().hex}.half")
    try:
        with half.open("x", encoding="utf-8") as file:
            file.write(canonical(record) + "\n")
            file.flush()
            os.fsync(file.fileno())
        half.replace(path)
        _sync(path.parent)
    except OSError as error:
        raise BenchmarkError(f"cannot write {path}: {error.strerror}") from error
    finally:
        half.unlink(missing_ok=True)


def read_record(path: Path) -> Any:
    """Return what `write_record` has kept.

    Raises:
        FileNotFoundError: there is no file.
        DamagedError: it is something else, or incomplete.
        BenchmarkError: it was written by a newer prefcal, or cannot be read.
    """
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise
    except OSError as error:
        raise BenchmarkError(f"cannot read {path}: {error.strerror}") from error
    except ValueError as error:  # neither UTF-8 nor JSON
        raise DamagedError(f"{path} is cut off or no record: {error}") from error
    if not isinstance(record, dict) or set(record) != {"format", "sha256", "content"}:
        raise DamagedError(f"{path} is no record of the benchmark")
    if record["format"] != FORMAT:
        raise BenchmarkError(
            f"{path} has format {record['format']!r}, this prefcal reads {FORMAT}: use the one "
            "that has written it, or another folder"
        )
    try:
        sound = record["sha256"] == _checksum(record["content"])
    except ValueError:  # a NaN, which we do not write
        sound = False
    if not sound:
        raise DamagedError(f"{path} was changed: its checksum does not fit")
    return record["content"]


def _checksum(content: Any) -> str:
    return hashlib.sha256(canonical(content).encode()).hexdigest()


def _sync(folder: Path) -> None:
    """Make a file's new name durable, where the system can."""
    if os.name == "posix":
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
