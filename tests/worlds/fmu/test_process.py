"""An FMU is unpacked into a folder of its own; those of killed processes do not pile up."""

import os
import subprocess
import sys
import zipfile

import pytest

from prefcal_env.errors import PlantError
from prefcal_env.worlds.fmu.loop import unpacked


@pytest.fixture
def there(tmp_path, monkeypatch):
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    return folder


def test_what_a_killed_process_left_is_removed_after_a_day(there, tmp_path):
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    names = {"old": f"{dead.pid}-a", "new": f"{dead.pid}-b", "alive": f"{os.getpid()}-c"}
    folders = {what: there / f"prefcal-fmu-{name}" for what, name in names.items()}
    folders["foreign"] = there / "prefcal-fmu-mine-d"
    for what, folder in folders.items():
        (folder / "fmu").mkdir(parents=True)
        if what != "new":
            os.utime(folder, (0, 0))
    with zipfile.ZipFile(tmp_path / "loop.fmu", "w") as content:
        content.writestr("modelDescription.xml", "<x/>")
    home = unpacked(tmp_path / "loop.fmu")
    assert (home / "fmu" / "modelDescription.xml").read_text() == "<x/>"
    assert {what for what, folder in folders.items() if not folder.exists()} == {"old"}


def test_a_file_that_is_no_zip_leaves_nothing(there, tmp_path):
    (tmp_path / "loop.fmu").write_text("text")
    with pytest.raises(PlantError, match="cannot unpack the FMU"):
        unpacked(tmp_path / "loop.fmu")
    assert list(there.iterdir()) == []
