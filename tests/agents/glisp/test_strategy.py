from contextlib import contextmanager

import numpy as np
import pytest
from prefcal_agents.doubt import Doubt, Doubts
from prefcal_agents.learner import Learner

from prefcal_agents import GLISp, GLISpSettings
from prefcal_agents.acquisition.expected_improvement import ExpectedImprovement
from prefcal_agents.acquisition.exploration import Acquisition
from prefcal_agents.glisp.schedule import FEW
from prefcal_agents.models.preference_gp import PreferenceGP
from prefcal_agents.models.surrogate import Composite, Surrogate
from prefcal_env.knobs.knob import Knob, KnobSpace
from support.studies import by, drive

pytestmark = pytest.mark.unchecked  # for speed: the contract suite checks the shapes

CUBE = KnobSpace([Knob(name, 0.0, 1.0) for name in "abcd"])
SQUARE = KnobSpace([Knob("a", 0.0, 1.0, step=0), Knob("b", 0.0, 1.0, step=0)])


def bowl(theta):
    return float(np.sum((theta - np.resize([0.3, 0.6], len(theta))) ** 2))


def off(theta):
    """A KPI that explains every answer."""
    return {"off": bowl(theta)}


def study(count, space=SQUARE, *, outcomes=None, agent=None, **settings):
    """An agent after `count` answers; `outcomes` maps θ to KPIs."""
    agent = agent or GLISp(space, n_init=4, n_max=40, seed=2, settings=GLISpSettings(**settings))
    drive(agent, by(bowl), count, kpis=outcomes)
    return agent


def changed(*, kpis=None, **settings):
    """Numbers of experiments after which cross-validation has chosen another ε."""
    agent, epsilons = study(0, **settings), []
    for _ in range(27):
        drive(agent, by(bowl), 1, kpis=kpis)
        epsilons.append(agent.epsilon)
    return {k for k in range(2, 28) if epsilons[k - 1] != epsilons[k - 2]}


def test_the_shape_is_validated_where_the_surrogate_has_a_turn():
    found = changed()
    assert min(found) == 4  # the start is over
    assert {k % 2 for k in found if k < FEW} == {0, 1}
    assert {k % 2 for k in found if k >= FEW} == {0}


@pytest.mark.parametrize("options", [{"process": False}, {"kpis": off}], ids=["alone", "KPIs"])
def test_without_the_process_or_with_kpis_the_shape_is_validated_after_every_experiment(options):
    assert {k % 2 for k in changed(**options) if k >= FEW} == {0, 1}


@pytest.mark.parametrize("process", [True, False])
def test_every_knob_has_its_turn_in_the_cross_validation(process, monkeypatch):
    seen = set()

    def noted(validation, shape, score, candidates, *, knob):
        seen.add(knob)
        return shape

    monkeypatch.setattr("prefcal_agents.learner.rescale_knob", noted)
    agent = study(FEW, CUBE, process=process)
    seen.clear()
    study(8, CUBE, agent=agent).ask()
    assert seen == {0, 1, 2, 3}


def test_during_a_long_start_nothing_is_validated():
    agent = GLISp(SQUARE, n_init=130, n_max=140, seed=2)
    study(118, agent=agent)
    assert agent.epsilon == agent.settings.epsilon


def test_answers_to_further_questions_may_contradict_each_other(monkeypatch):
    told = []
    process = PreferenceGP.of

    def noted(preferences, error_rate):
        told.append(error_rate)
        return process(preferences, error_rate)

    monkeypatch.setattr(PreferenceGP, "of", noted)
    study(FEW + 1).ask()
    assert set(told) == {0.0}
    told.clear()
    agent = GLISp(SQUARE, n_init=4, settings=GLISpSettings(questions_per_experiment=3))
    while len(told) < 2:
        drive(agent, by(bowl), 1)
    assert set(told) == {0.003}


def test_the_paper_s_variant_minimises_its_acquisition_at_every_step():
    agent = study(12, agent=GLISp.paper(SQUARE, n_init=4, n_max=40, seed=2))
    assert all(isinstance(minimised(agent, k).surrogate, Surrogate) for k in (10, 11, 12))
    agent = study(FEW - 8, agent=agent)
    assert all(isinstance(minimised(agent, k).surrogate, Surrogate) for k in (FEW, FEW + 1))


def test_later_every_second_proposal_is_the_mean_of_a_process_that_keeps_the_answers():
    agent, off = study(FEW + 4), study(FEW + 4, process=False)
    later = range(FEW - 2, FEW + 4)
    kinds = [type(minimised(agent, index).surrogate) for index in later]
    assert kinds == [Surrogate] * 2 + [Surrogate, PreferenceGP] * 2
    assert {type(minimised(off, index).surrogate) for index in later} == {Surrogate}


def test_doubted_answers_teach_the_process_with_their_chance_of_being_wrong(monkeypatch):
    agent, told = study(FEW + 3), []
    monkeypatch.setattr(Learner, "is_noisy", lambda *given: True)
    doubt = Doubt(agent._learner.shape(agent._session.history), 100.0)
    monkeypatch.setattr(Doubts, "after", lambda *given: doubt)
    process = PreferenceGP.of

    def noted(preferences, error_rate):
        told.append(error_rate)
        return process(preferences, error_rate)

    monkeypatch.setattr(PreferenceGP, "of", noted)
    for index in (FEW + 1, FEW + 3):
        assert isinstance(minimised(agent, index).surrogate, PreferenceGP)
    assert told == [0.1, 0.1]


def test_kpis_teach_the_surrogate():
    agent = study(
        14,
        outcomes=lambda theta: {"off": bowl(theta), "none": float(theta[0] > 0.5)},
        outcome_scales=(1.0,),
        expected_improvement=False,  # samples not so close that no QP tells them apart
    )
    learned = agent._learner.learned(agent._session.history)
    assert isinstance(learned, Composite)
    assert np.all(learned.over_kpis.weights >= 0)
    assert learned.over_kpis.weights.max() > 0
    values = learned(learned.centres)
    latent = [bowl(SQUARE.decode(z)) for z in learned.centres]
    assert np.argmin(values) == np.argmin(latent)


def minimised(agent, index):
    """What the sample number `index` of the study is a minimum of."""
    history = agent._session.history.until(index)
    return agent._strategy._acquisition(history)


@pytest.mark.parametrize("space", [SQUARE, CUBE])
def test_where_kpis_count_the_expected_improvement_is_maximised(space):
    counting = {"outcomes": off, "outcome_scales": (1.0,)}
    agent = study(9, space, **counting)
    assert isinstance(minimised(agent, 9), ExpectedImprovement)
    agent = study(9, space, **counting, expected_improvement=False)
    # The process knows no KPIs, so it has no turns either.
    assert all(isinstance(minimised(agent, k).surrogate, Composite) for k in (8, 9))
    assert isinstance(minimised(study(9, space), 9), Acquisition)


def test_where_all_are_ties_nothing_can_be_improved_on():
    agent = GLISp(SQUARE, n_init=2, n_max=9, seed=2)
    drive(agent, lambda new, old: 0, 8, kpis=off)
    assert isinstance(minimised(agent, 8), Acquisition)
    assert agent.ask().challenger.theta.tolist() not in agent.samples.tolist()[:8]


def test_where_answers_are_doubted_none_is_taken_for_right(monkeypatch):
    agent = study(9, outcomes=off, outcome_scales=(1.0,))
    assert isinstance(minimised(agent, 9), ExpectedImprovement)
    monkeypatch.setattr(Learner, "is_noisy", lambda *given: True)
    doubt = Doubt(agent._learner.shape(agent._session.history), 100.0)
    monkeypatch.setattr(Doubts, "after", lambda *given: doubt)
    assert isinstance(minimised(agent, 9), Acquisition)


def test_linear_algebra_keeps_to_one_thread_in_proposals(monkeypatch):
    limited = []

    @contextmanager
    def one_thread():
        limited.append(True)
        yield
        limited.append(False)

    def learned(self, history, *given, **options):
        assert limited[-1:] == [True]
        return real(self, history, *given, **options)

    real = Learner.learned
    monkeypatch.setattr("prefcal_agents.glisp.strategy.one_thread", one_thread)
    monkeypatch.setattr(Learner, "learned", learned)
    agent = GLISp(KnobSpace([Knob("x", 0, 1)]), n_init=2, n_max=6)
    drive(agent, lambda new, old: 1)
    assert limited.count(True) == limited.count(False) >= 4
