"""In a robust study only θ are shown that keep the limits, and what that costs is known."""

import numpy as np

from prefcal_agents import Screening
from prefcal_agents.screening import agent as screening
from prefcal_agents.screening.agent import Certificate
from prefcal_agents.screening.bank import ENOUGH
from prefcal_env.knobs import Knob, KnobSpace

SPACE = KnobSpace([Knob("gain", 0.0, 1.0), Knob("filter", 0.0, 1.0)])


class Fast:
    """Faster with a larger gain, of which those above `edge` do not hold for long."""

    def __init__(self, edge=0.6, kept=5):
        self.edge, self.kept = edge, kept

    def __call__(self, theta):
        gain, filtered = theta
        return {"time": 2.0 - gain, "noise": 1.0 + 0.2 * gain - 0.1 * filtered}

    def holds(self, thetas, most):
        return [self.kept if theta[0] > self.edge else most for theta in thetas]


class Plain(Fast):
    holds = None


def studied(simulate, seed=0, n_max=7, start=None):
    """A finished study of a person who wants it fast."""
    agent = Screening(SPACE, simulate=simulate, n_simulated=200, n_max=n_max, seed=seed, start=start)
    while not agent.done:
        query, answer = agent.ask(), None
        if query.incumbent is not None:
            answer = int(np.sign(query.incumbent.theta[0] - query.challenger.theta[0]))
        agent.tell(query, answer)
    return agent


def test_the_result_holds_whatever_was_shown():
    for seed in range(3):
        assert 0.5 < studied(Fast(), seed).best[0] <= 0.6
        assert studied(Plain(), seed).best[0] > 0.9


def test_the_last_questions_show_what_holds():
    for seed in range(3):
        assert studied(Fast(edge=0.1), seed).samples[-3:, 0].max() <= 0.1


def test_it_follows_from_seed_and_record():
    assert np.array_equal(studied(Fast(), 1).samples, studied(Fast(), 1).samples)


def test_what_holds_everywhere_is_chosen_as_if_nothing_was_asked():
    assert np.array_equal(studied(Fast(edge=1.0)).samples, studied(Plain()).samples)


def test_where_nothing_holds_a_study_goes_on():
    agent = studied(Fast(edge=-1.0, kept=40))
    assert agent.robustness.kept == 40
    assert len(agent.samples) == 7


def test_the_price_is_what_the_best_nominal_one_is_better_in():
    found = studied(Fast()).robustness
    assert found.kept == ENOUGH
    ours, theirs = found.costs["time"]
    assert 1.4 <= ours > theirs >= 1.0
    assert studied(Fast(edge=1.0)).robustness.costs == {}
    assert studied(Plain()).robustness is None


def test_a_tuning_of_the_persons_own_is_shown_and_one_that_holds_takes_its_place():
    agent = studied(Fast(), start=[[0.95, 0.5]])
    assert agent.samples[0].tolist() == [0.95, 0.5]
    assert agent.best[0] <= 0.6
    assert agent.robustness.kept == ENOUGH


def test_a_study_does_not_end_by_itself_while_its_best_does_not_hold(monkeypatch):
    monkeypatch.setattr(Certificate, "of", lambda found: Certificate(0.1, 0.95, 0.5, (), None, enough=True))
    enough = [
        agent.has_enough(agent.history)
        for agent in (studied(Plain()), studied(Fast(edge=1.0)), studied(Fast(edge=-1.0, kept=ENOUGH - 1)))
    ]
    assert enough == [True, True, False]


def test_what_does_not_hold_is_not_on_the_menu(monkeypatch):
    monkeypatch.setattr(screening, "others", lambda costs, logs, usable, result: range(len(costs[0])))
    agent = studied(Fast())
    offered = agent.bank.thetas[list(agent.menu)]
    assert len(offered) > 10
    assert offered[:, 0].max() <= 0.6


class Stuck(Fast):
    """Never there with a small gain."""

    def __call__(self, theta):
        return {**super().__call__(theta), "reached": np.inf if theta[0] < 0.2 else 1.0}


def test_what_never_arrives_does_not_take_the_place_of_what_promises_more():
    assert studied(Stuck(edge=0.2)).samples[1:, 0].min() > 0.15


def test_a_reason_says_how_the_challenger_holds():
    agent = Screening(SPACE, simulate=Fast(), n_simulated=100, n_max=4)
    agent.tell(agent.ask(), None)
    assert agent.reason.kept == ENOUGH
