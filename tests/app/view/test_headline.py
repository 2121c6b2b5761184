"""The head of each side shows the KPIs that the sentence above the question names."""

import re
from dataclasses import replace
from functools import partial
from io import StringIO

import pytest
from rich.console import Console

from prefcal_agents.screening.agent import Screening
from prefcal_app.session import Choice, Phase, actions
from prefcal_app.summary import Spread, compare
from prefcal_app.terminal.showing import show_kpis
from prefcal_app.view import now_view
from prefcal_app.view.question import question_view
from prefcal_scenarios.catalog import load
from prefcal_scenarios.scenario import KPI
from support.interviews import begin, proceed


def test_what_the_sentence_names_comes_first_then_what_differs_most_then_objectives():
    kpis = (*(KPI(name, name.upper()) for name in "abc"), KPI("d", "D", at_most=2.0), KPI("e", "E"))
    scenario = replace(load("servo"), kpis=kpis)
    run = proceed(begin(load("servo"), n_max=3)).question.left.experiment
    left = replace(run, kpis=dict.fromkeys("abcde", 1.0))
    right = replace(run, kpis={"a": 10.0, "b": 2.0, "c": 1.0, "d": 1.0, "e": 1.2})

    def order(*named):
        return "".join(row["title"] for row in compare(left, right, scenario.shown_kpis, Spread(), named))

    assert order() == "ABEDC"
    assert order("C", "E", "not measured") == "CEABD"


def test_heads_table_and_terminal_show_the_same_order_what_is_named_first():
    interview = begin(load("servo"), n_max=3)
    asked, scenario = proceed(interview).question, interview.scenario
    named = [scenario.shown_kpis[-1].title]
    view = question_view(asked, scenario, blind=False, named=named)
    assert [row["title"] for row in view["comparison"]] == view["headline"]
    assert view["headline"][:1] == named
    console = Console(file=StringIO(), width=200)
    show_kpis(view["comparison"], console, {"left": "LEFT", "right": "RIGHT"})
    told = console.file.getvalue()
    places = [told.index(title) for title in view["headline"]]
    assert places == sorted(places)


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
        apart = [row["size"] for row in blind["comparison"]]
        assert apart == sorted(apart, reverse=True)
        assert blind["heads"] == 3
        told += seen["headline"] != blind["headline"] or seen["heads"] != 3
        interview.do(actions.Answer(blind["id"], Choice.LEFT))
    assert told


def test_a_name_without_a_row_takes_no_place_in_the_heads():
    interview = begin(load("servo"), n_max=3, agent=partial(Screening, n_simulated=60))
    question = proceed(interview).question
    view = question_view(question, interview.scenario, blind=False, named=["not", "one", "of", "them"])
    assert view["heads"] == 3
