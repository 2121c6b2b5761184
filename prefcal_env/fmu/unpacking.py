"""Unpack an FMU into a temporary folder, and remove the folders of processes that were killed."""

import os
import shutil
import tempfile
import time
import zipfile
from contextlib import suppress
from pathlib import Path

from prefcal_env.errors import PlantError

_PREFIX = "prefcal-fmu-"
_OLD = 24 * 3600.0
"""Seconds after which the folder of a process that is gone is removed: a process of a container
can look as if it were."""


def unpacked(path: Path) -> Path:
    """Return a new folder, with the contents of the FMU in its folder "fmu".

    Raises:
        PlantError: If it cannot be unpacked.
    """
    _remove_leftovers()
    home = Path(tempfile.mkdtemp(prefix=f"{_PREFIX}{os.getpid()}-"))
    try:
        with zipfile.ZipFile(path) as content:
            content.extractall(home / "fmu")
    except BaseException as error:  # Ctrl-C, too
        shutil.rmtree(home, ignore_errors=True)
        if not isinstance(error, OSError | zipfile.BadZipFile):
            raise
        raise PlantError(f"cannot unpack the FMU {str(path)!r}: {error}") from error
    return home


def _remove_leftovers() -> None:
    """Remove old folders of ours whose process was killed before it could remove them."""
    if os.name != "posix":
        return
    for folder in Path(tempfile.gettempdir()).glob(f"{_PREFIX}*-*"):
        with suppress(OSError, ValueError):
            found = folder.lstat()
            mine = found.st_uid == os.getuid() and time.time() - found.st_mtime > _OLD
            if mine and not _runs(int(folder.name.removeprefix(_PREFIX).partition("-")[0])):
                shutil.rmtree(folder, ignore_errors=True)


def _runs(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True
