"""Locate studies: by path, or by name in the user's data folder."""

import re
from pathlib import Path

from platformdirs import user_data_path

from prefcal_env.errors import StudyError

from .trouble import told

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
