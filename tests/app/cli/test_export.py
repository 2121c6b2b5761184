"""`prefcal export`: what it prints and writes, and what it refuses."""

import json

import pytest

from prefcal_env import PID
from prefcal_env.controllers import as_data


@pytest.fixture
def best(tmp_path):
    """Write the best.json of a heater."""
    content = {
        "format": 1,
        "scenario": "somewhere/own.py:heater",  # which is not there, and not needed
        "title": "Heater",
        "theta": {"K_p": 2.0},
        "units": {"K_p": "%/°C"},
        "settings": as_data(PID(2.0, 120.0, 10.0, T_s=1.0, low=0.0, high=100.0)),
        "channels": {"time_unit": "s", "x": [], "u": [["valve", "%"]], "y": [["T", "°C"]]},
    }
    (tmp_path / "best.json").write_text(json.dumps(content))
    return "best.json"


def test_structured_text_goes_to_a_file_or_is_printed(prefcal, best, tmp_path):
    code, out, err = prefcal("export", best, "--to", "st", "--name", "Heater")
    assert (code, err) == (0, "")
    assert "FUNCTION_BLOCK Heater\n" in out
    code, told, _ = prefcal("export", best, "--to", "st", "--name", "Heater", "--out", "heater.st")
    assert (code, told.strip()) == (0, "Written: heater.st")
    assert (tmp_path / "heater.st").read_text() == out


def test_forms_are_in_the_units_and_ranges_of_the_control_system(prefcal, best):
    code, out, _ = prefcal("export", best, "--to", "forms", "--time", "min", "--ranges", "-20:180,0:100")
    assert code == 0
    lines = [" ".join(line.split()) for line in out.splitlines()]
    assert {"T_i 2 min", "K 4 %/%", "PB (proportional band) 25 %"} <= set(lines)  # 2 %/°C over 200 °C


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--to", "ladder"], "'ladder' is not one of 'st', 'c', 'forms'"),
        (["--to", "st", "--name", "1st"], "the name of a controller's code must be"),
        (["--to", "forms", "--ranges", "200"], "--ranges must look like 0:200,0:100"),
        (["--to", "forms", "--ranges", "1.2.3:4,0:1"], "--ranges must look like 0:200,0:100"),
        (["--to", "forms", "--ranges", "200:0,0:100"], "low first, then high"),
        (["--to", "forms", "--ranges", "0:200,5:5"], "low first, then high"),
        (["--to", "c", "--out", "nowhere/pid.h"], "--out must be in an existing folder"),
    ],
)
def test_what_cannot_be_written_says_why(prefcal, best, words, said):
    code, out, err = prefcal("export", best, *words)
    assert code != 0
    assert out == ""
    assert said in " ".join(err.split())
