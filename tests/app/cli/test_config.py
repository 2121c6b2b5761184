"""`prefcal calibrate --config`: a scenario with a configuration out of a file."""

import json

import pytest

CONFIG = {"lanes_count": 3, "duration": 4, "steering_limit": "per step"}
QUICK = ["--calibrator", "synthetic", "--agent", "random", "--n-init", "2", "--n-max", "3"]


@pytest.fixture(autouse=True)
def _files(tmp_path):
    (tmp_path / "traffic.json").write_text(json.dumps(CONFIG))
    (tmp_path / "other.json").write_text('{"duration": 5}')


def calibrate(prefcal, *words):
    return prefcal("calibrate", "overtake", *QUICK, *words)


def test_it_is_kept_with_the_study_and_the_same_line_resumes_it(prefcal, done, tmp_path):
    code, _, err = calibrate(prefcal, "--config", "traffic.json", "--study", "mine", "--out", "a")
    assert code == 0, err
    (tmp_path / "traffic.json").rename(tmp_path / "moved.json")
    code, out, err = calibrate(
        prefcal, "--config", "moved.json", "--study", "mine", "--n-max", "4", "--json", "--out", "a"
    )
    assert code == 0, err
    assert json.loads(out)["experiments"] == 4
    best = json.loads((tmp_path / "a" / "best.json").read_text())
    assert json.loads(best["scenario"].removeprefix("overtake ")) == CONFIG
    assert best["settings"]["overtaking"]["du_max"][1] == 0.0873
    assert "lanes_count" not in prefcal("studies", "list")[1]  # the name of the scenario alone
    done("report", "mine", "--out", "b")  # no program of a stranger: no --scenario


@pytest.mark.parametrize("words", [[], ["--config", "other.json"]])
def test_a_study_does_not_go_on_in_another_scene(prefcal, words):
    calibrate(prefcal, "--config", "traffic.json", "--study", "mine")
    code, _, err = calibrate(prefcal, "--study", "mine", *words)
    assert code == 2
    assert "started with the configuration" in " ".join(err.split())


@pytest.mark.parametrize(
    ("text", "says"),
    [(None, "cannot read"), ("[1]", "must be a JSON object"), ("{", "not JSON"), ('{"lanes": 3}', "lanes")],
)
def test_a_file_that_cannot_be_is_refused_by_name(refused, tmp_path, text, says):
    if text is not None:
        (tmp_path / "bad.json").write_text(text)
    assert says in refused("calibrate", "overtake", *QUICK, "--config", "bad.json")
