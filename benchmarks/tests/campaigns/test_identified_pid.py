"""The campaign of PIDs on identified models: the truth is what it says, and its judges can say no."""

import importlib
import json
from pathlib import Path

import numpy as np
import pytest

from prefcal_env.plants.identify import identify

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def campaign():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT / "benchmarks" / "campaigns")
        yield importlib.import_module("identified_pid")


@pytest.fixture(scope="module")
def judged(campaign):
    plant = campaign.truth(203)
    found = identify(plant.t, plant.u, plant.y, resolution=plant.resolution, count=20)
    return plant, found, *campaign.scenarios_of(plant, found)


def test_the_second_scenario_runs_on_the_true_plant(judged):
    plant, _, model, true = judged
    theta = model.references["MIGO"]
    made = true.run(theta)
    assert not np.array_equal(made.y, model.run(theta).y)
    # What the input does at the end of the run is what the true gain needs for the set point.
    gain = plant.num[-1] / plant.den[-1]
    before_load = np.searchsorted(made.t, 0.49 * made.t[-1])
    moved = made.u[before_load, 0] - plant.u[0]
    assert made.y[before_load, 0] - made.y[0, 0] == pytest.approx(gain * moved, rel=0.1)


def test_a_tuning_that_oscillates_does_not_settle(campaign, judged):
    _, _, model, true = judged
    assert campaign.settles(true.run(model.references["MIGO"]))
    (K_p, *others) = model.space.knobs
    wild = np.array([max(K_p.low, K_p.high, key=abs), *(knob.low for knob in others)])
    assert not campaign.settles(true.run(wild))


def test_a_row_has_both_tunings_and_resumes(campaign, tmp_path, capsys, monkeypatch):
    words = ["--records", "1", "--first", "204", "--simulated", "40", "--out", str(tmp_path)]
    campaign.main(words)
    (row,) = map(json.loads, (tmp_path / "identified.jsonl").read_text().splitlines())
    assert len(row["theta"]) == len(row["SIMC"]) == 4
    assert row["verdict"] in ("CHALLENGER", "TIE", "INCUMBENT")
    monkeypatch.setattr(campaign, "row_of", lambda *given: pytest.fail("run again"))
    campaign.main(words)
    assert "1 records, 0 refused; SIMC has a rule for 1" in capsys.readouterr().out


def test_shares_are_told_with_their_intervals(campaign):
    told = {"settles": True, "settles on the model": True, "SIMC settles": True}
    rows = [told | {"verdict": one} for one in ("CHALLENGER", "TIE", "INCUMBENT", "CHALLENGER")]
    others = [{"settles": False, "settles on the model": wanted} for wanted in (True, False)]
    lines = campaign.summary([*rows, *others, {"refused": "too short"}])
    assert lines[0] == "7 records, 1 refused; SIMC has a rule for 4"
    assert [line.partition(": ")[2] for line in lines[1:]] == [
        "4 of 6 (22 to 96 %)",
        "4 of 5 (28 to 99 %)",
        "4 of 4 (40 to 100 %)",
        "2 of 4 (7 to 93 %)",
        "1 of 4 (1 to 81 %)",
    ]
