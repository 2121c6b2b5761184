"""`prefcal identify`: numbers with intervals, a picture, and the plant that `calibrate` takes."""

import json

import pytest

from support.step_tests import T, U, response, table


@pytest.fixture(autouse=True)
def _record(tmp_path):
    (tmp_path / "step.csv").write_text(table(), encoding="utf-8")


def test_numbers_picture_and_plant_are_said_and_kept_and_the_next_command_works(done, tmp_path):
    said = done("identify", "step.csv")
    assert said.startswith("temperature by valve, 200 rows; time from 'time' in s\nA lag, ")
    (gain,) = [line.split() for line in said.splitlines() if line.strip().startswith("gain")]
    best, low, high, models = map(float, gain[2:])
    assert gain[1] == "[°C/%]"
    assert low <= best <= high
    assert best == pytest.approx(1.8, rel=0.05)
    assert models == 300
    assert "around the start, temperature = 52 °C and valve = 40 %; valve may reach 0 to 100 %" in said
    assert (tmp_path / "step.png").read_bytes()[:4] == b"\x89PNG"
    assert len(json.loads((tmp_path / "step.plant.json").read_text(encoding="utf-8"))["models"]) == 300
    assert said.splitlines()[-1] == "Next:    prefcal calibrate pid --plant step.csv"
    for named in ("step.csv", "step.plant.json"):
        checked = done("check", "pid", "--plant", named)
        assert f"All in order. Start with: prefcal calibrate pid --plant {named}" in checked


def test_columns_units_limits_and_picture_can_be_named(done, tmp_path):
    columns = (T, response(2), response(), U)
    (tmp_path / "log.csv").write_text(table("s", "T1", "T2", "MV", columns=columns))
    options = ["--time", "s", "--input", "MV", "--output", "T2", "--unit", "T2=K", "--limits", "20:80"]
    said = done("identify", "log.csv", *options, "--out", "look.png")
    assert said.startswith("T2 by MV, 200 rows")
    assert "MV may reach 20 to 80 (--limits)" in said
    said = done("identify", "log.csv", *options[:-2], "--out", "look.png")  # no unit, no limits
    assert "which is assumed, twice as far as the record moves it: state --limits." in said
    assert "Noise of 0.0" in said
    assert " K over the record." in said
    assert (tmp_path / "look.png").is_file()
    # The record names the plant that was found with these options.
    assert said.splitlines()[-1] == "Next:    prefcal calibrate pid --plant log.csv"
    assert "PID of T2 by MV" in done("check", "pid", "--plant", "log.csv")


def test_the_next_command_is_quoted_and_none_is_said_if_the_plant_cannot_be_kept(done, tmp_path):
    (tmp_path / "step.csv").rename(tmp_path / "my step.csv")
    said = done("identify", "my step.csv")
    assert said.splitlines()[-1] == "Next:    prefcal calibrate pid --plant 'my step.csv'"
    (tmp_path / "my step.plant.json").unlink()
    (tmp_path / "my step.plant.json").mkdir()
    said = done("identify", "my step.csv")
    assert "Plant:   not kept, since my step.plant.json cannot be written: " in said
    assert "Next:" not in said


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--limits", "80"], "--limits must be LOW:HIGH"),
        (["--limits", "0:45"], "valve is 40 to 46 %, beyond its limits 0 to 45"),
        (["--output", "level"], "no column of numbers is called 'level'"),
        (["--out", "look.jpg"], "png"),
        (["--unit", "valve"], "--unit must look like level=m"),
    ],
)
def test_what_cannot_be_is_refused_before_a_picture_is_drawn(refused, tmp_path, options, said):
    assert said in refused("identify", "step.csv", *options)
    assert not (tmp_path / "step.png").exists()
    assert not (tmp_path / "step.plant.json").exists()


def test_a_plant_that_is_neither_a_program_nor_a_record_is_refused(refused):
    said = refused("calibrate", "pid", "--plant", "step.mat")
    assert "path/to/model.py:NAME or the record of a step test, step.csv, got 'step.mat'" in said
