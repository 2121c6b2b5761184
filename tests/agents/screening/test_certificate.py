"""What is said of a result: what it follows from, and when nothing is said."""

from dataclasses import replace

import numpy as np
import pytest

from prefcal_agents import Screening
from prefcal_agents.screening.agent import FROM, LEAST, MOST, Certificate, Evidence, evidence
from prefcal_agents.screening.bank import Growth, Simulations
from prefcal_env.preferences.answer import Answer, Preference, Reading
from prefcal_env.preferences.history import History
from support.simulated import SQUARE, in_chain

KNOWN = Evidence(10, 0.01, 0.002, 2.0, -0.4, True, 0.3, (0.5, 0.5))
WON, SAME, LOST = -1, 0, 1
"""What the challenger did."""


def both(theta):
    """Two KPIs that one θ, the corner at zero, has best."""
    return {"a": 0.1 + theta[0], "b": 0.1 + theta[1] ** 2}


class Limited:
    """A simulation of both KPIs with upper limits on them."""

    def __init__(self, limits):
        self.reading = Reading(limits=limits)

    def __call__(self, theta):
        return both(theta)


def grown():
    return Growth(Simulations(both), SQUARE, 100, 0)


def from_worst(growth):
    """Rows of the first bank, the worst one first."""
    return np.argsort(-growth.stage(History()).bank.thetas.sum(axis=1))


def after(growth, rows, answers, best):
    """The evidence about row `best` of the first bank after a chain of answers."""
    record = in_chain(growth.stage(History()).bank, rows, answers)
    stage = growth.stage(record)
    theta = growth.stage(History()).bank.thetas[best]
    return evidence(stage, stage.bank.find(theta), record)


def answered(agent, count):
    """The agent after `count` answers of a person who wants the smaller sum of both KPIs."""
    for _ in range(count + 1):
        query = agent.ask()
        if query.incumbent is None:
            agent.tell(query, Answer(None))
        else:
            new, old = (sum(both(side.theta).values()) for side in (query.challenger, query.incumbent))
            agent.tell(query, Preference(int(np.sign(new - old))))
    return agent


def test_nobody_is_said_to_prefer_what_is_no_better_in_any_kpi():
    growth = grown()
    *_, second, best = from_worst(growth)
    found = after(growth, [second, best], [WON], best)
    first = growth.stage(History()).bank
    kpis = growth.stage(in_chain(first, [second, best], [WON])).bank.kpis
    dominated = np.all(kpis >= first.kpis[best], axis=1)
    assert dominated.any()
    assert found.better <= 1 - dominated.mean()


def test_of_the_worst_it_is_said_that_most_are_better_and_of_the_best_that_few_are():
    growth = grown()
    worst, *_, best = from_worst(growth)
    poor, good = (after(growth, [worst, best], [WON], row) for row in (worst, best))
    assert poor.better > 0.5 > 0.2 > good.better
    assert poor.wide > 0.7 > good.wide
    assert poor.chance > 0.9 > good.chance


def test_a_result_holds_longer_with_every_challenger_that_it_beats_until_one_wins():
    growth = grown()
    rows = from_worst(growth)[::-1]  # the best one first
    chain = rows[[20, 0, 1, 2, 3]]
    held = [after(growth, chain[: k + 2], [WON, SAME, LOST, SAME][: k + 1], rows[0]).held for k in range(4)]
    assert held[0] == 0
    assert 0 < held[1] < held[2]
    assert after(growth, chain, [WON, SAME, LOST, WON], rows[0]).held == 0


def test_answers_that_follow_from_the_kpis_are_predicted_and_contradictions_are_not():
    growth = Growth(Simulations(lambda t: {"a": 0.1 + t[0], "b": 1 + 5 * t[0]}), SQUARE, 100, 0)
    rows = np.argsort(-growth.stage(History()).bank.thetas[:, 0])[[0, 5, 10, 15, 19]]
    sensible = after(growth, rows, [WON] * 4, rows[-1])
    absurd = after(growth, rows, [WON, LOST, LOST, WON], rows[-1])
    assert absurd.predicted < np.log(1 / 3) < sensible.predicted < 0


def test_nothing_is_promised_that_was_shown_or_that_failed():
    growth = Growth(
        Simulations(lambda t: both(t) if t[0] > 0.5 else {"a": np.inf, "b": np.inf}), SQUARE, 100, 0
    )
    rows = from_worst(growth)
    bank = growth.stage(History()).bank
    usable = rows[~bank.hopeless[rows]]
    found = after(growth, usable[-3:], [WON, WON], usable[-1])
    assert found.promising not in {tuple(bank.thetas[row]) for row in usable[-3:]}
    assert found.promising[0] > 0.5


@pytest.mark.parametrize("badly", [{"predicted": np.log(1 / 3) - 0.01}, {"explained": False}])
def test_if_answers_do_not_follow_from_the_kpis_no_number_is_stated(badly):
    said = Certificate.of(replace(KNOWN, **badly))
    assert not said.explained
    assert said.share is None
    assert said.chance is None
    assert Certificate.of(KNOWN).explained


@pytest.mark.parametrize(
    ("worse", "better"),
    [
        ({"better": 0.1}, {"better": 0.0}),
        ({"wide": 0.1}, {"wide": 0.0}),
        ({"held": 0.0}, {"held": 6.0}),
        ({"answers": 2}, {"answers": 20}),
        ({"predicted": -1.0}, {"predicted": -0.1}),
    ],
)
def test_each_piece_of_evidence_moves_the_share_the_right_way(worse, better):
    poor, middle, good = (
        Certificate.of(e).share for e in (replace(KNOWN, **worse), KNOWN, replace(KNOWN, **better))
    )
    assert poor >= middle >= good
    assert poor > good


def test_the_share_is_a_whole_percentage_between_the_least_and_all():
    sure, vague = replace(KNOWN, held=50.0), replace(KNOWN, better=1.0, wide=1.0, held=0.0, answers=2)
    assert Certificate.of(sure).share == LEAST
    assert Certificate.of(vague).share == 1.0
    assert Certificate.of(KNOWN).share * 100 == pytest.approx(round(Certificate.of(KNOWN).share * 100))


def test_the_share_by_hand():
    said = Certificate.of(Evidence(10, 0.099, 0.009, 2.0, -0.5, True, 0.5, ()))
    size = 10 ** (1.583 + 0.382 * -1 - 0.177 * np.log(10) - 0.169 * 2 + 0.615 * -2 - 0.364 * -0.5)
    assert said.share == pytest.approx(np.ceil(100 * size) / 100)
    assert said.chance == pytest.approx(0.5)


def test_it_is_enough_after_six_and_eight_answers_if_share_and_chance_are_small():
    good = replace(KNOWN, answers=6, better=0.0, wide=0.0)
    assert Certificate.of(good).share <= 0.1
    assert Certificate.of(good).enough
    assert Certificate.of(replace(good, answers=8)).enough
    for less in ({"answers": 5}, {"answers": 7}, {"chance": 0.51}, {"wide": 0.1}, {"explained": False}):
        assert not Certificate.of(replace(good, **less)).enough
    assert Certificate.of(replace(good, chance=0.5)).enough


def test_an_agent_has_enough_only_while_its_best_misses_no_objective(monkeypatch):
    agents = [
        Screening(SQUARE, simulate=simulate, n_simulated=60, n_max=8, seed=3)
        for simulate in (both, Limited({"a": 5.0}), Limited({"a": 0.05}))
    ]
    for agent in agents:
        answered(agent, 5)
    assert not any(agent.has_enough(agent.history) for agent in agents)
    monkeypatch.setattr(Certificate, "of", lambda found: Certificate(0.1, 0.95, 0.5, (), None, enough=True))
    assert [agent.has_enough(agent.history) for agent in agents] == [True, True, False]
    assert not agents[0].has_enough(agents[0].history.until(2)), "one answer says nothing"
    assert not agents[0].done, "whoever asks may go on"


def test_the_number_of_random_experiments_by_hand():
    said = Certificate.of(Evidence(10, 0.099, 0.009, 2.0, -0.5, True, 0.5, ()))
    size = 1.583 + 0.382 * -1 - 0.177 * np.log(10) - 0.169 * 2 + 0.615 * -2 - 0.364 * -0.5
    for number, chance in zip(said.experiments[:2], (0.05, 0.5), strict=True):
        share = 10 ** (size - 0.544 * (np.log(chance / (1 - chance)) - np.log(0.01 / 0.99)))
        assert (1 - share) ** number == pytest.approx(0.5), "so many find nothing better half of the time"
    assert said.experiments[0] < said.experiments[1] < said.experiments[2] == MOST
    poor, *_ = Certificate.of(replace(KNOWN, better=1.0, wide=1.0, held=0.0, answers=2)).experiments
    assert poor == 1
    assert Certificate.of(replace(KNOWN, explained=False)).experiments is None


def test_the_draws_are_believed_less_the_surer_they_are():
    chances = [Certificate.of(replace(KNOWN, chance=p)).chance for p in (0.0, 0.1, 0.5, 0.9, 1.0)]
    assert chances == sorted(chances)
    assert 0.1 < chances[1] < 0.5 < chances[3] < 0.9
    assert chances[0] + chances[-1] == pytest.approx(1.0)


def test_an_agent_says_nothing_at_first_and_the_same_after_a_restart():
    agents = [Screening(SQUARE, simulate=both, n_simulated=60, n_max=8, seed=3) for _ in range(2)]
    first = answered(agents[0], FROM - 1)
    assert first.certificate is None
    said = answered(agents[1], 5).certificate
    assert said is not None
    assert said.explained
    again = Screening(SQUARE, simulate=both, n_simulated=60, n_max=8, seed=3)
    assert answered(again, 5).certificate == said


def test_what_an_agent_says_of_a_sensible_person_is_true():
    agent = answered(Screening(SQUARE, simulate=both, n_simulated=100, n_max=12, seed=1), 10)
    thetas = np.random.default_rng(0).random((2000, 2))
    sums = np.array([sum(both(theta).values()) for theta in thetas])
    assert np.mean(sums < sum(both(agent.best).values())) <= agent.certificate.share < 0.5


def test_where_experiments_measure_other_kpis_than_those_simulated_nothing_is_said():
    agent = Screening(SQUARE, simulate=both, n_simulated=60, n_max=8, seed=0)
    for _ in range(4):
        query = agent.ask()
        told = [
            {k: 1.3 * v for k, v in both(side.theta).items()}
            for side in (query.challenger, query.incumbent)
            if side
        ]
        agent.tell(
            query, Answer(None if len(told) < 2 else Preference.CHALLENGER, outcomes=(*told, None)[:2])
        )
    assert agent.certificate is None
