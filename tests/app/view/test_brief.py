"""The briefing says what everything is, and an own scenario without a word of it works too."""

from dataclasses import replace

import pytest

from prefcal_app.view import brief_view
from prefcal_env.errors import KnobError, ScenarioError
from prefcal_scenarios.catalog import load
from prefcal_scenarios.names import BUILT_IN
from prefcal_scenarios.scenario import KPI, described
from support.interviews import begin
from support.looks import asked, toy


@pytest.mark.parametrize("name", BUILT_IN)
def test_every_built_in_scenario_says_what_everything_is(name):
    scenario = load(name)
    assert len(scenario.brief) > 200
    assert [knob.name for knob in scenario.space if not knob.about] == []
    assert [kpi.name for kpi in scenario.kpis if not kpi.about] == []


def test_the_reactor_says_what_was_asked_about_it():
    view = brief_view(begin(load("cstr"), n_max=50))
    assert "a curve may end at 16 h" in view["text"]
    assert "49 questions, about 12 minutes" in view["how"]
    about = {kpi["title"]: kpi for kpi in view["kpis"]}
    assert "held the coolant" in about["unsolved QPs"]["about"]
    assert about["unsolved QPs"]["wanted"] == "≤ 0"
    assert about["peak reactor T"]["wanted"] == "lower is better"
    assert view["knobs"][0]["range"] == "0.25 to 1.5"


def test_the_briefing_says_that_a_study_leaves_room_to_the_limit_of_a_margin():
    kpis = (
        KPI("J", "cost", about="What it costs.", at_most=2.0),
        KPI("M_s", "M_s", at_most=2.0, margin=True),
    )
    about = {kpi["title"]: kpi for kpi in brief_view(begin(replace(toy, kpis=kpis), n_max=3))["kpis"]}
    assert about["M_s"]["wanted"] == "≤ 2"  # what is judged
    assert "those with 1.8 or lower come first, unless that costs an objective" in about["M_s"]["about"]
    assert about["cost"]["about"] == "What it costs."


def test_words_about_nothing_are_refused():
    with pytest.raises(KnobError, match="Np"):
        toy.space.described({"Np": "A typo."})
    with pytest.raises(ScenarioError, match="typo"):
        described((KPI("t_f", "settling time"),), {"typo": "Nothing."})


def test_the_briefing_asks_for_the_current_tuning_unless_it_was_given():
    interview, _ = asked()
    view = brief_view(begin(toy, n_max=3))  # described by its names alone
    assert (view["text"], [knob["about"] for knob in view["knobs"]]) == ("", ["", "", ""])
    assert "2 questions, about 1 minute at" in view["how"]
    assert "10 questions, about 3 minutes at" in brief_view(begin(load("cstr"), n_max=11))["how"]
    assert "T_s=…, N_p=…, gain=…" in brief_view(interview)["start"]
    interview.file.state.configuration["options"]["start"] = ["T_s=1, N_p=5, gain=1"]
    assert brief_view(interview)["start"] == ""
