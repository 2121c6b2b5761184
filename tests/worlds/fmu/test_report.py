"""A study of an FMU is reported by its file alone."""

import json

import pytest

from worlds.fmu.building import built


def test_the_report_of_an_fmu_is_written_from_another_folder_by_its_file_alone(
    prefcal, done, refused, tmp_path, monkeypatch
):
    pytest.importorskip("fmpy")
    pytest.importorskip("pythonfmu")
    fmu = built(tmp_path, "Tank")
    cost = ("--cost", "integrated error of level")
    line = f"calibrate {fmu.name} --knob K_p=0.1:100:log --reference level=2 --calibrator synthetic "
    line += "--simulate 0 --n-max 3 --study tank.prefcal --out out"
    out = done(*line.split(), *cost)
    assert "--knob K_p=0.1:100:log" in out  # and no emoji for ":100:"
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    assert "if you trust it, add --scenario Tank2.fmu" in refused("report", "../tank.prefcal", *cost)
    done("report", "../tank.prefcal", *cost, "--scenario", f"../{fmu.name}", "--out", "again")
    best, again = (
        json.loads((folder / "best.json").read_text()) for folder in (tmp_path / "out", elsewhere / "again")
    )
    assert again["theta"] == best["theta"]
    assert (elsewhere / "again" / "report.html").is_file()
