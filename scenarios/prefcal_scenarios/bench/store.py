"""The folder of results: one file each, written as it lands, found by the key of its cell.

Results of several suites may share a folder, and several processes may write into it: two that
compute the same cell write the same.
"""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, final

from prefcal_env.errors import PrefcalError
from prefcal_scenarios.report.folder import folder_for

from .cell import Cell
from .duels import Duel, Round
from .records import DamagedError, read_record, write_record
from .result import Result

Trouble = str
"""What is wrong with a file, in words; empty if nothing is."""


@final
class Store:
    """Results by cell and duels by round, in subfolders of `folder`.

    A file that is damaged, or holds something else, counts as absent and is replaced when its
    cell has run again.

    Raises:
        SettingsError: the folder is a file, or cannot be made or written to.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = folder_for(folder)
        self._results = folder_for(self.folder / "results")
        self._duels = folder_for(self.folder / "duels")

    def find(self, cell: Cell) -> tuple[Result | None, Trouble]:
        """The result of `cell`, if there is one.

        Raises:
            BenchmarkError: another version of prefcal has written it, or it cannot be read.
        """
        path = self.path(cell)
        content, trouble = _content(path)
        if content is None:
            return None, trouble
        try:
            result = Result.from_dict(content)
        except PrefcalError as error:
            return None, f"{path}: {error}"
        if result.cell != cell:
            return None, f"{path} holds {result.cell} in place of {cell}"
        return result, ""

    def add(self, result: Result) -> None:
        """Keep `result`, durably. Raises BenchmarkError if it cannot be written."""
        write_record(self.path(result.cell), result.to_dict())

    def path(self, cell: Cell) -> Path:
        """Where the result of `cell` is kept."""
        return self._results / f"{cell.key}.json"

    def duels(self, round_: Round) -> tuple[tuple[Duel, ...] | None, Trouble]:
        """The duels of `round_`, if they have been played.

        Raises:
            BenchmarkError: as `find`.
        """
        path = self._duels / f"{round_.key}.json"
        content, trouble = _content(path)
        if content is None:
            return None, trouble
        try:
            return tuple(Duel(**duel) for duel in content), ""
        except (TypeError, PrefcalError) as error:
            return None, f"{path}: {error}"

    def add_duels(self, round_: Round, duels: Sequence[Duel]) -> None:
        """Keep the duels of `round_`, durably. Raises BenchmarkError if that is impossible."""
        write_record(self._duels / f"{round_.key}.json", [asdict(duel) for duel in duels])


def _content(path: Path) -> tuple[Any, Trouble]:
    try:
        return read_record(path), ""
    except FileNotFoundError:
        return None, ""
    except DamagedError as error:
        return None, str(error)
