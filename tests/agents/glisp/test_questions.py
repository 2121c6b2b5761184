"""Follow-up questions: which are asked, and what they are worth."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefcal_agents import GLISp, GLISpSettings
from prefcal_agents.agent import AgentState, Setup
from prefcal_agents.glisp.agent import confirm_best, contenders, final_question, follow_up, insertion_question
from prefcal_agents.glisp.fits import Dataset, ModelSelection, NoiseTest, Selection, rows_of
from prefcal_agents.lessons import Preferences, cube_of
from prefcal_agents.surrogate import ExpectationPropagation, Shape
from prefcal_env.errors import SettingsError
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.preferences.answer import Answer, Mark
from support.histories import in_cube, studied
from support.studies import by, drive

SQUARE = KnobSpace([Knob("x", -1.0, 1.0, step=0), Knob("y", -1.0, 1.0, step=0)])
LINE = KnobSpace([Knob("x", 0.0, 1.0)])
SHAPE = Shape(1.0, (1.0,))
RATE = 0.1


def bowl(theta):
    return float(np.sum((theta - 0.3) ** 2))


# Whether the best sample really is the best.


def line(answers, marks=()):
    """Return samples on a line, each compared with the one named; marks come with the last."""
    rivals, given = zip((None, None), *answers, strict=True)
    told = [*given[:-1], Answer(given[-1], marks=marks)]
    return studied([[k / 10] for k in range(len(told))], answers=told, rivals=rivals)


def confirmed(history, sure=2.0):
    """Return the question about the best sample, if 1 of 10 answers is wrong."""
    selection = Selection(SHAPE, NoiseTest(SHAPE, 5.0), is_noisy=True)
    return confirm_best(Dataset.of(history), selection, RATE, sure)


def posterior_of(history):
    """Return what 1 wrong answer of 10 leaves to know: the posterior, and Ĵ of all samples."""
    z = cube_of(history)
    posterior = ExpectationPropagation.of(rows_of(Preferences.of(history), SHAPE), RATE)
    return posterior, SHAPE.basis(z, z) @ posterior.mean


def test_the_best_is_compared_with_the_rival_that_is_least_surely_worse():
    history = line([(0, -1), (0, 1), (0, -1), (0, -1), (2, -1), (5, 1)])
    posterior, _ = posterior_of(history)
    features = SHAPE.basis(cube_of(history), cube_of(history))
    best = history.incumbent
    rest = [k for k in range(7) if k != best and not history.asked(best, k)]
    covariance = np.linalg.inv(posterior.root @ posterior.root.T)
    behind = {}
    for k in rest:
        row = features[k] - features[best]
        behind[k] = row @ posterior.mean / np.sqrt(row @ covariance @ row)
    rival = min(behind, key=behind.__getitem__)
    assert len(behind) > 2
    assert confirmed(history) == (max(best, rival), min(best, rival))


def test_a_sample_that_is_probably_better_than_the_best_is_asked_about_first():
    """Nine answers say that it gets better to the right, one that 9 lost against 0."""
    history = line([(k - 1, -1) for k in range(1, 9)] + [(8, -1)])
    history = history.with_follow_up(Answer(-1), 0, 9)
    pair = confirmed(history)
    assert history.incumbent == 0
    assert confirmed(history, sure=0.0) == pair
    _, values = posterior_of(history)
    assert values[max(pair)] < values[0]
    assert confirmed(line([(0, 1), (0, 1), (0, 1)]), sure=0.0) is None


def test_a_sample_that_met_the_best_is_not_asked_about_again():
    history = line([(0, 1), (0, 1), (1, -1)])
    assert confirmed(history) == (3, 0)
    assert confirmed(history.with_follow_up(Answer(1), 3, 0)) is None


@pytest.mark.parametrize("answer", [None, 0])
def test_a_question_without_a_clear_answer_is_not_asked_again(answer):
    history = line([(0, 1), (0, 1), (1, -1), (1, -1)])
    first = confirmed(history)
    assert confirmed(history.with_follow_up(Answer(answer), *first)) not in (first, None)
    retracted = history.with_follow_up(Answer(1), *first).retracted(0, follow_up=True)
    assert confirmed(retracted) not in (first, None)


def test_only_the_nine_samples_next_to_the_best_are_rivals():
    """The first beat all but the last two, which lost against the worst of these only."""
    few = line([(0, 1)] * 7 + [(7, 1), (7, 1)])
    assert confirmed(few, sure=np.inf) is not None
    many = line([(0, 1)] * 10 + [(10, 1), (10, 1)])
    assert confirmed(many, sure=np.inf) is None


def test_a_sample_that_is_surely_worse_is_not_asked_about():
    """Five answers each say that 1 is better than 0, and 2 better than 1."""
    history = line([(0, -1), (1, -1)])
    for _ in range(5):
        history = history.with_follow_up(Answer(-1), 1, 0)
        history = history.with_follow_up(Answer(-1), 2, 1)
    assert history.incumbent == 2
    assert confirmed(history) is None
    assert confirmed(history, sure=np.inf) == (2, 0)


def test_an_unsafe_sample_is_neither_the_best_nor_its_rival():
    answers = [(0, -1), (1, -1), (1, -1)]
    assert confirmed(line(answers)) == (3, 2)
    assert confirmed(line(answers, marks=(Mark.CHALLENGER_UNSAFE,))) == (2, 0)
    again = Answer(-1, marks=(Mark.CHALLENGER_UNSAFE,))  # 2 is better than 1, and unsafe
    assert confirmed(line(answers).with_follow_up(again, 2, 1)) == (3, 0)


def test_a_sample_that_was_not_compared_or_is_unsafe_is_no_contender():
    answers = (None, -1, -1, None, Answer(1, marks=(Mark.INCUMBENT_UNSAFE,)))
    points = [np.full(2, k / 5) for k in range(5)]
    history = studied(points, answers=answers, rivals=[None, 0, 1, 2, 2])
    assert contenders(history).tolist() == [0, 1, 4]


def test_if_every_sample_is_unsafe_all_that_were_compared_are_contenders():
    both = (Mark.CHALLENGER_UNSAFE, Mark.INCUMBENT_UNSAFE)
    assert contenders(line([(0, -1)], marks=both)).tolist() == [0, 1]


# The place of the latest sample.


def ranked(costs):
    """Return samples with these costs, each compared with the best before it."""
    return studied([[cost] for cost in costs], costs)


@given(st.lists(st.integers(0, 1000), min_size=3, max_size=40, unique=True))
def test_a_bisection_finds_the_place_of_a_loser_in_logarithmically_many_questions(costs):
    book, values = ranked([float(c) for c in costs]), np.array(costs, dtype=float)
    new = len(costs) - 1
    asked = 0
    while (pair := insertion_question(book, values)) is not None:
        assert pair[0] == new
        assert pair[1] != new
        book = book.with_follow_up(Answer(int(np.sign(costs[new] - costs[pair[1]]))), *pair)
        asked += 1
    assert asked <= np.ceil(np.log2(len(costs)))
    if costs[new] > min(costs[:-1]):
        order = sorted(costs)
        known = {(c.challenger, c.incumbent): c.answer.preference for c in book.latest}
        above, below = order.index(costs[new]) - 1, order.index(costs[new]) + 1
        # It met both neighbors, or it is the worst: nothing is left to ask.
        assert (new, costs.index(order[above])) in known
        assert below == len(order) or (new, costs.index(order[below])) in known
    else:
        assert asked == 0


@pytest.mark.parametrize("answer", [0, None])
def test_a_tie_and_an_abstention_need_no_further_question(answer):
    book = ranked([1.0, 2.0, 3.0]).with_pending(in_cube([2.5])).with_answer(Answer(answer), 0)
    assert insertion_question(book, np.array([1.0, 2.0, 3.0, 2.5])) is None


def test_answers_about_other_samples_do_not_change_the_bisection():
    history = line([(0, 1), (0, 1), (0, 1), (0, 1)])
    values = np.array([0.0, 1.0, 2.0, 3.0, 2.5])
    pair = insertion_question(history, values)
    also = history.with_follow_up(Answer(1), 3, 1)
    assert pair == insertion_question(also, values) == (4, 2)


def asked_after(history, **settings):
    """Return the follow-up question after `history`."""
    options = GLISpSettings(validate_at=(), kpis=False, **settings)
    return follow_up(history, ModelSelection(Setup(LINE, 2, 0, options)), options)


def test_a_follow_up_takes_three_experiments_and_a_question_that_is_left():
    history = line([(0, 1), (0, 1), (0, 1), (0, 1)])
    assert asked_after(history, questions_per_experiment=2)[0] == 4
    assert asked_after(history.until(2), questions_per_experiment=2) is None
    assert asked_after(history) is None
    once = history.with_follow_up(Answer(1), 4, 2)
    assert asked_after(once, questions_per_experiment=2) is None
    assert asked_after(once, questions_per_experiment=3) is not None


# Whole studies.


prefer = by(bowl)


def asking(questions, **counts):
    settings = GLISpSettings(questions_per_experiment=questions)
    return GLISp(SQUARE, settings=settings, **{"n_init": 4, "n_max": 12, **counts})


def run(agent, stop=None):
    return drive(agent, prefer, stop)


@pytest.mark.parametrize("questions", [2, 3, 12])
def test_no_experiment_gets_more_questions_than_allowed(questions):
    asked = run(asking(questions))
    further = [query.challenger.index for query in asked if query.further]
    assert further
    assert max(further.count(index) for index in set(further)) <= questions - 1
    assert [q.challenger.index for q in asked if not q.further] == list(range(12))


def test_asking_twice_copying_and_restoring_change_nothing():
    agent = asking(3)
    while not agent.done:
        query = agent.ask()
        state = AgentState.from_dict(agent.state.to_dict())
        assert agent.ask() == agent.copy().ask() == GLISp.restore(SQUARE, state).ask() == query
        run(agent, 1)


def test_what_a_state_says_of_further_answers_is_checked():
    agent = asking(3)
    run(agent, stop=9)
    plain = agent.state.to_dict()
    past = plain["history"]
    assert past["follow_ups"]
    for change in ({"after": 99}, {"challenger": 50}, {"incumbent": None}):
        broken = {**plain, "history": {**past, "follow_ups": [{**past["follow_ups"][0], **change}]}}
        with pytest.raises(SettingsError, match="follow-up answer"):
            GLISp.restore(SQUARE, AgentState.from_dict(broken))


def further_pairs(flips, questions, *, n_max=24, seed=0):
    """Return (challenger, incumbent, latest) of each follow-up question of a study.

    The answers about the experiments of `flips` are wrong.
    """
    truth = by(lambda theta: float(np.sum((theta - 0.2) ** 2)))
    agent, asked = asking(questions, n_init=6, n_max=n_max, seed=seed), []
    while not agent.done:
        latest = len(agent.samples) - 1
        wrong = lambda query: query.challenger.index in flips and not query.further  # noqa: E731
        (query,) = drive(agent, truth, 1, wrong=wrong)
        if query.further:
            asked.append((query.challenger.index, query.incumbent.index, latest))
    return asked


@pytest.mark.parametrize("questions", [2, 3])
def test_if_mistakes_are_suspected_other_samples_than_the_latest_are_asked_about(questions):
    others = 0
    for seed in range(4):
        asked = further_pairs({7, 9, 12, 16}, questions, seed=seed)
        others += sum(latest not in (a, b) for a, b, latest in asked)
        latest = [latest for *_, latest in asked]
        # After the last experiment former bests may meet the best, on top.
        assert max(latest.count(k) for k in latest if k < 23) <= questions - 1
    assert others >= 5


def test_someone_who_never_errs_is_asked_about_the_latest_sample_only():
    asked = further_pairs(set(), 3)
    assert asked
    assert all(latest == a for a, _, latest in asked)


def test_a_suspicion_leads_to_a_question_about_the_best_at_most_once_an_experiment():
    asked = further_pairs({7, 12, 16, 21, 27}, 1, n_max=40)
    before_the_end = [latest for *_, latest in asked if latest < 39]
    assert before_the_end
    assert len(before_the_end) == len(set(before_the_end))


def cut_short(history, *indices):
    """Return `history` as if the runs of these samples had been cut short."""
    marks = (Mark.CHALLENGER_CUT_SHORT,)
    return replace(
        history,
        comparisons=tuple(
            replace(c, answer=replace(c.answer, marks=marks)) if c.challenger in indices else c
            for c in history.comparisons
        ),
    )


def test_the_place_of_a_loser_is_found_among_whole_runs():
    costs = [1.0, 2.0, 3.0, 4.0, 5.0, 3.5]
    history, values = ranked(costs), np.array(costs)
    assert insertion_question(history, values) == (5, 3)
    assert insertion_question(cut_short(history, 3), values) == (5, 2)
    assert insertion_question(cut_short(history, 1, 2, 3, 4), values) is None
    assert insertion_question(cut_short(history, 5), values) is None


def test_a_rival_that_was_cut_short_after_it_was_asked_about_keeps_its_place():
    costs = [1.0, 2.0, 3.0, 4.0, 5.0, 3.5]
    history, values = ranked(costs).with_follow_up(Answer(-1), 5, 3), np.array(costs)
    assert insertion_question(history, values) == (5, 2)
    assert insertion_question(cut_short(history, 3), values) == (5, 2)


def test_a_run_cut_short_is_no_contender():
    history = line([(0, 1), (0, 1), (0, 1)])
    assert contenders(history).tolist() == [0, 1, 2, 3]
    assert contenders(cut_short(history, 2)).tolist() == [0, 1, 3]


def test_a_former_best_that_was_cut_short_is_not_compared_at_the_end():
    history = line([(0, 0), (0, -1), (2, -1), (3, -1)])
    assert final_question(history) == (4, 0)
    assert final_question(cut_short(history, 0)) == (4, 2)
