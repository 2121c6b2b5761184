from dataclasses import replace

import numpy as np

from prefcal_app.session import Choice, actions
from prefcal_app.view import asked_view, now_view
from prefcal_app.view.question import numbers_view, panel_view, question_view
from prefcal_scenarios.catalog import load
from prefcal_scenarios.scenario import panels_of
from support.looks import THETA, asked, run, toy


def test_both_sides_have_a_curve_and_a_story_for_each_panel():
    view = now_view(asked()[0])["question"]
    for side in (view["left"], view["right"]):
        assert len(side["curves"]) == len(side["stories"]) == len(view["panels"]) == 2
        assert all(len(c["t"]) == len(c["y"]) > 1 for curves in side["curves"] for c in curves)
    assert {view[s]["role"] for s in ("left", "right")} == {"best so far", "new"}
    assert {view[s]["number"] for s in ("left", "right")} == {1, 2}


def lists(view):
    """Every list in `view`, wherever it is."""
    if isinstance(view, dict):
        view = list(view.values())
    elif isinstance(view, list):
        yield view
    else:
        return
    for part in view:
        yield from lists(part)


def test_blind_hides_numbers_roles_and_theta_on_this_side_of_the_wire():
    interview, now = asked()
    view = now_view(interview, blind=True)
    for side in (view["question"]["left"], view["question"]["right"]):
        assert (side["number"], side["role"], side["theta"]) == (None, None, [])
    for sample in now.state.history.samples:
        assert not any(list(sample.theta) == part for part in lists(view))
    assert now_view(interview)["question"]["left"]["theta"]


def test_what_differs_between_the_sides_is_set_off():
    interview, now = asked()
    left, right = now.question.left.experiment.theta, now.question.right.experiment.theta
    view = question_view(now.question, toy, blind=False)
    for side in ("left", "right"):
        assert [k["differs"] for k in view[side]["theta"]] == [bool(d) for d in left != right]
        assert all(isinstance(k["differs"], bool) for k in view[side]["theta"])
    assert interview.now().version == now.version  # looking changes nothing


def test_values_that_read_the_same_are_not_said_to_differ():
    _, now = asked()
    left, right = now.question.left, now.question.right
    nearly = left.experiment.theta + np.array([4e-4, 0, 0])  # h: less than anybody could dial in
    again = replace(right, experiment=replace(left.experiment, theta=nearly))
    twin = replace(now.question, right=again)
    view = question_view(twin, toy, blind=False)
    assert view["left"]["theta"][0]["text"] == view["right"]["theta"][0]["text"]
    assert [k["differs"] for k in view["right"]["theta"]] == [False, False, False]


def test_kpis_with_an_objective_come_first_with_their_verdict_in_words():
    kpis = numbers_view(run(THETA), toy.shown_kpis)["kpis"]
    assert [k["title"] for k in kpis] == ["settling time t_f", "final level", "largest move"]
    assert [k["met"] for k in kpis] == [True, True, None]
    assert [k["objective"] for k in kpis] == ["≤ 20 h", "≥ 1.94 and ≤ 2.06 m", ""]
    missed = numbers_view(run((1.5, 40, 0.02)), toy.shown_kpis)["kpis"][0]
    assert missed["met"] is False
    unsafe = numbers_view(run((0.4, 20, 60.0)), toy.shown_kpis)
    assert (unsafe["ended"], unsafe["interrupted"], unsafe["empty"]) == ("unsafe", True, False)


def test_marks_are_on_the_side_that_bears_them():
    interview, now = asked()
    interview.do(actions.Mark(now.question.id, "right", "unsafe", True))
    view = now_view(interview)["question"]
    assert (view["left"]["marks"], view["right"]["marks"]) == ([], ["unsafe"])


def test_the_overtaking_draws_the_reference_and_the_limit_that_held():
    scenario = load("overtake")
    experiment = scenario.run(scenario.references["paper, preferences"])
    overtaking = experiment.signals["phase"] == 1
    lateral, speed, _ = panels_of(scenario, experiment)
    assert {round(float(v)) for v in speed.beside(experiment)[0]} == {50, 60}  # km/h
    assert lateral.channel.target is None
    reference = lateral.beside(experiment)[0]
    assert set(reference[overtaking]) == {3.0}
    assert set(reference[~overtaking]) == {0.0}
    _, low, high = speed.beside(experiment)
    assert {round(float(v)) for v in low[overtaking]} == {50}
    assert {round(float(v)) for v in low[~overtaking]} == {40}
    assert high is None
    assert panel_view(speed)["high"] == 70.0
    old = replace(experiment, signals={"phase": experiment.signals["phase"]})
    assert lateral.beside(old) == (None, None, None)  # a study from before the signal existed


def test_a_closed_question_is_shown_as_it_was_with_its_verdict():
    interview, _ = asked(Choice.LEFT, Choice.CANNOT_TELL)
    first, second = asked_view(interview, 1), asked_view(interview, 2)
    assert (first["verdict"], second["verdict"]) == ("left", "cannot tell")
    assert first["comment"] == "said left"
    assert {first["question"][s]["number"] for s in ("left", "right")} == {1, 2}
    assert asked_view(interview, 1, blind=True)["question"]["left"]["number"] is None
