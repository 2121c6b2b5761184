"""Where studies lie: a path as it is said, or a name in the user's data folder."""

import re
from pathlib import Path

from platformdirs import user_data_path

from prefcal_env.errors import StudyError

from .trouble import told

SUFFIX = ".prefcal"


def data_folder() -> Path:
    """The folder of named studies; it may not be there yet."""
    return user_data_path("prefcal", appauthor=False) / "studies"


def study_path(name_or_path: str) -> Path:
    """The file of a study: a path if it holds a separator or a suffix, else a name.

    Raises:
        StudyError: a name with other characters than letters, digits, "-" and "_".
    """
    if "/" in name_or_path or "\\" in name_or_path or Path(name_or_path).suffix:
        return Path(name_or_path)
    if not re.fullmatch(r"[A-Za-z0-9_-]{1,100}", name_or_path):
        raise StudyError(
            f"a study's name holds letters, digits, - and _ (a path holds a / or a suffix), "
            f"got {name_or_path!r}"
        )
    return data_folder() / f"{name_or_path}{SUFFIX}"


def studies_in_data_folder() -> list[Path]:
    """The files of all named studies, by name."""
    return sorted(data_folder().glob(f"*{SUFFIX}"))


def make_data_folder(path: Path) -> None:
    """Make the folder of named studies if `path` is to lie in it; others have to be there.

    Raises:
        StudyError: it cannot be made.
    """
    if path.parent == data_folder():
        with told(path, "begin", "Nothing was recorded"):
            path.parent.mkdir(parents=True, exist_ok=True)
