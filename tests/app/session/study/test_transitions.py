"""The rules of a study, once: what each phase allows, what refuses it, and where each event leads.

Everything here is a pure function; screens have one test for each thing that they offer.
"""

from dataclasses import replace
from pathlib import Path

import pytest

from prefcal_agents import GLIS, GLISp, RandomSearch
from prefcal_app.session import Phase
from prefcal_app.session.actions import ACTIONS
from prefcal_app.session.study import TRANSITIONS, Moment, PlantFacts, Recovery
from prefcal_env.study import Ended, Failed, Finished, Led, Marked, Noted, Reopened, Retracted, Shown, Undone
from support.interviews import answer_all, begin
from toy_study import toy_scenario

DOCS = Path(__file__).parents[4] / "docs"
RUNNING, RECORD, CONFIRM, FAILED, QUESTION, OVER = Phase
RIG, LIVE = PlantFacts("record", stops=False), PlantFacts("confirm", stops=True)


class Enough(Exception):
    """Stops the answers."""


@pytest.fixture(scope="module")
def whole():
    """A study whose three questions are answered."""
    interview = begin(toy_scenario(), n_max=4)
    answer_all(interview, lambda number: None)
    return interview._driver.study


@pytest.fixture(scope="module")
def asked():
    """A study that waits for its third answer."""
    interview = begin(toy_scenario(), n_max=4)

    def stop(number):
        if number == 2:
            raise Enough

    with pytest.raises(Enough):
        answer_all(interview, stop)
    while interview.now().phase is RUNNING:
        interview.work()
    return interview._driver.study


@pytest.fixture(scope="module")
def beaten(whole):
    """A study whose best experiment is another one than the first."""
    return replace(whole, state=replace(whole.state, history=whole.state.history.with_best(1)))


@pytest.fixture(scope="module")
def new():
    """A study without an answer."""
    return begin(toy_scenario(), n_max=4)._driver.study


def transitions():
    """The whole machine as a table: which actions a phase allows, and where each event leads."""
    heads = ["", *(phase.value for phase in Phase)]
    rows = [[name, *("can" * (p in action.when) for p in Phase)] for name, action in ACTIONS.items()]
    for happened, (sources, target) in TRANSITIONS.items():
        name = happened.value if isinstance(happened, Moment) else happened.__name__
        rows.append([name, *(target.value * (p in sources) for p in Phase)])
    return "\n".join(f"| {' | '.join(cells)} |" for cells in [heads, ["---"] * len(heads), *rows])


def test_the_table_of_the_documents_is_the_one_that_is_followed():
    assert transitions() in (DOCS / "study_file.md").read_text(encoding="utf-8")


FED = [
    (QUESTION, Undone(), RUNNING),
    (QUESTION, Noted("a remark"), QUESTION),
    (QUESTION, Marked(0, "unsafe", True), QUESTION),
    (QUESTION, Retracted(1), QUESTION),
    (QUESTION, Finished(2), QUESTION),  # it ran beside
    (RECORD, Finished(2), RUNNING),
    (FAILED, Finished(2), FAILED),
    (RUNNING, Failed(2, "the pump"), FAILED),
    (FAILED, Moment.RETRIED, RUNNING),
    (QUESTION, Moment.RETRIED, QUESTION),
    (CONFIRM, Moment.CONFIRMED, RUNNING),
    (FAILED, Moment.CONFIRMED, FAILED),
    (RUNNING, Shown(2, 0, True), RUNNING),  # until both experiments are read
    (RUNNING, Moment.ASKED, QUESTION),
    (QUESTION, Ended("stopped"), OVER),
    (OVER, Reopened(), RUNNING),
]


@pytest.mark.parametrize(("phase", "happened", "after"), FED)
def test_an_event_leads_to_a_phase_and_changes_no_earlier_study(asked, phase, happened, after):
    study = replace(asked, phase=phase)
    assert study.feed(happened).phase is after
    assert study.phase is phase


CLOSED, STALE = "no longer open", "nothing was changed"
RULES = [
    # what, study, phase, plant, why not
    ("answer", "asked", QUESTION, PlantFacts(), None),
    ("answer", "asked", RUNNING, PlantFacts(), CLOSED),
    ("mark", "asked", OVER, PlantFacts(), CLOSED),
    ("undo", "asked", QUESTION, PlantFacts(), None),
    ("undo", "asked", FAILED, PlantFacts(), None),
    ("undo", "whole", OVER, PlantFacts(), None),
    ("undo", "new", RUNNING, PlantFacts(), "no answer to undo"),
    ("retract", "asked", QUESTION, PlantFacts(), None),
    ("retract", "new", RUNNING, PlantFacts(), "no answer to retract"),
    ("repeat", "asked", QUESTION, PlantFacts(), None),
    ("repeat", "asked", RUNNING, PlantFacts(), "no earlier question"),
    ("repeat", "new", QUESTION, PlantFacts(), "no earlier question"),
    ("pace", "asked", QUESTION, PlantFacts(), None),
    ("pace", "asked", FAILED, PlantFacts(), "try it again first"),
    ("ask_for", "asked", QUESTION, PlantFacts(), None),
    ("ask_for", "whole", OVER, PlantFacts(), "continue it first"),
    ("choose", "whole", OVER, PlantFacts(), "nothing is simulated unseen"),
    ("choose", "asked", QUESTION, PlantFacts(), "has not ended"),
    ("keep_on_plant", "beaten", OVER, RIG, None),
    ("keep_on_plant", "beaten", QUESTION, RIG, "has not ended"),
    ("keep_on_plant", "beaten", OVER, LIVE, "on a rig or a live plant"),  # one that cannot try
    ("keep_on_plant", "beaten", OVER, replace(LIVE, tries=True), "neither of the two now"),
    ("keep_on_plant", "beaten", OVER, replace(LIVE, tries=True, moves=True, holds=True), None),
    ("try_on_plant", "beaten", OVER, replace(LIVE, tries=True), None),
    ("try_on_plant", "beaten", OVER, replace(LIVE, tries=True, moves=True), None),
    ("try_on_plant", "beaten", QUESTION, replace(LIVE, tries=True), "has not ended"),
    ("try_on_plant", "beaten", OVER, replace(LIVE, tries=True, recovery=Recovery.DUE), "old values"),
    ("try_on_plant", "beaten", OVER, RIG, "only a live plant"),
    ("try_on_plant", "new", OVER, replace(LIVE, tries=True), "nothing to try"),
    ("end_trial", "beaten", OVER, replace(LIVE, tries=True, moves=True), None),
    ("end_trial", "beaten", OVER, replace(LIVE, tries=True), "nothing is being tried"),
    ("go_on", "beaten", OVER, replace(LIVE, tries=True, moves=True), "stop it first"),
    ("keep_on_plant", "beaten", OVER, PlantFacts(), "on a rig"),
    ("keep_on_plant", "new", OVER, RIG, "nothing to try"),
    ("record", "new", RECORD, RIG, None),
    ("record", "asked", QUESTION, RIG, None),  # it replaces one
    ("record", "new", QUESTION, RIG, "no record is waited for"),
    ("record", "asked", RUNNING, RIG, "no record is waited for"),
    ("record", "asked", QUESTION, PlantFacts(), "takes no record"),
    ("write_and_start", "asked", CONFIRM, replace(LIVE, ready=True), None),
    ("write_and_start", "asked", CONFIRM, LIVE, "not known yet"),
    ("write_and_start", "asked", CONFIRM, replace(LIVE, recovery=Recovery.FAILED), "old values"),
    ("write_and_start", "asked", QUESTION, replace(LIVE, ready=True), "no run is to be confirmed"),
    ("stop_run", "asked", RUNNING, PlantFacts(stops=True), None),
    ("stop_run", "asked", RUNNING, PlantFacts(), "run in seconds"),
    ("stop_run", "asked", QUESTION, PlantFacts(stops=True), "not running"),
    ("stop_run", "asked", RUNNING, replace(LIVE, moves=True), None),
    ("stop_run", "asked", RUNNING, LIVE, "not running"),
    ("undo", "asked", RUNNING, replace(LIVE, moves=True), "stop it first"),
    ("fail", "asked", FAILED, PlantFacts(), "is saved"),
    ("fail", "whole", FAILED, PlantFacts(), STALE),
    ("fail", "asked", QUESTION, PlantFacts(), STALE),
    ("retry", "asked", FAILED, PlantFacts(), None),
    ("retry", "asked", QUESTION, replace(LIVE, recovery=Recovery.FAILED), None),
    ("retry", "asked", QUESTION, PlantFacts(), "nothing has failed"),
    ("finish", "asked", FAILED, PlantFacts(), None),
    ("finish", "whole", OVER, PlantFacts(), "ended already"),
    ("go_on", "whole", OVER, PlantFacts(), None),
    ("go_on", "asked", QUESTION, PlantFacts(), "has not ended"),
]


@pytest.mark.parametrize(("what", "study", "phase", "plant", "why"), RULES)
def test_a_rule_allows_an_action_or_says_why_not(request, what, study, phase, plant, why):
    study = replace(request.getfixturevalue(study), phase=phase, plant=plant)
    refused = ACTIONS[what].refusal(study)
    assert refused is None if why is None else why in str(refused)


def test_the_table_has_a_line_for_each_action_but_the_answers_of_programs():
    assert {what for what, *_ in RULES} == set(ACTIONS) - {"give"}


@pytest.mark.parametrize("agent", [RandomSearch, GLIS])
def test_only_some_agents_change_how_many_questions_they_ask(asked, agent):
    interview = begin(toy_scenario(), agent=agent)
    assert interview.known.questions is None
    strategy = interview._driver.study.strategy
    assert "only the agent glisp" in str(ACTIONS["pace"].refusal(replace(asked, strategy=strategy)))


def test_what_takes_simulations_is_waited_for(whole):
    """Nobody knows the next θ yet: a retraction must not change it, and a choice needs simulations."""
    strategy = GLISp(toy_scenario().space, n_init=3, n_max=5, seed=1)
    study = replace(whole, simulates=True, strategy=strategy)
    retract = ACTIONS["retract"].refusal
    assert study.must_think
    assert "being chosen" in str(retract(replace(study, phase=RUNNING)))
    assert "try it again first" in str(retract(replace(study, phase=FAILED)))
    assert retract(replace(study, phase=OVER)) is None
    assert ACTIONS["choose"].refusal(replace(study, phase=OVER)) is None
    open_ = replace(study, state=replace(study.state, ended=None))
    assert open_.next() is Moment.THINK
    assert open_.feed(Led(0)).next() is not Moment.THINK  # it has thought: this follows from it


def test_a_repeated_question_can_always_be_skipped(new):
    state = replace(new.state, open=(7, Shown(1, 0, True, repeats=3)))
    study = replace(new, state=state, phase=QUESTION)
    assert study.repeats
    assert ACTIONS["undo"].refusal(study) is None
    assert ACTIONS["undo"].refusal(replace(study, phase=RUNNING)) is not None
