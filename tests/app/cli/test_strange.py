"""Studies that somebody else made, whose configuration is not what calibrate writes."""

import json

import pytest

from prefcal_app.cli.options import Options
from prefcal_app.cli.parameters import kept_by
from prefcal_env.study import StudyFile, export_json
from support.interviews import clock

WHOLE = {
    "n_max": 5,
    "scenario": "cstr",
    "name": "cstr",
    "title": "",
    "seed": 0,
    "knobs": [],
    "agent": {"agent": "GLISp"},
    "options": {"calibrator": "human"},
    "versions": {},
}
STRANGE = {
    "bare": {"n_max": 5},
    "another name": {**WHOLE, "name": {}},
    "no options": {**WHOLE, "options": 3},
    "no calibrator": {**WHOLE, "options": {}},
    "knobs of numbers": {**WHOLE, "knobs": [1]},
    "no agent": {**WHOLE, "agent": {"agent": None}},
    "seed": {**WHOLE, "seed": "a"},
}


@pytest.mark.parametrize("name", sorted({*kept_by(Options)} - {"scenario"}))
def test_an_option_of_another_type_makes_a_study_strange(refused, tmp_path, name):
    configuration = WHOLE | {"options": {**Options("cstr").as_dict(), name: {}}}
    StudyFile.create(tmp_path / "odd.prefcal", configuration, clock=clock()).close()
    assert f"its option {name} cannot be {{}}" in refused("studies", "show", str(tmp_path / "odd.prefcal"))


@pytest.mark.parametrize("configuration", STRANGE.values(), ids=STRANGE)
def test_a_strange_study_breaks_nothing_but_itself(prefcal, done, refused, tmp_path, configuration):
    with StudyFile.create(":memory:", configuration, clock=clock()) as file:
        (tmp_path / "odd.json").write_text(export_json(file))
    assert prefcal("studies", "import", "odd.json")[0] == 0
    for words in (["studies", "show"], ["report"], ["calibrate", "cstr", "--terminal", "--study"]):
        assert "not a study of prefcal calibrate" in refused(*words, "odd")
    out = done("studies", "list", "--json")
    assert "cannot be read" in json.loads(out)[0]["state"]
