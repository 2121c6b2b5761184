"""`--twin`: many θ are simulated on a model, and only those shown run on the plant."""

import json

import pytest

from support import twins
from support.studies import state_of

PLANT, MODEL = (f"{twins.__file__}:{name}" for name in ("plant", "model"))
UNATTENDED = ["--calibrator", "synthetic", "--json", "--out", "out"]


@pytest.fixture
def study(prefcal):
    """The name of a finished study with a twin, and what it printed."""
    words = [*UNATTENDED, "--simulate", "40", "--n-max", "4", "--study", "mine"]
    code, out, err = prefcal("calibrate", PLANT, "--twin", MODEL, *words)
    assert code == 0, err
    return "mine", json.loads(out), err


def test_a_study_simulates_on_its_twin_and_remembers_it(prefcal, study):
    name, result, err = study
    assert 4 < result["simulated"] <= 40
    assert "simulated on the twin, 4 shown" in err
    assert state_of(name).configuration["options"]["twin"] == MODEL
    assert prefcal("report", name, "--scenario", PLANT, "--json", "--out", "report")[0] == 0


def test_it_goes_on_with_its_twin_only(done, refused, study):
    words = ["calibrate", PLANT, "--study", study[0], "--json", "--out", "out", "--n-max", "5"]
    assert f"if you trust it, add --twin {MODEL}" in refused(*words)
    assert "was started with --twin" in refused(*words, "--twin", "lag")
    out = done(*words, "--twin", MODEL)
    assert json.loads(out)["experiments"] == 5
