"""What is learned of a person from comparisons of KPIs, without a study."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contracts.proposals import MIXED
from prefcal_agents import Screening, Taste
from prefcal_agents.agent import AgentState
from prefcal_agents.taste import Told
from prefcal_env.errors import PreferenceError
from prefcal_env.preferences.answer import Answer, Outcome
from support.agents import quick
from support.simulated import everything

RNG = np.random.default_rng(0)
TABLE = [{"a": float(a), "b": float(b)} for a, b in RNG.uniform(1.0, 10.0, (40, 2))]


def wanted(kpis):
    """The cost of somebody who looks at "a" only."""
    return kpis["a"]


def pairs(count, seed=0):
    """Pairs of experiments."""
    rows = np.random.default_rng(seed).integers(0, len(TABLE), (count, 2))
    return [(TABLE[i], TABLE[j]) for i, j in rows if i != j]


def said(asked):
    return [int(np.sign(wanted(a) - wanted(b))) for a, b in asked]


@pytest.fixture(scope="module")
def taste():
    asked = pairs(12)
    return Taste.learn(said(asked), asked, usual=TABLE)


def test_answers_to_come_are_predicted(taste):
    asked = pairs(60, seed=1)
    found = [taste.predict(a, b) for a, b in asked]
    right = [np.sign(p.worse - p.better) == s for p, s in zip(found, said(asked), strict=True)]
    assert np.mean(right) > 0.85
    assert all(sum(p) == pytest.approx(1.0) for p in found)


def test_the_other_way_round_is_the_other_way_round(taste):
    a, b = TABLE[:2]
    one, other = taste.predict(a, b), taste.predict(b, a)
    assert (one.better, one.same, one.worse) == pytest.approx((other.worse, other.same, other.better))


def test_two_equal_experiments_are_most_likely_called_the_same(taste):
    found = taste.predict(TABLE[0], TABLE[0])
    assert found.same > found.better == found.worse


def test_a_table_is_ranked_as_the_person_would(taste):
    order = taste.rank(TABLE)
    assert sorted(order) == list(range(len(TABLE)))
    costs = np.array([wanted(TABLE[row]) for row in order])
    assert np.corrcoef(costs, np.arange(len(costs)))[0, 1] > 0.8
    assert taste.rank([]) == ()


def test_without_an_answer_the_better_one_in_all_kpis_is_expected_to_win():
    before = Taste.learn([], [], usual=TABLE)
    found = before.predict({"a": 1.0, "b": 1.0}, {"a": 9.0, "b": 9.0})
    assert found.better > 0.6 > 3 * found.worse


def test_whose_answers_follow_from_nothing_gets_no_sure_predictions():
    asked = pairs(30, seed=2)
    whims = np.random.default_rng(5).choice([-1, 1], len(asked)).tolist()
    steady, fickle = (Taste.learn(answers, asked, usual=TABLE) for answers in (said(asked), whims))
    far = {"a": 1.0, "b": 9.0}, {"a": 9.0, "b": 1.0}
    assert max(steady.predict(*far)) > 0.9
    assert max(fickle.predict(*far)) < 0.85


def test_the_same_seed_gives_the_same_taste():
    asked = pairs(5)
    one, same, other = (Taste.learn(said(asked), asked, seed) for seed in (3, 3, 4))
    assert one.predict(*TABLE[:2]) == same.predict(*TABLE[:2]) != other.predict(*TABLE[:2])


def test_a_study_tells_the_taste_of_its_person():
    agent = by_first(another(0))
    taste, usual = Taste.of(agent.history), quick(agent.best)
    poor = {**usual, "first": 10 * usual["first"] + 1.0}
    assert taste.predict(usual, poor).better > 0.7


def by_first(agent):
    """Answer a whole study as somebody who looks at one KPI only."""
    while not agent.done:
        query = agent.ask()
        old = query.incumbent
        if old is None:
            agent.tell(query, None)
            continue
        a, b = quick(query.challenger.theta), quick(old.theta)
        agent.tell(query, Answer(int(np.sign(a["first"] - b["first"])), outcomes=(a, b)))
    return agent


def another(seed, taste=()):
    return Screening(MIXED, simulate=quick, n_simulated=60, n_max=5, seed=seed, taste=taste)


def test_a_taste_travels_and_the_first_experiments_are_better():
    told = Told.all_of(by_first(Screening(MIXED, simulate=quick, n_simulated=60, seed=9)).history)
    alone, taught = (
        [quick(another(seed, t).ask().challenger.theta)["first"] for seed in range(6)] for t in ((), told)
    )
    assert np.mean(taught) < 0.7 * np.mean(alone)


def test_a_study_that_began_with_a_taste_goes_on_from_its_state_alone():
    told = Told.all_of(by_first(another(0)).history)
    study = by_first(another(1, told))
    again = Screening.restore(MIXED, AgentState.from_dict(json.loads(json.dumps(study.state.to_dict()))))
    again = again.with_simulations(quick)
    assert again.setup.settings.taste == told
    assert np.array_equal(again.best, study.best)
    assert everything(again).influences == everything(study).influences
    assert Screening(MIXED, simulate=quick).state.settings == (("n_simulated", 1000),)


def test_of_a_record_only_answers_about_whole_runs_with_kpis_travel():
    history = by_first(another(0)).history
    told = Told.all_of(history)
    assert len(told) == len(history.lessons) == 4
    assert len(Told.all_of(history.retracted(1))) == 3
    assert Told.of(told[0].plain) == Told.of(told[0]) == told[0]
    never = Told(0, Outcome({"a": np.inf}), Outcome({"a": 1.0}))
    assert Told.of(json.loads(json.dumps(never.plain))) == never


@pytest.mark.parametrize("plain", [3, (1,), (2, {"a": 1.0}, {"a": 2.0}), (1, 3, 4), (1, (("a", "x"),), ())])
def test_what_cannot_travel_is_refused(plain):
    with pytest.raises(PreferenceError):
        another(0, (plain,))


@pytest.mark.parametrize(
    ("answers", "kpis", "message"),
    [
        ([1], [], "each answer needs a pair of KPIs: 1 answers, 0 pairs"),
        ([2], [(TABLE[0], TABLE[1])], "an answer must be -1, 0 or 1, got 2"),
        ([None], [(TABLE[0], TABLE[1])], "an answer must be -1, 0 or 1"),
        ([1], [({"a": "x"}, {"a": 1.0})], "a KPI must be a name and a number"),
        ([1], [TABLE[0]], "a pair of KPIs must be two experiments"),
        ([1], [3], "a pair of KPIs must be two experiments, got 3"),
        ([1], 3, "pairs of KPIs must be several, in order, got 3"),
        ("1", [(TABLE[0], TABLE[1])], "answers must be several, in order, got '1'"),
        ([], [], "a taste needs the KPIs of experiments"),
        ({1}, [(TABLE[0], TABLE[1])], "answers must be several, in order"),
    ],
)
def test_what_is_no_answer_is_refused(answers, kpis, message):
    with pytest.raises(PreferenceError, match=message):
        Taste.learn(answers, kpis)


@pytest.mark.parametrize("usual", [3, "abc", {"a": 1.0}])
def test_usual_kpis_that_are_none_are_refused(usual):
    with pytest.raises(PreferenceError, match="usual KPIs must be several, in order, got"):
        Taste.learn([1], [(TABLE[0], TABLE[1])], usual=usual)


def test_answers_and_pairs_may_come_one_by_one():
    pairs = [(TABLE[0], TABLE[1]), (TABLE[1], TABLE[2])]
    one_by_one = Taste.learn(iter([1, -1]), iter(pairs), usual=iter(TABLE))
    assert one_by_one.rank(TABLE) == Taste.learn([1, -1], pairs, usual=TABLE).rank(TABLE)


@pytest.mark.parametrize("seed", [-1, 0.5, "a", None, [1]])
def test_a_seed_that_is_none_is_refused(seed):
    with pytest.raises(PreferenceError, match="seed must be an integer, 0 or more"):
        Taste.learn([1], [(TABLE[0], TABLE[1])], seed=seed)


@pytest.mark.parametrize("table", [3, True, "abc", {"a": 1.0}])
def test_a_table_that_is_none_is_refused(taste, table):
    with pytest.raises(PreferenceError, match="a table must be several, in order, got"):
        taste.rank(table)


def test_a_kpi_that_is_not_given_is_named(taste):
    with pytest.raises(PreferenceError, match=r"about \['a', 'b'\], but \['b'\] are not given"):
        taste.predict({"a": 1.0}, {"a": 2.0})


VALUES = st.floats(width=64)
KPIS = st.dictionaries(st.sampled_from("ab"), VALUES, max_size=2)


@settings(max_examples=10, deadline=None)
@given(st.lists(st.tuples(st.sampled_from([-1, 0, 1]), st.tuples(KPIS, KPIS)), min_size=1, max_size=3))
def test_no_values_break_it(given_answers):
    answers, kpis = zip(*given_answers, strict=True)
    taste = Taste.learn(answers, kpis)
    both = [side for pair in kpis for side in pair]
    if set().union(*both) >= set(taste.scale.names):
        assert sorted(taste.rank(both)) == list(range(len(both)))
