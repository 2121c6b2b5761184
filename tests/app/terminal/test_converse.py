"""The terminal front end, with recorded consoles and typed keys."""

import re
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import pytest

from prefcal_agents import GLISp
from prefcal_app.session import Background, Phase
from prefcal_app.terminal.converse import _Conversation, _waiting
from prefcal_app.terminal.showing import END, KEYS
from prefcal_env.errors import StudyError
from prefcal_env.experiments.experiment import Channels, End
from prefcal_env.sources.rig import Rig
from prefcal_env.study import Answered, StudyFile
from prefcal_scenarios.catalog import load
from prefcal_scenarios.isolated import isolation
from support.interviews import begin
from support.talking import console_of, talk
from toy_scenario_tools import CHANNELS, record_of_toy
from toy_study import toy_scenario


@pytest.fixture
def interview():
    return begin(toy_scenario(), n_max=5)


def test_a_whole_study_by_keys(interview):
    out = talk(interview, "lr=s")
    assert interview.now().phase is Phase.OVER
    assert "Question 1 of 4: which experiment is better?" in out
    assert "The study is finished: all compared." in out
    given = [c.answer.preference for c in interview.now().state.history.comparisons[1:]]
    assert given[2:] == [0, None]


def test_a_study_that_ends_early_says_why_and_how_to_go_on(monkeypatch):
    monkeypatch.setattr(GLISp, "has_enough", lambda agent, history: len(history.lessons) >= 2)
    out = talk(begin(toy_scenario(), n_max=5, stops=True), "lr")
    assert "The study is finished: few random θ are noticeably better (--n-max 6 goes on)." in out


@pytest.mark.parametrize("width", [80, 140])
def test_both_sides_are_shown_with_their_numbers(interview, width):
    out = talk(interview, "x", width=width)
    assert all(len(line) <= width for line in out.splitlines())
    assert re.search("l left, .*can't tell.*x stop", out)  # on one line
    for words in ("LEFT · experiment", "RIGHT · experiment", "settling time t_f"):
        assert words in out
    side_by_side = [line for line in out.splitlines() if "LEFT" in line and "RIGHT" in line]
    assert [line.split()[0] for line in side_by_side] == ["KPI", "θ"]


def test_without_kpis_a_question_says_where_the_curves_are(interview):
    out = talk(begin(replace(toy_scenario(), kpis=(), cost=None), n_max=3), "x")
    assert "no KPIs to compare: the page draws the curves" in out
    assert "T_s" in out


def test_keys_mean_what_they_mean_on_the_page():
    """People who change the front end must not give a verdict that they do not mean."""
    page = (files("prefcal_app.web") / "static" / "keys.js").read_text("utf-8")
    on_page = {k.lower(): v for k, v in re.findall(r'\["([A-Z])", "([^"]+)"', page)}
    same = {
        "p": "ask",
        "t": "all KPIs",
        "s": "can't tell",
        "c": "comment",
        "b": "blind",
        "z": "undo",
        "h": "history",
    }
    here = dict(KEYS)
    for key, words in {**same, "w": "where are we"}.items():
        assert here[key].startswith(words)
        assert words in on_page[key] or (key, on_page[key]) == ("z", "undo the last answer")


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ("hx", "No answers yet."),
        ("fxx", "Type f again"),  # one letter does not finish a study
        ("ff", "The study is finished: at your request."),
        ("zx", "there is no answer to undo"),
    ],
)
def test_what_keys_say_without_an_answer(interview, keys, words):
    assert words in talk(interview, keys)
    assert (interview.now().phase is Phase.OVER) == (keys == "ff")


def test_an_empty_line_is_no_answer(interview):
    out = talk(interview, ["", "x"])
    assert "undo the last answer" not in out
    assert out.count("Question 1 of 4") == 1


def test_undo_marks_comment_and_blind(interview):
    out = talk(interview, "l" + "z" + "qcb" + "r" + "x", ["quieter"])
    closed = interview.now().state.history.comparisons[1]
    assert (closed.comment, closed.blind) == ("quieter", True)
    assert closed.answer.marks != ()
    assert "The last answer is undone." in out
    blind = out[out.rindex("better?") :]
    assert "experiment 1" not in blind.split("Saved")[0]


def test_a_comment_survives_an_answer_that_could_not_be_saved(interview, monkeypatch):
    append, full = StudyFile.append, iter([True])

    def once_full(self, *events):
        if isinstance(events[0], Answered) and events[0].question and next(full, False):
            raise StudyError("the disk is full")
        return append(self, *events)

    monkeypatch.setattr(StudyFile, "append", once_full)
    assert "the disk is full" in talk(interview, "cllx", ["quieter"])
    assert interview.now().state.history.comparisons[1].comment == "quieter"


def test_ctrl_d_at_a_comment_leaves_no_comment(interview):
    talk(interview, "clx", [END])
    assert interview.now().state.history.comparisons[1].comment == ""


def test_history_status_keys_and_a_repeat(interview):
    out = talk(interview, "lrhw?plx")
    for words in ("History", "best so far, experiment", "No question has been asked twice", "undo"):
        assert words in out
    assert interview.known.consistency.repeated == 1


def test_every_number_stands_beside_its_unit_and_objective(interview):
    out = talk(interview, "x", width=80)
    value = r"(never|[\d.]+ h) [✓✗]"
    assert re.search(rf"settling time t_f +{value} +{value} .*≤ 20 h", out)
    assert re.search(r"T_s +\[[\d.]+ h\] +\[[\d.]+ h\]", out)


def test_a_comment_of_somebody_else_does_not_steer_the_terminal(interview):
    out = talk(interview, "clhx", ["a\x1b]0;b\x07[red]c"])
    assert "[red]c" in out
    assert "\x1b" not in out


def test_a_run_that_fails_is_tried_again_or_counted(interview):
    toy, broken = toy_scenario(), [True, True, False]

    def run(theta, seed=0):
        if broken and broken.pop(0):
            raise OSError("the pump does not answer")
        return toy.run(theta, seed)

    interview = begin(replace(toy, run=run), n_max=4)
    out = talk(interview, "tfx")
    assert "That did not work: OSError: the pump does not answer" in out
    assert interview.now().state.finished


def test_a_rigs_records_are_asked_for(tmp_path):
    rig = Rig(CHANNELS, (2.0,), instructions="Open the tap first.")
    interview = begin(replace(toy_scenario(), run=rig, kpis=()), n_max=3)
    files = [tmp_path / "a.csv", tmp_path / "b.csv"]
    files[0].write_text(record_of_toy(), encoding="utf-8")
    files[1].write_text(record_of_toy(20), encoding="utf-8")
    (tmp_path / "bad.csv").write_text("time [s]\n0\n", encoding="utf-8")
    lines = [
        str(tmp_path / "no.csv"),
        str(tmp_path / "bad.csv"),
        str(files[0]),
        f"unsafe {files[0]}",
        "no",
        "set T_s=9",
        "set T_s=1.07",
        f"unsafe {files[1]}",
        "stop",
    ]
    out = talk(interview, "l", lines)
    assert "cannot read" in out
    assert "column 'level <h>' is missing" in out
    assert "Open the tap first." in out
    assert "exactly the curves of experiment 1" in out
    assert "theta of knob 'T_s' must be in [0.25, 1.5] h, got 9" in out
    assert "20 rows, from 0 h to 9.5 h" in out
    assert interview.past.experiment(1).end.interrupted
    assert interview.past.experiment(1).theta[0] == pytest.approx(1.07)
    assert interview.now().phase is Phase.RECORD
    assert isinstance(CHANNELS, Channels)


def test_what_cannot_be_read_is_asked_for_again(tmp_path):
    large = tmp_path / "large.csv"
    large.write_bytes(b"0" * (20 * 2**20 + 1))
    interview = begin(replace(toy_scenario(), run=Rig(CHANNELS, (2.0,)), kpis=()), n_max=3)
    out = talk(interview, "", ["", "~nobody-here/a.csv", "a\0b", str(tmp_path), str(large), "stop"])
    assert out.count("cannot read") == 3
    assert "is larger than 20 MiB" in out
    assert interview.now().phase is Phase.RECORD


def test_a_run_that_hangs_is_stopped_by_a_key():
    wild = str(Path(__file__).parents[2] / "support" / "wild_runs.py") + ":hangs"
    typed = iter("fx")
    console = console_of()
    with isolation(wild) as isolated:
        interview = begin(isolated(load(wild)), seed=5)  # its first run hangs
        talking = _Conversation(interview, console, lambda words: next(typed), typed=lambda: "k")
        with Background(interview):
            talking.run()
    out = console.export_text()
    assert "That did not work: you stopped the run after" in out
    assert interview.past.experiment(0).end is End.FAILED
    assert _waiting(replace(interview.now(), run_limit=600.0)).endswith(
        "(at most 10 min; k and Enter stops it)"
    )
