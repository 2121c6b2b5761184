"""What a history teaches, as arrays."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
from scipy.linalg import lapack

from prefcal_agents import GLISp, GLISpSettings
from prefcal_agents.lessons import MOST, Marks, Preferences, Subset, judged, scores_of
from prefcal_agents.search import Acquisition, SafetyModel
from prefcal_agents.surrogate import Shape, Surrogate
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.preferences.answer import Answer, Mark
from prefcal_env.preferences.history import Comparison, History
from prefcal_env.qp import PIQPSolver
from support.histories import in_cube, studied


def told(*answers):
    return studied([(float(h), 0.5) for h in range(len(answers))], answers=answers)


def test_preferences_name_the_samples_that_were_compared():
    taught = Preferences.of(told(None, 1, -1, 0, None, Answer(-1, strength=3)))
    assert taught.first.tolist() == [1, 2, 3, 5]
    assert taught.second.tolist() == [0, 0, 2, 2]
    assert taught.b.tolist() == [1, -1, 0, -1]
    assert taught.weights.tolist() == [1, 1, 1, 3]
    assert taught.samples.shape == (6, 2)


def test_a_later_answer_keeps_its_rival_when_an_earlier_one_is_retracted():
    taught = Preferences.of(told(None, -1, -1).retracted(1))
    assert taught.first.tolist() == [2]
    assert taught.second.tolist() == [1]


def test_a_score_teaches_no_preference_even_if_a_study_file_holds_one():
    history = told(Answer(None, value=2.0), Answer(-1, value=1.0))
    assert len(Preferences.of(history)) == 0
    assert scores_of(history)[1].tolist() == [2.0, 1.0]


pytestmark = pytest.mark.unchecked  # for speed: the contract suite checks the shapes

CUBE = KnobSpace([Knob(name, 0.0, 1.0) for name in "abc"])
LARGEST = 350  # samples and KPIs


def bowl(z):
    return float(np.sum((np.array(z) - 0.4) ** 2))


def long_history(count, *, kpis=False, errs=0.0, abstains_until=0):
    """Random samples, each compared with the best one before it."""
    rng, best, comparisons = np.random.default_rng(0), 0, []
    samples = [tuple(z) for z in rng.random((count, len(CUBE)))]
    known = [{"k": bowl(z), "l": z[0]} if kpis else None for z in samples]
    for h in range(count):
        verdict, rival = None, None if h == 0 else best
        if h > abstains_until:
            verdict = int(np.sign(bowl(samples[h]) - bowl(samples[best])))
            verdict *= -1 if rng.random() < errs else 1
        pair = (known[h], None if rival is None else known[rival]) if kpis else None
        comparisons.append(Comparison(h, rival, Answer(verdict, outcomes=pair)))
        best = h if verdict == -1 else best
    return History(tuple(map(in_cube, samples)), tuple(comparisons))


def contradicted(history):
    """The same, and four answers about a sample that lost were given the other way round."""
    lost = [c for c in history.comparisons[-40:] if c.answer.preference == 1]
    for c in lost[:4]:
        history = history.with_follow_up(Answer(-1), c.challenger, c.incumbent)
    return history


def taught(history):
    """(challenger, incumbent, preference) of all answers."""
    p = Preferences.of(history)
    return list(zip(p.first.tolist(), p.second.tolist(), p.b.tolist(), strict=True))


def test_of_a_long_study_the_oldest_and_the_latest_answers_are_remembered():
    history = long_history(1000)
    memory = Subset.of(history)
    assert len(Preferences.of(memory.history)) == MOST
    assert MOST <= len(memory.kept) <= MOST * 4 / 3
    assert {*range(MOST // 4), *range(1000 - MOST * 3 // 4, 1000), history.incumbent} <= set(
        memory.kept.tolist()
    )
    assert [history.samples[i] for i in memory.kept] == list(memory.history.samples)


def test_what_is_remembered_was_answered_in_that_order():
    history = contradicted(long_history(500))
    memory = Subset.of(history)
    there = [(int(memory.kept[a]), int(memory.kept[b]), p) for a, b, p in taught(memory.history)]
    assert [answer for answer in taught(history) if answer in there] == there
    assert len(memory.history.follow_ups) == 4


def test_of_several_answers_about_a_sample_the_last_one_is_remembered_first():
    history = long_history(2)
    for h in range(2, 40):
        history = history.with_pending(in_cube(np.full(3, h / 40))).with_answer(Answer(1), 0)
        history = history.with_follow_up(Answer(-1), h, 1)
    memory = Subset.of(history, most=40)
    assert memory.kept.tolist() == list(range(40))
    assert sum(c.teaches for c in memory.history.comparisons) == 2  # of samples 1 and 39
    assert len(memory.history.follow_ups) == 38


def test_abstentions_teach_kpis_of_the_latest_samples():
    history = long_history(1000, kpis=True, abstains_until=989)
    memory = Subset.of(history)
    assert len(Preferences.of(memory.history)) == 10
    assert len(memory.kept) == MOST
    assert 999 in memory.kept
    assert memory.history.kpis.names == history.kpis.names
    assert memory.history.kpis.values.tolist() == history.kpis.values[memory.kept].tolist()


@pytest.fixture
def largest(monkeypatch):
    """Sizes of the matrices factorized, and of the quadratic programs solved."""
    sizes = []

    def watch(module, name):
        plain = getattr(module, name)

        def noted(a, *args, **kwargs):
            sizes.append(len(a))
            return plain(a, *args, **kwargs)

        monkeypatch.setattr(module, name, noted)

    for name in ("cholesky", "eigh", "inv"):
        watch(np.linalg, name)
    watch(scipy.linalg, "cho_factor")
    watch(lapack, "dpotrf")
    plain = PIQPSolver.solve_box

    def noted(self, P, q, upper):
        sizes.append(len(q))
        return plain(self, P, q, upper)

    monkeypatch.setattr(PIQPSolver, "solve_box", noted)
    return sizes


def of_history(history, settings):
    count = history.answered
    fresh = GLISp(CUBE, n_init=count, n_max=count + 10, settings=settings)
    return GLISp.restore(CUBE, replace(fresh.state, history=history))


@pytest.mark.parametrize(("count", "contradicts"), [(400, False), (1000, True)])
def test_no_proposal_of_a_long_study_solves_a_large_problem(count, contradicts, largest):
    """With KPIs, or with answers that contradict each other."""
    history = long_history(count, kpis=not contradicts, errs=0.1 if contradicts else 0.0)
    told = contradicted(history) if contradicts else history
    agent = of_history(told, GLISpSettings())
    while agent.ask().further:
        assert agent.best_index in {agent.ask().challenger.index, agent.ask().incumbent.index}
        agent.tell(agent.ask(), 1)
    assert agent.ask().challenger.index == count
    sure = of_history(agent.state.history, GLISpSettings(error_rate=0.0))
    thetas = agent.samples[:3]
    assert np.array_equal(agent.surrogate(thetas), sure.surrogate(thetas)) != contradicts
    assert max(largest) <= LARGEST


def test_exploration_keeps_away_from_forgotten_samples():
    z = np.array([[0.1, 0.1], [0.9, 0.9]])
    surrogate = Surrogate(z[:1], np.zeros(1), Shape(1.0, (1.0, 1.0)))
    assert Acquisition.of(surrogate, 0.3)(z)[1] < 0
    assert Acquisition.of(surrogate, 0.3, z)(z)[1] == 0
    assert not Acquisition.of(surrogate, 0.3, z).value_and_gradient(z[1])[1].any()


def test_rare_marks_are_remembered():
    z = np.random.default_rng(0).random((1000, 2))
    unsafe = np.arange(1000) % 50 == 0
    for labels in (unsafe, ~unsafe):
        centers = SafetyModel.of(z, labels).centers
        assert len(centers) == MOST
        assert all(np.any(np.all(centers == rare, axis=1)) for rare in z[unsafe])


def test_a_run_cut_short_counts_as_safe_only_if_somebody_marked_it():
    cut, good = Mark.CHALLENGER_CUT_SHORT, Mark.CHALLENGER_GOOD_ENOUGH
    history = told(None, 1, Answer(1, marks=(cut,)), Answer(1, marks=(cut, good)))
    assert Marks.of(history).samples[:, 0].tolist() == [0.0, 1.0, 3.0]
    assert not Marks.of(history).unsafe.any()
    assert Marks.of(told(None, 1, 1, 1)).samples[:, 0].tolist() == [0.0, 1.0, 2.0, 3.0]


# Models of KPIs, and runs that were cut short.


CUT = Mark.CHALLENGER_CUT_SHORT


def with_cut(*, cut=True):
    marks = (CUT,) if cut else ()
    made = History(tuple(in_cube([z]) for z in (0.0, 1.0, 0.9)))
    made = made.with_answer(Answer(None, outcomes=({"a": 1.0, "b": 5.0}, None)), None)
    made = made.with_answer(Answer(1, outcomes=({"a": 4.0, "b": 6.0}, None)), 0)
    return made.with_answer(
        Answer(1, outcomes=({"a": 9.0}, {"a": 1.0, "b": 5.0}), marks=marks, automatic=marks), 0
    )


def test_a_history_without_runs_cut_short_stays_the_same_object():
    whole = with_cut(cut=False)
    assert judged(whole) is whole


def test_kpis_become_those_of_the_nearest_whole_run_or_their_bounds():
    taught = judged(with_cut()).comparisons[2]
    assert dict(taught.answer.outcomes[0]) == {"a": 9.0, "b": 6.0}
    assert dict(taught.answer.outcomes[1]) == {"a": 1.0, "b": 5.0}


def test_an_answer_about_a_run_cut_short_teaches_nothing_about_kpis_but_all_about_theta():
    made = with_cut()
    assert [c.challenger for c in made.lessons] == [1, 2]
    assert [c.challenger for c in judged(made).lessons] == [1]


def test_a_later_experiment_does_not_change_what_an_earlier_cut_taught():
    made = with_cut()
    later = replace(made, samples=(*made.samples, in_cube([0.89]))).with_answer(
        Answer(1, outcomes=({"a": 2.0, "b": 99.0}, None)), 0
    )
    assert judged(later).comparisons[:3] == judged(made).comparisons
    assert judged(later).until(3) == judged(later.until(3))


@pytest.mark.parametrize(
    ("kpis", "marks"),
    [
        ({"a": np.inf, "b": np.inf, "interrupted": 1.0}, ()),
        ({"a": 40.0, "b": 60.0}, (Mark.CHALLENGER_UNSAFE,)),
    ],
)
def test_a_run_that_was_not_completed_says_nothing_about_one_cut_short_nearby(kpis, marks):
    made = History(tuple(in_cube([z]) for z in (0.0, 0.95, 0.9)))
    made = made.with_answer(Answer(None, outcomes=({"a": 1.0, "b": 5.0}, None)), None)
    made = made.with_answer(Answer(1, outcomes=(kpis, None), marks=marks), 0)
    bounds = {"a": 2.0, "interrupted": 0.0}
    made = made.with_answer(Answer(1, outcomes=(bounds, None), marks=(CUT,)), 0)
    taught = judged(made).comparisons[2].answer.outcomes[0]
    assert dict(taught) == {"a": 2.0, "b": 5.0, "interrupted": 0.0}
