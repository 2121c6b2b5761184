"""What a calibration leaves behind, for several tests to copy: made once, as a user makes it."""

import shutil
from pathlib import Path

import pytest

from prefcal_app.cli import main


def without_figures(patch: pytest.MonkeyPatch) -> None:
    """Write reports without figures, which take most of their time."""
    patch.setattr("prefcal_app.report.write.draw", lambda record, extra: ())


def calibrated(folder: Path, *words: str) -> Path:
    """Run `prefcal calibrate` with these words in `folder`, where its data are kept, too."""
    with pytest.MonkeyPatch.context() as patch:
        without_figures(patch)
        patch.chdir(folder)
        patch.setenv("XDG_DATA_HOME", str(folder / "data"))
        patch.setattr("sys.argv", ["prefcal", "calibrate", *words])
        with pytest.raises(SystemExit) as end:
            main()
    assert not end.value.code
    return folder


def copied(made: Path, folder: Path) -> None:
    """Put a copy of what was made into `folder`."""
    shutil.copytree(made, folder, dirs_exist_ok=True)
