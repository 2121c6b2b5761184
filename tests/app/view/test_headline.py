"""The head of each side shows the KPIs that the sentence above the question names."""

import re
from functools import partial

import pytest

from prefcal_agents.screening.agent import Screening
from prefcal_app.session import Choice, Phase, actions
from prefcal_app.view import now_view
from prefcal_app.view.question import headline, question_view
from prefcal_scenarios.catalog import load
from support.interviews import begin, proceed


def row(title, size, objective=""):
    return {"title": title, "size": size, "objective": objective}


def test_what_the_sentence_names_comes_first_then_what_differs_most_then_objectives():
    rows = [row("a", 0.9), row("b", 0.4), row("c", 0.0), row("d", 0.0, "≤ 2"), row("e", 0.1)]
    assert headline(rows) == ["a", "b", "e", "d", "c"]
    assert headline(rows, ("c", "e", "not measured")) == ["c", "e", "a", "b", "d"]


@pytest.mark.parametrize("name", ["cstr", "servo", "building"])
def test_no_sentence_names_a_kpi_that_the_heads_do_not_show(name):
    interview = begin(load(name), n_max=5, agent=partial(Screening, n_simulated=60))
    titles = {kpi.title for kpi in interview.scenario.shown_kpis}
    sentences = 0
    while proceed(interview).phase is Phase.QUESTION:
        view = now_view(interview)
        question, sentence = view["question"], view["screening"]["why"]
        words = re.sub(r" \(chance[^)]*\)", "", sentence)
        # The longest title that fits is the one that is meant: "settling time" is part of others.
        named = {title for title in titles if title in words}
        named = {title for title in named if not any(title in other for other in named - {title})}
        assert named <= set(question["headline"][: question["heads"]]), sentence
        sentences += bool(named)
        interview.do(actions.Answer(view["question"]["id"], Choice.LEFT))
    assert sentences >= 3


def test_blind_the_heads_do_not_tell_which_side_is_new():
    interview = begin(load("servo"), n_max=5, agent=partial(Screening, n_simulated=60))
    told = 0
    while proceed(interview).phase is Phase.QUESTION:
        seen, blind = (now_view(interview, blind=blind)["question"] for blind in (False, True))
        assert blind["headline"] == headline(blind["comparison"])
        assert blind["heads"] == 3
        told += seen["headline"] != blind["headline"] or seen["heads"] != 3
        interview.do(actions.Answer(blind["id"], Choice.LEFT))
    assert told


def test_a_name_without_a_row_takes_no_place_in_the_heads():
    interview = begin(load("servo"), n_max=3, agent=partial(Screening, n_simulated=60))
    question = proceed(interview).question
    view = question_view(question, interview.scenario, blind=False, named=["not", "one", "of", "them"])
    assert view["heads"] == 3
