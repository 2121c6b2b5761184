import numpy as np
import pytest

from prefcal_agents import GLISp, GLISpSettings
from prefcal_agents.acquisition import Acquisition
from prefcal_agents.doubt import Doubt, Doubts
from prefcal_agents.improvement import ExpectedImprovement
from prefcal_agents.kernel import KernelShape
from prefcal_agents.surrogate import Composite
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.preference import Answer

pytestmark = pytest.mark.unchecked  # for speed: the contract suite checks the shapes

SQUARE = KnobSpace([Knob("a", 0.0, 1.0), Knob("b", 0.0, 1.0)])


def bowl(theta):
    return float(np.sum((theta - np.resize([0.3, 0.6], len(theta))) ** 2))


def study(count, space=SQUARE, *, outcomes=None, agent=None, **settings):
    """An agent after `count` answers; `outcomes` maps θ to KPIs."""
    agent = agent or GLISp(space, n_init=4, n_max=40, seed=2, settings=GLISpSettings(**settings))
    for _ in range(count):
        query = agent.ask()
        new, old = query.challenger, query.incumbent
        verdict = None if old is None else int(np.sign(bowl(new.theta) - bowl(old.theta)))
        if outcomes is None:
            agent.tell(query, verdict)
            continue
        both = (outcomes(new.theta), {} if old is None else outcomes(old.theta))
        agent.tell(query, Answer(verdict, outcomes=both))
    return agent


def test_each_surrogate_is_validated_when_it_has_a_turn_and_only_then():
    agent = study(13, kernel=True)
    agent.ask()
    # After 4 initial samples the kernel has the second and third of every four.
    assert {(ledger.answered, kernel) for ledger, kernel in agent._learner.shapes} == {
        (count, count % 4 in (1, 2)) for count in range(4, 14)
    }


def test_unless_asked_for_the_kernel_is_never_learned():
    agent = study(12)
    assert not any(kernel for _, kernel in agent._learner.shapes)


def test_the_paper_s_variant_learns_one_surrogate_in_the_whole_cube():
    agent = study(12, agent=GLISp.paper(SQUARE, n_init=4, n_max=40, seed=2))
    assert not any(kernel for _, kernel in agent._learner.shapes)
    turns = {agent._strategy.turn(index) for index in range(4, 30)}
    assert [(t.kernel, t.perturbed, t.local) for t in turns] == [(False, False, False)]


def test_local_proposals_stay_near_the_best_sample():
    agent = study(6, trust_region=0.01)  # the third after the initial samples: the first local one
    query = agent.ask()
    assert np.max(np.abs(query.challenger.theta - query.incumbent.theta)) <= 0.01 + 1e-12


def test_a_trust_region_of_integers_that_holds_nothing_new_is_left():
    grid = KnobSpace([Knob("a", 0, 3, integer=True), Knob("b", 0, 2, integer=True)])
    agent = study(12, grid, trust_region=0.01)
    assert len({tuple(theta) for theta in agent.samples}) == 12


@pytest.mark.parametrize("kernel", [False, True])
def test_kpis_teach_either_surrogate(kernel):
    agent = study(
        14,
        outcomes=lambda theta: {"off": bowl(theta), "none": float(theta[0] > 0.5)},
        kernel=kernel,
        outcome_scales=(1.0,),
        expected_improvement=False,  # samples not so close that no QP tells them apart
    )
    learned = agent._learner.learned(agent._turns.ledger, kernel=kernel)
    assert isinstance(learned, Composite)
    assert isinstance(learned.over_theta.shape, KernelShape) == kernel
    assert np.all(learned.over_kpis.weights >= 0)
    assert learned.over_kpis.weights.max() > 0
    values = learned(learned.centres)
    latent = [bowl(SQUARE.decode(z)) for z in learned.centres]
    assert np.argmin(values) == np.argmin(latent)


def minimised(agent, index):
    """What the sample number `index` of the study is a minimum of."""
    strategy = agent._strategy
    return strategy._acquisition(
        agent._turns.ledger, strategy.turn(index), np.random.default_rng(0)
    )


CUBE = KnobSpace([Knob(name, 0.0, 1.0) for name in "abcd"])


def off(theta):
    """A KPI that explains every answer."""
    return {"off": bowl(theta)}


@pytest.mark.parametrize("space", [SQUARE, CUBE])
def test_where_kpis_count_the_expected_improvement_is_maximised(space):
    counting = {"outcomes": off, "outcome_scales": (1.0,)}
    agent = study(9, space, **counting)
    assert isinstance(minimised(agent, 9), ExpectedImprovement)
    agent = study(9, space, **counting, expected_improvement=False)
    assert isinstance(minimised(agent, 9), Acquisition)
    assert isinstance(minimised(study(9, space), 9), Acquisition)


def test_where_all_are_ties_nothing_can_be_improved_on():
    agent = GLISp(SQUARE, n_init=2, n_max=9, seed=2)
    for _ in range(8):
        query = agent.ask()
        rival, pair = query.incumbent, (off(query.challenger.theta), None)
        agent.tell(query, Answer(None if rival is None else 0, outcomes=pair))
    assert isinstance(minimised(agent, 8), Acquisition)
    assert agent.ask().challenger.theta.tolist() not in agent.samples.tolist()[:8]


def test_where_answers_are_doubted_none_is_taken_for_right(monkeypatch):
    agent = study(9, outcomes=off, outcome_scales=(1.0,))
    assert isinstance(minimised(agent, 9), ExpectedImprovement)
    doubt = Doubt(agent._learner.shape(agent._turns.ledger), 100.0)
    monkeypatch.setattr(Doubts, "after", lambda *given: doubt)
    assert isinstance(minimised(agent, 9), Acquisition)
