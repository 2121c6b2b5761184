"""A θ that the person asks for takes the place of the proposed one, for every kind of agent."""

import numpy as np
import pytest

from prefcal_agents import GLIS, GLISp, RandomSearch, restore
from prefcal_agents.baselines import LatinHypercube
from prefcal_env.errors import KnobError, ProtocolError
from prefcal_env.knobs import Constraint, Knob, KnobSpace
from support.interviews import THREE

SPACE = KnobSpace([Knob("gain", 0.01, 100.0, scale="log10"), Knob("N_p", 4, 40, integer=True)])
WANTED = np.array([0.1, 9.0])
AGENTS = [GLISp, GLISp.paper, GLIS, RandomSearch, LatinHypercube]


def made(agent, answers=2, **settings):
    """An agent after these answers."""
    study = agent(SPACE, n_init=3, n_max=6, seed=1, **settings)
    for count in range(answers):
        study.tell(study.ask(), given(study, count))
    return study


def given(study, count):
    """An answer, or a score."""
    return float(count) if study.by_value else (None if count == 0 else 1)


@pytest.mark.parametrize("agent", AGENTS)
@pytest.mark.parametrize("proposed", [True, False])
def test_the_next_query_is_about_the_requested_theta(agent, proposed):
    study = made(agent)
    if proposed:
        study.ask()
    study.replace_pending(WANTED)
    query = study.ask()
    assert query.challenger.index == 2
    assert query.challenger.theta.tolist() == WANTED.tolist()  # to the last digit
    assert (query.incumbent is None) == study.by_value
    if query.incumbent is not None:
        assert query.incumbent.index == study.best_index
    study.tell(query, given(study, 2))
    assert study.samples[2].tolist() == WANTED.tolist()
    while not study.done:
        study.tell(study.ask(), given(study, 3))
    assert len(study.samples) == 6


@pytest.mark.parametrize("agent", AGENTS)
def test_it_is_restored_copied_and_undone_like_a_proposed_one(agent):
    study = made(agent)
    study.replace_pending(WANTED)
    again = restore(SPACE, study.state)
    twin = study.copy()
    assert again.ask() == twin.ask() == study.ask()
    twin.tell(twin.ask(), given(twin, 2))
    twin.undo()
    assert twin.ask() == study.ask()
    before = study.ask()
    if not study.by_value:
        study.retract(1)
        assert study.ask().challenger == before.challenger
    study.undo()
    assert study.ask().challenger.index == 1


@pytest.mark.parametrize("agent", [GLISp, RandomSearch])
def test_the_theta_in_whose_place_it_came_is_free_again(agent):
    study = made(agent)
    former = study.ask().challenger.theta
    study.replace_pending(WANTED)
    study.replace_pending(former)
    assert study.ask().challenger.theta.tolist() == former.tolist()
    study.tell(study.ask(), 1)
    with pytest.raises(ProtocolError, match="experiment 3 of 3 was run with this θ"):
        study.replace_pending(former)


@pytest.mark.parametrize(
    ("theta", "words"),
    [
        ([1000.0, 9.0], "gain"),
        ([0.1, 9.5], "integer"),
        ([0.1], "shape"),
        ([np.nan, 9.0], "finite"),
        ([50.0, 9.0], "small"),
    ],
)
def test_a_theta_that_the_space_does_not_hold_is_refused_and_nothing_changes(theta, words):
    small = Constraint("small", lambda knobs: knobs["gain"] - 10.0)
    space = KnobSpace(SPACE.knobs, [small])
    study = RandomSearch(space, n_init=1, n_max=3, seed=0)
    before = study.ask()
    with pytest.raises(KnobError, match=words):
        study.replace_pending(np.array(theta))
    assert study.ask() == before


def test_a_step_from_one_that_ran_is_the_same_to_a_person():
    study = made(GLISp)
    ran = study.samples[1]
    with pytest.raises(ProtocolError, match="experiment 2 of 2"):
        study.replace_pending(ran * [1.0 + 1e-9, 1.0])


def test_nothing_can_be_asked_for_after_the_last_experiment():
    study = made(RandomSearch, 6)
    with pytest.raises(ProtocolError, match="all 6 experiments are answered"):
        study.replace_pending(WANTED)


def test_follow_up_questions_wait_until_it_is_answered():
    study = THREE(SPACE, n_init=3, n_max=9, seed=1)
    while not study.ask().further:
        study.tell(study.ask(), 1 if study.history.answered else None)
    study.replace_pending(WANTED)
    query = study.ask()
    assert not query.further
    assert query.challenger.theta.tolist() == WANTED.tolist()
    study.tell(query, 1)
    assert study.ask().further
