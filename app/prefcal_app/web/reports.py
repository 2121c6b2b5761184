"""Read the files of the finished report that the page may show."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

TYPES: Mapping[str, str] = {
    ".png": "image/png",
    ".csv": "text/csv; charset=utf-8",
    ".json": "application/json",
    ".html": "text/html; charset=utf-8",
}


@dataclass(slots=True)
class Reports:
    """The location of the finished report, known only at the end.

    Args:
        folder: Folder of the report; None until it is written.
        changed: Function to call once the folder is known.
    """

    folder: Path | None = None
    changed: Callable[[], None] = lambda: None

    def put(self, folder: Path | None) -> None:
        """Set the folder of the report."""
        self.folder = folder
        self.changed()

    def read(self, name: str) -> tuple[bytes, str] | None:
        """Return content and type of the report's file `name`, or None if it cannot be shown."""
        media_type = TYPES.get(Path(name).suffix)
        if self.folder is None or media_type is None or name.startswith("."):
            return None
        try:
            # Compare with existing names instead of joining paths: no name can leave the folder.
            for path in self.folder.iterdir():
                if path.name == name and path.is_file() and not path.is_symlink():
                    return path.read_bytes(), media_type
        except OSError:
            pass
        return None
