"""An Adjusted event: settings of the agent, changed within a study."""

from dataclasses import replace

import pytest

from prefcal_env.errors import StudyError
from prefcal_env.study import Adjusted, Shown, StudyFile, Suggested
from prefcal_env.study.fold import step
from support.interviews import clock
from support.studies import CONFIGURATION, compared

AGENT = {"agent": "any", "seed": 3, "settings": {"delta": 0.3, "questions": 3}}


@pytest.fixture
def study():
    """Experiments 0 to 2, all compared."""
    with StudyFile.create(":memory:", {**CONFIGURATION, "agent": AGENT}, clock=clock()) as file:
        for index, preference in enumerate((None, 1, 1)):
            compared(file, index, preference)
        yield file


def test_it_changes_the_named_settings_of_the_agent_and_nothing_else(study):
    before = study.state
    study.append(Shown(2, 1, True))
    shown = study.state
    study.append(Adjusted({"questions": 5, "scales": [0.0, 1.0]}))
    after = study.state
    assert after.configuration["agent"] == {
        **AGENT, "settings": {"delta": 0.3, "questions": 5, "scales": [0.0, 1.0]},
    }  # fmt: skip
    assert replace(after, configuration=before.configuration) == shown
    assert before.configuration["agent"] == AGENT


def test_a_question_that_the_agent_no_longer_asks_goes_with_the_next_sample(study):
    study.append(Shown(2, 1, True), Adjusted({"questions": 1}))
    assert study.state.open is not None
    study.append(Suggested(3, (0.5,), (0.5,)))
    assert study.state.open is None


@pytest.mark.parametrize("agent", [None, [], {}, {"settings": 3}])
def test_a_study_whose_agent_has_no_settings_refuses_it(study, agent):
    state = replace(study.state, configuration={**CONFIGURATION, "agent": agent})
    with pytest.raises(StudyError, match="event 9 is impossible: the agent of the study has no"):
        step(state, 9, "now", Adjusted({"questions": 2}))
