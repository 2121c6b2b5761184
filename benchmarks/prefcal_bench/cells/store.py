"""Store results in a folder, one file each, named by the key of the cell.

Several suites can share a folder, and several processes can write to it: if two compute the same
cell, both write the same content. Files appear whole or not at all, and damage is detected.
"""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeVar, final

import msgspec

from prefcal_env.disk import write_durably
from prefcal_env.errors import BenchmarkError, PrefcalError, SettingsError
from prefcal_scenarios.wording import folder_for

from .cell import FORMAT, Cell, Result, canonical, read_as
from .duels import Duel, Round

T = TypeVar("T")
Trouble = str  # description of a problem with a file; empty if there is none


@final
class Store:
    """Results by cell and duels by round, in subfolders of `folder`.

    A file that is damaged or holds other content counts as missing, and is replaced when its cell
    has run again.

    Raises:
        SettingsError: If the folder is a file, or cannot be made or written to.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = folder_for(folder)
        self._results = folder_for(self.folder / "results")
        self._duels = folder_for(self.folder / "duels")

    def path(self, of: Cell | Round) -> Path:
        """Return the path of the result of a cell, or of the duels of a round."""
        return (self._results if isinstance(of, Cell) else self._duels) / f"{of.key}.json"

    def find(self, cell: Cell) -> tuple[Result | None, Trouble]:
        """Return the result of `cell`, None if there is none, and any problem with its file.

        Raises:
            BenchmarkError: If another version of prefcal wrote it, or it cannot be read.
        """

        def convert(content: Any) -> Result:
            result = Result.from_dict(content)
            if result.cell != cell:
                raise SettingsError(f"it holds {result.cell} in place of {cell}")
            return result

        return _find(self.path(cell), convert)

    def add(self, result: Result) -> None:
        """Store `result` durably. Raises BenchmarkError if it cannot be written."""
        write_record(self.path(result.cell), result.to_dict())

    def duels(self, round_: Round) -> tuple[tuple[Duel, ...] | None, Trouble]:
        """Return the duels of `round_`, None if not yet played, and any problem with their file.

        Raises:
            BenchmarkError: See `find`.
        """
        return _find(self.path(round_), lambda content: tuple(read_as(Duel, duel) for duel in content))

    def add_duels(self, round_: Round, duels: Sequence[Duel]) -> None:
        """Store the duels of `round_` durably. Raises BenchmarkError if they cannot be written."""
        write_record(self.path(round_), [asdict(duel) for duel in duels])


def _find(path: Path, convert: Callable[[Any], T]) -> tuple[T | None, Trouble]:
    try:
        content = read_record(path)
    except FileNotFoundError:
        return None, ""
    except DamagedError as error:
        return None, str(error)
    try:
        return convert(content), ""
    except (TypeError, PrefcalError) as error:
        return None, f"{path}: {error}"


class DamagedError(ValueError):
    """Error for a file that holds no record, or an incomplete one."""


class _Record(msgspec.Struct, forbid_unknown_fields=True):
    """A file: its content with a checksum. The content of other formats is not read."""

    format: Any
    sha256: str
    content: Any


def write_record(path: Path, content: Any) -> None:
    """Write `content` to `path`; after this returns, it survives a crash of the machine.

    A concurrent reader sees either the old file or the new one; of two concurrent writers, the
    later one wins.

    Raises:
        BenchmarkError: If it cannot be written; no partial file is left.
    """
    record = {"format": FORMAT, "sha256": _checksum(content), "content": content}
    try:
        write_durably(path, (canonical(record) + "\n").encode())
    except OSError as error:
        raise BenchmarkError(f"cannot write {path}: {error.strerror}") from error


def read_record(path: Path) -> Any:
    """Return the content that `write_record` wrote.

    Raises:
        FileNotFoundError: If there is no file.
        DamagedError: If the file holds other content, or is incomplete.
        BenchmarkError: If a newer prefcal wrote it, or it cannot be read.
    """
    try:
        record = msgspec.json.decode(path.read_bytes(), type=_Record)
    except FileNotFoundError:
        raise
    except OSError as error:
        raise BenchmarkError(f"cannot read {path}: {error.strerror}") from error
    except msgspec.ValidationError as error:
        raise DamagedError(f"{path} is not a record of the benchmark: {error}") from error
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise DamagedError(f"{path} is cut off or no record: {error}") from error
    if record.format != FORMAT:
        raise BenchmarkError(
            f"{path} has format {record.format!r}, this prefcal reads {FORMAT}: use the one "
            "that wrote it, or another folder"
        )
    if record.sha256 != _checksum(record.content):
        raise DamagedError(f"{path} was changed: its checksum does not fit")
    return record.content


def _checksum(content: Any) -> str:
    return hashlib.sha256(canonical(content).encode()).hexdigest()
