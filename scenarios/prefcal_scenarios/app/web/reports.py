"""The folder of the finished report, as far as the page may show it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

TYPES: Mapping[str, str] = {
    ".png": "image/png",
    ".gif": "image/gif",
    ".csv": "text/csv; charset=utf-8",
    ".json": "application/json",
    ".html": "text/html; charset=utf-8",
}


@dataclass(slots=True)
class Reports:
    """Where the finished report is, which is known only at the end.

    Args:
        folder: Of the report; None until it is written.
        changed: Called after the folder became known.
    """

    folder: Path | None = None
    changed: Callable[[], None] = lambda: None

    def put(self, folder: Path | None) -> None:
        """Make the report known."""
        self.folder = folder
        self.changed()

    def read(self, name: str) -> tuple[bytes, str] | None:
        """Content and type of the report's file called `name`; None if there is none to show."""
        media_type = TYPES.get(Path(name).suffix)
        if self.folder is None or media_type is None or name.startswith("."):
            return None
        try:
            # Compared with what is there, never joined: no name can lead out of the folder.
            for path in self.folder.iterdir():
                if path.name == name and path.is_file() and not path.is_symlink():
                    return path.read_bytes(), media_type
        except OSError:
            pass
        return None
