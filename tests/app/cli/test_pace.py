"""--questions-per-experiment on a study that was begun with another number."""

import json
from pathlib import Path

from prefcal_app.session.study import questions_of
from prefcal_env.study import Adjusted, StudyFile, study_path
from toy_study import TOY

MOST = "questions_per_experiment"


def calibrate(prefcal, *words):
    line = f"calibrate {TOY} --calibrator synthetic --agent glisp --n-init 3 --study mine --json"
    return prefcal(*line.split(), *words)


def state():
    with StudyFile.open(study_path("mine"), clock=lambda: "now") as file:
        events = [r.event for r in file.events()]
        return file.state, [e for e in events if isinstance(e, Adjusted)]


def test_it_is_changed_recorded_and_goes_on(prefcal, done):
    code, _, err = calibrate(prefcal, "--n-max", "5")
    assert code == 0, err
    assert not state()[0].history.follow_ups
    code, _, err = calibrate(prefcal, "--n-max", "9", "--questions-per-experiment", "3")
    assert code == 0, err
    now, changes = state()
    assert changes == [Adjusted({MOST: 3})]
    assert questions_of(now.configuration) == 3
    assert now.history.follow_ups
    # Without the option, and with the same one, it stays as it is.
    for words in ([], ["--questions-per-experiment", "3"]):
        assert calibrate(prefcal, *words)[0] == 0
    assert state()[1] == changes
    out = done("report", "mine", "--scenario", TOY, "--json")
    assert "--questions-per-experiment 3" in Path(json.loads(out)["report"]).read_text()
