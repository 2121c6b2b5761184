"""What the page gets about an agent that simulates: reasons, the picture's data, and looks."""

import json
from dataclasses import replace

import numpy as np
import pytest

from prefcal_agents.people import Bank
from prefcal_agents.screening.findings import Alternative, Findings, Reason
from prefcal_app.session import Choice, actions
from prefcal_app.simulating import Screened
from prefcal_app.view import look_view, map_view, now_view, why_view
from prefcal_app.view.end import _axes, _chosen, _points, menu_view
from prefcal_env.preferences.history import History
from support.interviews import begin, proceed, worked
from support.looks import toy
from support.screened import explained, let_say, screening
from support.windows import make_room

REASON = Reason(0.7, ("final",), ("t_f",))
WANTED = np.array([0.5, 21.0, 1.0])


@pytest.fixture
def says(monkeypatch):
    """An agent with reasons that promises nothing more."""
    let_say(monkeypatch, reason=REASON, chance_of_better=0.08)


def told(interview, *, blind=False):
    return now_view(interview, blind=blind)["screening"]


def test_nothing_of_it_appears_for_other_agents():
    interview = begin(toy)
    now = proceed(interview)
    assert told(interview) is now_view(interview)["simulated"] is map_view(interview) is None
    assert why_view(interview, now) == ("", ())


def test_the_reason_names_the_side_of_the_new_one_and_blind_hides_it(says):
    interview = explained(screening())
    question = interview.now().question
    side = "Left" if question.left.challenger else "Right"
    assert told(interview)["why"].startswith(f"Nothing learned yet: {side.lower()} has ")
    assert told(interview, blind=True)["why"] == ""


def test_without_a_reason_there_is_no_sentence(monkeypatch):
    let_say(monkeypatch, reason=None)
    interview = explained(screening())
    assert told(interview)["why"] == ""


def test_a_follow_up_is_about_two_that_were_seen(says):
    interview = explained(screening())
    now = interview.now()
    further = replace(now, question=replace(now.question, further=True))
    assert why_view(interview, further)[0] == (
        "You have seen both before: your answer settles which of the two is better."
    )


def test_until_it_is_known_nothing_is_said(says):
    interview = screening()
    interview._driver.resume()
    assert told(interview) == {"why": "", "offer": ""}
    assert map_view(interview) is None
    proceed(interview)
    interview.do(actions.AskFor(WANTED))
    proceed(interview)
    assert told(interview)["why"].endswith(" is shown because you asked for it.")


def test_the_picture_has_every_simulated_theta_in_values_that_people_see(says):
    interview = explained(screening())
    view = map_view(interview)
    json.dumps(view, allow_nan=False)
    titles = [axis["title"] for axis in view["axes"]]
    assert titles == ["settling time t_f", "final level: distance from its target", "T_s", "N_p", "gain"]
    assert [axis["knob"] for axis in view["axes"]] == [False, False, True, True, True]
    assert view["axes"][4]["log"]
    assert [axis["time"] for axis in view["axes"][:2]] == [True, False]  # what has no time was never there
    assert view["chosen"] == [1, 0]  # what was learned, then what else differs
    for point in view["points"]:
        run = toy.run(point["theta"])
        if point["end"] == "":
            assert point["values"][0] == pytest.approx(run.kpis["t_f"], rel=1e-5)
        else:
            assert point["end"] == ("failed" if point["theta"][1] == 7 else "stopped")
            assert point["values"][:2] == [None, None]
    ends = {point["end"] for point in view["points"]}
    assert ends == {"", "stopped", "failed"}


def test_shown_ones_have_their_numbers_and_the_sides_their_rows(says):
    interview = explained(screening())
    interview.do(actions.Answer(interview.now().question.id, Choice.LEFT))
    now, view = explained(interview).now(), map_view(interview)
    numbers = [point["number"] for point in view["points"] if point["number"] is not None]
    assert sorted(numbers) == [1, 2, 3]
    assert view["points"][view["best"]]["number"] == now.incumbent + 1
    for name in ("left", "right"):
        index = getattr(now.question, name).index
        assert view["points"][view["sides"][name]]["number"] == index + 1
    assert (view["over"], view["left_to_ask"]) == (False, 4)


def screened(kpis, names, reason=None):
    """A bank of these KPIs."""
    kpis = np.array(kpis, dtype=float)
    thetas = np.tile([0.5, 20.0, 1.0], (len(kpis), 1))
    failed = np.isnan(kpis).all(axis=1)
    bank = Bank(thetas, thetas, tuple(names), np.where(failed[:, None], np.inf, kpis), failed)
    return Screened(toy.space, History(), None, bank, Findings(False, len(bank), reason))


@pytest.mark.parametrize(
    ("values", "log"),
    [
        ([1, 10, 50], False),
        ([1, 10, 150], True),
        ([0, 1, 10, 150], False),  # 0 would not be drawn
        ([-1, 10, 150], False),
        ([1, 10, np.inf], False),
        ([0, 0], False),
        ([np.inf, np.inf], False),
    ],
)
def test_an_axis_is_logarithmic_beyond_two_decades(values, log):
    (axis, *_) = _axes(screened([[v] for v in values], ["t_f"]), toy)
    assert axis.log is log


def test_kpis_that_the_scenario_does_not_know_keep_their_names():
    axes = _axes(screened([[1, 2]], ["other_one", "t_f"]), toy)
    assert [axis.title for axis in axes][:2] == ["settling time t_f", "other one"]


def test_without_a_reason_the_first_two_kpis_are_chosen():
    found = screened([[1, 2, 3]], ["final", "other", "t_f"])
    assert _chosen(found, _axes(found, toy)) == [0, 1]
    unknown = screened([[1, 2, 3]], ["final", "other", "t_f"], Reason(0.5, (), ("other",)))
    assert _chosen(unknown, _axes(unknown, toy)) == [2, 0]


def test_a_run_that_never_settles_is_neither_failed_nor_stopped():
    found = screened([[np.inf, 1], [np.inf, np.inf], [np.nan, np.nan]], ["t_f", "a"])
    axes = _axes(found, toy)
    assert [p["end"] for p in _points(found, axes, toy, {})] == ["", "stopped", "failed"]


def test_a_look_stands_beside_the_best_and_has_no_number():
    interview = explained(screening())
    view = look_view(interview, tuple(WANTED))
    json.dumps(view, allow_nan=False)
    question = view["question"]
    best = interview.now().incumbent
    assert (question["left"]["number"], question["right"]["number"]) == (best + 1, None)
    assert question["right"]["theta"][0]["text"] == "0.5"
    assert view["time_unit"] == "h"
    assert len(question["right"]["curves"]) == 2


def test_the_picture_is_made_once_per_version(monkeypatch):
    room = make_room(explained(screening()))
    made = []
    from prefcal_app.web import api

    monkeypatch.setattr(api, "VIEWS", {"simulated": lambda interview: made.append(1) or {"n": 1}})
    for _ in range(3):
        assert room.page().get("/api/simulated").json() == {"n": 1}
    assert len(made) == 1
    room.post("finish")
    room.page().get("/api/simulated")
    assert len(made) == 2


def carries(interview, **fields):
    """Let what was worked out say this, too."""
    thoughts = interview._driver.thoughts
    known = thoughts.screened
    thoughts.screened = replace(known, findings=replace(known.findings, **fields))


def test_an_answer_that_hardly_changes_the_result_is_said_and_blind_hides_it(says):
    interview = explained(screening())
    carries(interview, stakes=0.03)
    assert told(interview)["why"].endswith(" Your answer hardly changes the result (chance: 3 %).")
    assert told(interview, blind=True)["why"] == ""
    carries(interview, stakes=0.3)
    assert "hardly" not in told(interview)["why"]


def test_what_carries_the_result_is_not_said_before_it_is_worked_out():
    # It takes seconds: until then "No single answer ..." could be the opposite of what follows.
    interview = explained(screening())
    interview.do(actions.Answer(interview.now().question.id, Choice.LEFT))
    interview.do(actions.Finish())
    while interview.known.findings is None or not interview.known.findings.over:
        interview.work()
    assert not interview.known.findings.concluded
    first = now_view(interview)["over"]["why"]
    assert first == ["No experiment that was compared is better by what was answered."]
    worked(interview)
    said = now_view(interview)["over"]["why"]
    assert said[-1].startswith(("The result rests on the answer about experiment", "No single answer"))


def reads(interview, rows):
    """Let simulated θ have other KPIs, by row of the bank: final level and settling time."""
    thoughts = interview._driver.thoughts
    bank = thoughts.screened.bank
    kpis = bank.kpis.copy()
    for row, values in rows.items():
        kpis[row] = values
    thoughts.screened = replace(thoughts.screened, bank=replace(bank, kpis=kpis))


def test_the_menu_names_other_simulated_theta_by_what_they_gain_and_what_that_costs():
    interview = explained(screening())
    assert menu_view(interview) == []
    screened = interview.known.screened()
    shown, best = screened.row(interview.past.experiment(0).theta), map_view(interview)["best"]
    one, same, *_ = (row for row in range(len(screened.bank)) if row not in (shown, best))
    reads(interview, {best: (0.1, 5.0), one: (0.0, 6.0), same: (0.1, 5.0)})
    thetas = map(tuple, screened.bank.thetas[[same, one, shown]].tolist())
    carries(interview, menu=tuple(Alternative(theta, ("final",)) for theta in thetas))
    (choice,) = menu_view(interview)  # one reads the same, one was shown
    assert choice["name"] == "final level nearer to its target, but higher settling time t_f"
    assert choice["theta"] == screened.bank.thetas[one].tolist()
    points = [point["theta"] for point in map_view(interview)["points"]]
    assert choice["theta"] in points, "the page finds it by θ"


def test_the_picture_has_what_lies_between_the_result_and_the_menu():
    interview = explained(screening())
    assert map_view(interview)["ways"] == []
    bank, best = interview.known.screened().bank, map_view(interview)["best"]
    row = int(np.argmin(np.where(np.arange(len(bank)) == best, np.inf, bank.kpis[:, 0])))
    reads(interview, {best: (0.1, 5.0)})
    carries(interview, menu=(Alternative(tuple(bank.thetas[row].tolist()), ("t_f",)),))
    (way,) = map_view(interview)["ways"]
    assert (way[0], way[-1]) == (best, row)
    assert not bank.hopeless[list(way)].any()
