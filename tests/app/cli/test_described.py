"""Scenarios described by files and options, on the command line."""

import json

import pytest

OVEN = """
[rig.outputs]
temperature = { unit = "°C" }
[rig.inputs]
power = { unit = "%", low = 0, high = 100 }
[reference]
temperature = 200
[knobs]
K_p = "0.5:20:log %/K"
"""


@pytest.fixture(autouse=True)
def _files(tmp_path):
    (tmp_path / "oven.toml").write_text(OVEN, encoding="utf-8")


def test_a_file_is_checked_and_the_next_command_is_told(prefcal, done):
    out = done("check", "oven.toml", "--knob", "K_i=0.1:1:log 1/s")
    told = " ".join(out.split())
    assert "2: K_p (0.5 to 20 %/K, log), K_i (0.1 to 1 1/s, log)" in told
    assert "prefcal calibrate oven.toml --knob 'K_i=0.1:1:log 1/s'" in told


def test_the_check_of_a_file_that_is_wrong_names_the_key(prefcal, tmp_path):
    (tmp_path / "oven.toml").write_text(f"knbos = 1\n{OVEN}", encoding="utf-8")
    code, out, _ = prefcal("check", "oven.toml", "--json")
    assert code == 1
    assert "Did you mean 'knobs'?" in json.loads(out)["checks"][0]["words"]
