"""The tool that proves that a rebuilding changed no study."""

import json
import runpy
import sys
from pathlib import Path

import pytest

FILE = Path(__file__).parents[1] / "same_studies.py"


@pytest.fixture
def same_studies(monkeypatch, capsys):
    """Run the tool on the studies of random search; give exit code, stdout and stderr."""

    def run(*words):
        words = [str(FILE), "--only", "camel, RandomSearch", *map(str, words)]
        monkeypatch.setattr(sys, "argv", words)
        code = 0
        try:
            runpy.run_path(str(FILE), run_name="__main__")
        except SystemExit as end:
            code = int(end.code or 0)
        out = capsys.readouterr()
        return code, out.out, out.err

    return run


def test_random_search_gives_the_recorded_studies(same_studies):
    code, _, err = same_studies("--against")
    assert (code, err) == (0, "the same studies, bit for bit\n")


def test_a_study_that_differs_or_is_missing_is_named(same_studies, tmp_path):
    code, out, _ = same_studies()
    recorded = json.loads(out)
    assert code == 0
    recorded |= {"camel, RandomSearch": "0" * 64, "camel, RandomSearch, gone": "1" * 64}
    (tmp_path / "before.json").write_text(json.dumps(recorded))
    code, _, err = same_studies("--against", tmp_path / "before.json")
    assert code == 1
    assert err.splitlines()[0].startswith("camel, RandomSearch: 000000000000 became ")
    assert err.splitlines()[1:] == ["camel, RandomSearch, gone: not computed"]


def test_the_lines_behind_a_digest_can_be_shown(same_studies):
    code, out, _ = same_studies("--show")
    lines = json.loads(out)["camel, RandomSearch"]
    assert code == 0
    assert len(lines) == 21
    assert lines[-1].startswith("best ")


def test_the_recorded_studies_are_decided_as_they_were(same_studies):
    code, out, _ = same_studies("--decisions", "--only", "")
    told = [line.partition(": ") for line in out.splitlines()]
    assert [name for name, _, _ in told] == ["live", "page", "raters", "rig", "robust"]
    assert all(words.endswith("decisions, 0 differ") for _, _, words in told)
    assert code == 0


def test_a_folder_without_recorded_studies_is_refused(same_studies, tmp_path):
    code, out, err = same_studies("--decisions", tmp_path, "--only", "")
    assert (code, out) == (2, "")
    assert err.endswith(f"error: {tmp_path} holds no recorded study (NAME.jsonl)\n")


def test_another_decision_is_named(same_studies, tmp_path):
    path = FILE.parent / "recorded" / "rig.jsonl"
    lines = path.read_text(encoding="utf-8").splitlines()
    ending = next(k for k, line in enumerate(lines) if '"suggested"' in line)
    event = json.loads(lines[ending])
    event["theta"][0] = event["z"][0] = 0.5
    (tmp_path / "rig.jsonl").write_text("\n".join([*lines[:ending], json.dumps(event)]), encoding="utf-8")
    code, out, _ = same_studies("--decisions", tmp_path, "--only", "")
    assert code == 1
    assert out.splitlines()[0] == "rig: 1 decision, 1 differs"
    assert out.splitlines()[1].startswith(f"rig, event {ending + 1}: Suggested(index=0")
