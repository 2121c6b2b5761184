"""Plans to compare an agent with published studies."""

import runpy
import sys
from pathlib import Path

import pytest

from bench_support.worths import study, walks
from prefcal_bench.published import plan as module
from prefcal_bench.published.plan import plan, publish, read_published
from prefcal_bench.published.raw import write_raw
from prefcal_env.errors import SettingsError

SCRIPT = Path(__file__).parents[2] / "campaigns" / "publish.py"
LOOPS = ("camel", "hartman3")


@pytest.fixture
def raw(tmp_path):
    results = walks({"GLISp": 1.3, "RandomSearch": 1.0}, LOOPS, ("perfect",), 2, n_max=12)
    return write_raw(results, tmp_path / "raw.parquet")


@pytest.fixture
def frame(raw, tmp_path):
    publish([raw], tmp_path / "worth.parquet")
    return read_published(tmp_path / "worth.parquet")


def test_the_published_form_holds_every_experiment_once(raw, tmp_path):
    publish([raw, raw], tmp_path / "worth.parquet")
    found = read_published(tmp_path / "worth.parquet")
    assert len(found) == 2 * 2 * 2 * 12
    again = tmp_path / "again.parquet"
    publish([raw], again)
    assert again.read_bytes() == (tmp_path / "worth.parquet").read_bytes()


def test_the_script_says_what_it_wrote(raw, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["publish.py", str(raw), "--out", str(tmp_path / "w")])
    runpy.run_path(str(SCRIPT), run_name="__main__")
    assert "8 studies" in capsys.readouterr().out


def test_the_agent_runs_on_what_is_published_with_its_seeds_and_budget(frame):
    suite = plan("LatinHypercube", frame).suite
    assert suite.agents == ("LatinHypercube",)
    assert set(suite.problems) == set(LOOPS)
    assert (suite.calibrators, suite.seeds) == (("perfect",), 2)
    assert (suite.n_init, suite.n_max) == (10, 12)
    assert suite.baseline == "LatinHypercube"
    few = plan("LatinHypercube", frame, ["camel"], ["perfect"], 1)
    assert len(few.suite.cells) == 1
    assert set(few.published["loop"]) == {"camel"}


def test_a_published_agent_of_the_same_name_stands_beside_the_installed_one(frame):
    found = plan("GLISp", frame)
    assert set(found.published["agent"]) == {"GLISp (published)", "RandomSearch"}


def test_other_versions_are_told(frame):
    assert plan("LatinHypercube", frame).notes == ()
    old = frame.assign(agent_version=frame["agent_version"].where(frame["agent"] != "GLISp", "0"))
    old.loc[old["loop"] == "camel", "problem_version"] = "7"
    notes = " ".join(plan("LatinHypercube", old).notes)
    assert "GLISp: the published studies are of version 0, this prefcal has" in notes
    other = frame.assign(agent_version=frame["agent_version"] + " and more")
    assert "have other settings" in " ".join(plan("LatinHypercube", other).notes)
    assert "camel: the published studies are of version 7, this prefcal has 1" in notes


def test_loops_that_are_gone_are_told_and_left_out(frame):
    gone = frame.assign(loop=frame["loop"].replace({"camel": "dromedary"}))
    found = plan("LatinHypercube", gone)
    assert found.suite.problems == ["hartman3"]
    assert any("dromedary" in note for note in found.notes)


def test_unknown_names_are_refused_with_those_that_are_published(frame):
    with pytest.raises(SettingsError, match=r"no loop 'camle' is published.*camel"):
        plan("LatinHypercube", frame, ["camle"])
    with pytest.raises(SettingsError, match="no taste 'x' is published"):
        plan("LatinHypercube", frame, None, ["x"])
    with pytest.raises(SettingsError, match="share one number"):
        plan("LatinHypercube", frame.assign(n_max=range(len(frame))))


def test_there_is_nothing_to_publish_without_a_worth(tmp_path):
    with pytest.raises(SettingsError, match="no studies"):
        publish([write_raw([], tmp_path / "raw.parquet")], tmp_path / "worth.parquet")
    contradicting = [write_raw([study(worth=(1, w))], tmp_path / f"{w}.parquet") for w in (2, 3)]
    with pytest.raises(SettingsError, match="two studies"):
        publish(contradicting, tmp_path / "worth.parquet")


def test_what_comes_with_prefcal_can_be_read_if_there_is_any():
    if module.PUBLISHED.is_file():
        assert (read_published()["worth"] >= 1).all()
