"""Questions about who is the best, and a θ that the person asks for."""

import numpy as np
import pytest

from prefcal_agents import GLIS, GLISp, GLISpSettings, RandomSearch, restore
from prefcal_agents.agent import Agent, rematch
from prefcal_agents.baselines import LatinHypercube
from prefcal_agents.glisp.agent import FINALS, final_question
from prefcal_env.errors import KnobError, ProtocolError
from prefcal_env.knobs import Constraint, Knob, KnobSpace
from prefcal_env.preferences.answer import Answer, Preference
from prefcal_env.preferences.history import History
from support.histories import in_cube, studied
from support.interviews import THREE

LINE = KnobSpace([Knob("x", 0.0, 1.0)])


def line(*answers):
    """Samples on a line, each compared with the one that is named."""
    rivals, given = zip((None, None), *answers, strict=True)
    return studied([[k / 50] for k in range(len(given))], answers=given, rivals=rivals)


def reigning(changes, *others):
    """A record in which the best changes so often, after `others`."""
    history = line(*others)
    for _ in range(changes):
        history = history.with_pending(in_cube(np.array([history.answered / 50])))
        history = history.with_answer(Answer(-1), history.incumbent)
    return history


def test_nothing_is_open_while_each_new_sample_meets_the_best():
    assert rematch(History()) is None
    assert rematch(line((0, -1), (1, 1), (1, 0), (1, None))) is None


def test_two_that_never_lost_are_compared_once():
    history = line((0, -1), (1, -1), (1, None)).with_follow_up(Answer(-1), 3, 0)
    assert history.incumbent == 2
    assert rematch(history) == (3, 2)
    for answer in (-1, 0, 1, None):
        assert rematch(history.with_follow_up(Answer(answer), 3, 2)) is None
    assert history.with_follow_up(Answer(-1), 3, 2).incumbent == 3
    undecided = history.with_follow_up(Answer(None), 3, 2)
    assert undecided.incumbent == 2
    assert rematch(undecided.retracted(1, follow_up=True)) == (3, 2)


@pytest.mark.parametrize("agent", [GLISp, GLISp.paper, RandomSearch])
def test_after_the_last_experiment_the_unbeaten_ones_meet(agent):
    """Taking back that 2 beat 1 leaves both unbeaten: 1 beat 0, and 2 beat 3 and 4."""
    study = agent(LINE, n_init=3, n_max=5, seed=0)
    for answer in (None, -1, -1, 1, 1):
        study.tell(study.ask(), answer)
    assert study.done
    study.retract(2)
    query = study.ask()
    assert not study.done
    assert query.further
    assert (query.challenger.index, query.incumbent.index, study.best_index) == (2, 1, 1)
    study.tell(query, -1)
    assert study.done
    assert study.best_index == 2


def test_small_steps_add_up_so_former_bests_are_asked_about_at_the_end():
    history = reigning(4, (0, 0))
    best = history.incumbent
    assert final_question(history) == (best, 0)
    won = history.with_follow_up(Answer(1), best, 0)
    assert won.incumbent == 0
    asked, kept = [], history
    while (pair := final_question(kept)) is not None:
        asked.append(pair)
        kept = kept.with_follow_up(Answer(-1), *pair)
    assert asked == [(best, 0), (best, 2), (best, 3)]  # the one before it was met already
    assert kept.incumbent == best


def test_no_more_than_three_questions_come_after_the_last_experiment():
    history, count = reigning(9, (0, 0)), 0
    while (pair := final_question(history)) is not None:
        history, count = history.with_follow_up(Answer(-1), *pair), count + 1
    assert count == FINALS == 3


def test_someone_who_always_sees_a_difference_is_not_asked_again():
    assert final_question(reigning(6)) is None


@pytest.mark.parametrize(("settings", "least"), [(GLISpSettings.paper(), 11), (None, 14)])
def test_the_papers_agent_takes_every_answer_for_true(settings, least):
    agent = GLISp(LINE, n_init=2, n_max=12, seed=0, settings=settings)
    asked = 0
    while not agent.done:
        query = agent.ask()
        asked += query.incumbent is not None
        tie = query.challenger.index == 1
        agent.tell(query, Preference.TIE if tie else Preference.CHALLENGER)
    # Others may ask on a suspicion, too.
    assert asked == least or (asked > least and settings is None)


def test_what_is_open_is_a_function_of_the_record_and_remembered():
    agent, other = (GLISp(LINE, n_init=2, n_max=9, seed=0) for _ in range(2))
    for answer in (None, -1, 1, -1):
        agent.tell(agent.ask(), answer)
    history = agent.history
    assert not agent.knows(history)
    longer, queries = agent.open(agent.turn(history), 3)
    assert agent.history == history  # it changes nothing
    assert agent.knows(history)
    assert agent.copy().knows(history)  # a copy remembers, too
    assert other.open(other.turn(history), 3) == (longer, queries)  # and another agent finds the same
    assert len(longer.samples) == history.answered + 3
    assert agent.ask(3) == queries
    assert agent.history == longer


def test_what_a_copy_works_out_its_original_need_not():
    agent = GLISp(LINE, n_init=2, n_max=9, seed=0)
    agent.tell(agent.ask(), None)
    twin, query = agent.copy(), agent.ask()
    twin.tell(twin.ask(), -1)
    expected = twin.ask()
    agent.tell(query, -1)
    assert agent.knows(agent.history)
    assert agent.ask() == expected


def test_an_agent_that_returns_a_theta_that_ran_gets_a_random_one():
    class Stubborn(Agent):
        version = 1

        def propose(self, history):
            return np.array([0.5])

    agent = Stubborn(LINE, n_init=2, n_max=5, seed=0)
    while not agent.done:
        agent.tell(agent.ask(), 0 if agent.history.answered else None)
    assert agent.samples[0, 0] == 0.5
    assert len(set(agent.samples[:, 0])) == 5


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
