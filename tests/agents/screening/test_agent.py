"""Whom an agent that simulates takes for the best, whatever its simulation does and its KPIs miss."""

import json
import warnings
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from contracts.proposals import HALF, MIXED, RARE, SMALL, TINY, judge, run
from prefcal_agents import Screening, restore
from prefcal_agents.agent import AgentState
from prefcal_agents.glisp.fits import ModelSelection
from prefcal_agents.screening.agent import BeyondKPIs, _look_alike, without_kpis
from prefcal_agents.screening.bank import Growth, Simulations
from prefcal_agents.screening.findings import findings
from prefcal_env.errors import ProtocolError, SettingsError, SimulationError
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.preferences.answer import Answer, Mark, Reading
from prefcal_env.preferences.history import History, Lead
from support.agents import quick
from support.simulated import SQUARE, in_chain


def wanted(theta):
    """The cost of a person who looks at the KPI "first" before all others."""
    kpis = quick(theta)
    return kpis["first"] + 0.05 * kpis["others"]


def sure(query):
    if query.incumbent is None:
        return None
    return int(np.sign(wanted(query.challenger.theta) - wanted(query.incumbent.theta)))


def agent(seed, n_max=10):
    return Screening(MIXED, simulate=quick, n_simulated=50, n_max=n_max, seed=seed)


def test_a_sure_person_is_asked_once_for_each_experiment_and_their_winner_is_the_best():
    for seed in range(5):
        study = agent(seed)
        while not study.done:
            study.tell(study.ask(), sure(study.ask()))
        assert study.history.follow_ups == ()
        assert study.history.leads == ()


def after_a_mistake(seed):
    """A study of a sure person who once says that a better experiment is worse, and its pair."""
    study, wrong = agent(seed, n_max=14), None
    while not study.done:
        query = study.ask()
        answer = sure(query)
        if wrong is None and study.history.answered > 2 and answer == -1:
            wrong, answer = (query.challenger.index, query.incumbent.index), 1
        study.tell(query, answer)
    return study, wrong


def test_a_mistake_of_a_sure_person_mostly_costs_the_best_nothing_and_never_a_question():
    led, mistakes, lost = 0, 0, 0
    for seed in range(12):
        study, wrong = after_a_mistake(seed)
        if wrong is None:  # the best one came too early to be called worse
            continue
        mistakes += 1
        costs = [wanted(theta) for theta in study.samples]
        assert study.history.follow_ups == ()
        led += bool(study.history.leads)
        lost += costs[study.best_index] > costs[wrong[0]]
    assert mistakes >= 3
    assert lost <= 1
    assert led >= 1


@pytest.mark.parametrize("seed", [0, 3])  # with these, draws would overrule what won
def test_what_won_stays_the_best_of_a_person_who_hardly_follows_the_kpis(seed):
    study, rng = agent(seed), np.random.default_rng(seed)
    while not study.done:
        query = study.ask()
        study.tell(query, None if query.incumbent is None else int(rng.choice([-1, 1])))
    assert study.history.leads == ()
    assert study.best_index == study.history.by_answers


def test_a_study_goes_on_from_its_record_with_what_it_holds_for_the_best():
    study, _ = next(found for seed in range(9, 18) if (found := after_a_mistake(seed))[0].history.leads)
    again = Screening.restore(MIXED, AgentState.from_dict(study.state.to_dict()))
    assert again.history == study.history
    assert again.history.incumbent == study.best_index
    assert study.copy().best_index == study.best_index


def test_a_state_whose_best_was_never_compared_is_refused():
    study = agent(0)
    study.tell(study.ask(), None)
    state = study.state
    wrong = replace(state, history=replace(state.history, leads=(Lead(3, 1),)))
    with pytest.raises(SettingsError, match="the best one of a state cannot be"):
        Screening.restore(MIXED, wrong)


def pairs_of(study, choices, seed):
    """The pairs of a study of somebody who answers at random, in order."""
    rng, pairs = np.random.default_rng(seed), []
    while not study.done:
        query, answer = study.ask(), int(rng.choice(choices))
        if query.incumbent is not None:
            pairs.append(frozenset({query.challenger.index, query.incumbent.index}))
        study.tell(query, answer)
    return pairs


@pytest.mark.parametrize("choices", [(-1, 0, 1), (-1, 1), (0, 0, 1), (0,)])
def test_no_pair_comes_back_whatever_the_answers(choices):
    for seed in range(3):
        study = agent(seed, n_max=14)
        pairs = pairs_of(study, choices, seed)
        assert len(set(pairs)) == len(pairs) == 13


def test_the_first_two_meet_the_objectives_and_differ_clearly():
    def simulate(theta):
        x, y = theta
        return {"time": np.inf if x < 0.8 else 1.0 + y, "error": y, "calm": 0.5 + x}

    simulate.reading = Reading({"time": 0.01, "error": 0.01, "calm": 0.01}, {"error": 0.3, "time": 1.4})
    for seed in range(5):
        study = Screening(SQUARE, simulate=simulate, n_simulated=800, n_max=3, seed=seed)
        study.tell(study.ask(), None)
        query = study.ask()
        first, second = (simulate(s.theta) for s in (query.incumbent, query.challenger))
        assert all(kpis["error"] <= 0.3 and kpis["time"] <= 1.4 for kpis in (first, second))
        assert any(abs(first[n] - second[n]) >= 0.09 * abs(first[n]) for n in first)


def fast(theta):
    """The faster, the less is left of a margin; the other knob only costs time."""
    x, y = theta
    return {"M_s": 1.2 + x, "time": 1.1 - x + 0.5 * (y - 0.3) ** 2}


def margin_left(aims, seed, start=None):
    """M_s at the end of a study of a person who wants 2 at most, and then less time, by 0.05 or more."""

    def answer(query):
        if query.incumbent is None:
            return None
        first, second = (fast(s.theta) for s in (query.challenger, query.incumbent))
        poor, other = (kpis["M_s"] > 2.0 for kpis in (first, second))
        if poor != other:
            return 1 if poor else -1
        apart = first["time"] - second["time"]
        return int(np.sign(apart)) if abs(apart) > 0.05 else 0

    def simulate(theta):
        return fast(theta)

    simulate.reading = Reading({"M_s": 0.01, "time": 0.01}, {"M_s": 2.0}, aims=aims)
    study = Screening(SQUARE, simulate=simulate, n_simulated=300, n_max=9, seed=seed, start=start)
    while not study.done:
        study.tell(study.ask(), answer(study.ask()))
    return fast(study.best)["M_s"]


@pytest.mark.parametrize("seed", range(3))
def test_a_result_leaves_room_to_the_limit_of_a_margin(seed):
    assert margin_left({"M_s": 1.8}, seed) <= 1.8 < margin_left({}, seed) <= 2.0


@pytest.mark.parametrize("seed", range(3))
def test_what_somebody_prefers_stays_the_best_without_room_to_a_limit(seed):
    assert margin_left({"M_s": 1.8}, seed, start=[[0.76, 0.3]]) > 1.9


def test_differences_that_cannot_be_read_change_nothing():
    def simulate(theta):
        return {"a": 0.1 + theta[0], "b": 1.1 - theta[0], "c": 1e-7 * (1 + theta[1])}

    simulate.reading = Reading({"a": 0.001, "b": 0.001, "c": 0.001})
    study = Screening(SQUARE, simulate=simulate, n_simulated=60, n_max=4, seed=0)
    study.tell(study.ask(), None)
    assert np.all(study.bank.kpis[:, study.bank.names.index("c")] == 0.0)
    reason = findings(study).reason
    assert "c" not in (*reason.better_in, *reason.worse_in)


FROZEN = MIXED.narrowed({"weight": (0.31, 0.31), "horizon": (3, 5)})
LINE = KnobSpace([Knob("gain", 1e-6, 1e6, scale="log10")])
SPACES = {
    "mixed": MIXED,
    "small": SMALL,
    "tiny": TINY,
    "half": HALF,
    "rare": RARE,
    "frozen": FROZEN,
    "line": LINE,
}
ODD = (np.nan, np.inf, -np.inf, 0.0, 1e308, -1e308, 5e-324, 1.0)
KINDS = ("fine", "odd", "missing", "constant", "huge", "none", "empty", "raises")
ANSWERS = (
    -1,
    0,
    1,
    None,
    Answer(-1, strength=3),
    Answer(1, marks=(Mark.CHALLENGER_UNSAFE,)),
    Answer(None, marks=(Mark.INCUMBENT_GOOD_ENOUGH,)),
)


def wild(kinds, names, theta):
    """A simulation that does one of `kinds`, as θ decides, and writes into θ."""
    rng = np.random.default_rng(list(theta.tobytes()))
    kind = kinds[rng.integers(len(kinds))]
    theta[:] = np.nan
    if kind == "raises":
        raise ArithmeticError("diverged")
    if kind in ("none", "empty"):
        return None if kind == "none" else {}
    values = rng.standard_normal(len(names))
    if kind == "odd":
        values = rng.choice(ODD, size=len(names))
    if kind in ("constant", "huge"):
        values = np.full(len(names), 2.0) if kind == "constant" else values * 1e307
    found = dict(zip(names, values, strict=True))
    return dict(list(found.items())[: rng.integers(len(names)) + 1]) if kind == "missing" else found


def check(agent):
    """Check what people and programs read of an agent with an open question."""
    bank = agent.bank
    assert not np.isnan(bank.kpis).any()
    assert len({theta.tobytes() for theta in bank.thetas}) == len(bank) == len(bank.z)
    assert all(agent.space.allows(t) and agent.space.searches(t) for t in bank.thetas)
    assert agent.simulations.count >= len(bank)
    said = findings(agent)
    assert said.chance_of_better is None or 0 <= said.chance_of_better <= 1
    reason = said.reason
    if reason is not None:
        assert 0 <= reason.chance <= 1
        named = {*reason.better_in, *reason.worse_in}
        assert named <= set(bank.names)
        assert not set(reason.better_in) & set(reason.worse_in)


@settings(max_examples=60)
@given(
    kinds=st.lists(st.sampled_from(KINDS), min_size=1, max_size=3),
    names=st.sampled_from(["a", "ab", "abcdefg"]),
    space=st.sampled_from(list(SPACES)),
    n_simulated=st.sampled_from([1, 2, 3, 20]),
    answers=st.lists(st.sampled_from(ANSWERS), min_size=5, max_size=5),
    seed=st.integers(0, 9),
)
@example(["constant"], "ab", "mixed", 20, [1, -1, 0, 1, -1], 0)
@example(["odd"], "a", "line", 20, [1, -1, 0, 1, -1], 0)
@example(["huge", "raises"], "abcdefg", "tiny", 20, [1, -1, 0, 1, -1], 0)
def test_any_simulation_makes_a_study(kinds, names, space, n_simulated, answers, seed):
    make = partial(Screening, SPACES[space], n_simulated=n_simulated, n_max=5, seed=seed)
    agent = make(simulate=partial(wild, kinds, names))
    try:
        agent.ask()
    except SimulationError:
        assert {*kinds} & {"raises", "none", "empty", "odd"}
        assert agent.simulations.failed == agent.simulations.count
        return
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for answer in answers:
            check(agent)
            agent.tell(agent.ask(), answer)
    while not agent.done:  # follow-up questions
        agent.tell(agent.ask(), judge(agent.ask()))
    assert len({theta.tobytes() for theta in agent.samples}) == 5
    assert agent.best.tolist() in agent.samples.tolist()
    assert all(agent.space.allows(theta) for theta in agent.samples)
    assert agent.simulations.count <= n_simulated + 5


def test_what_failed_or_is_interrupted_is_not_shown_while_anything_else_is_there():
    def fragile(theta):
        if theta[0] > 0.3:
            raise ArithmeticError("diverged")
        return quick(theta) if theta[2] < 0 else dict.fromkeys(quick(theta), np.inf)

    agent = Screening(MIXED, simulate=fragile, n_simulated=60, n_max=6)
    run(agent)
    assert agent.simulations.failed > 10
    assert np.all(agent.samples[:, 0] <= 0.3)
    assert np.all(agent.samples[:, 2] < 0)


def test_what_is_shown_was_simulated_before_it_is_asked_about():
    agent = Screening(MIXED, simulate=quick, n_simulated=50, n_max=5, start=(0.5, 7, -1.0))
    while not agent.done:
        query = agent.ask()
        count = agent.simulations.count
        bank = agent.bank
        if query.challenger.index:  # the first one may be a given θ, not simulated yet
            assert np.array_equal(bank.thetas[bank.find(query.challenger.theta)], query.challenger.theta)
            assert bank.find(query.incumbent.theta) is not None
        assert agent.simulations.count == count or not query.challenger.index
        agent.tell(query, judge(query))


def test_what_a_copy_simulates_is_not_simulated_again():
    runs = []

    def simulate(theta):
        runs.append(1)
        return quick(theta)

    agent = Screening(MIXED, simulate=simulate, n_simulated=60, n_max=8)
    run(agent, [None, -1])
    twin = agent.copy()
    twin.tell(twin.ask(), -1)
    expected, count = twin.ask(), len(runs)
    agent.tell(agent.ask(), -1)
    assert agent.ask() == expected
    assert len(runs) == count
    assert twin.simulations is agent.simulations
    other = agent.with_simulations(quick)
    assert (other.simulate, other.simulations.count) == (quick, 0)


def test_a_restored_agent_repeats_its_question_and_simulates_again_when_told_how():
    agent = Screening(MIXED, simulate=quick, n_simulated=40, n_max=6, start=(0.5, 7, -1.0))
    run(agent, [None, -1, 1])
    query = agent.ask()
    stored = AgentState.from_dict(json.loads(json.dumps(agent.state.to_dict())))
    bare = restore(MIXED, stored)
    assert bare.ask() == query
    assert bare.simulate is None
    for use in (lambda: bare.bank, lambda: bare.simulations):
        with pytest.raises(SettingsError, match="needs simulate"):
            use()
    again = restore(MIXED, stored, simulate=quick)
    assert (again.n_simulated, again.simulate) == (40, quick)
    assert run(again) == run(agent)
    assert again.bank.kpis.tolist() == agent.bank.kpis.tolist()


@pytest.mark.parametrize("n_simulated", [0, -1, 2.5, "many", None, True])
def test_an_impossible_number_of_simulations_is_refused(n_simulated):
    with pytest.raises(SettingsError, match="n_simulated"):
        Screening(MIXED, simulate=quick, n_simulated=n_simulated)


def test_a_state_with_another_number_of_simulations_goes_on_with_that():
    agent = Screening(MIXED, simulate=quick, n_simulated=10, n_max=4)
    run(agent, [None])
    more = replace(agent.state, settings=(("n_simulated", 80),))
    after = restore(MIXED, more, simulate=quick)
    run(after)
    assert after.simulations.count > 20
    with pytest.raises(ProtocolError):
        after.ask()


def unrelated(theta):
    """KPIs that θ does not explain, so that a person judges by either."""
    noise = np.random.default_rng(list(theta.tobytes())).uniform(-1, 1, 3)
    return dict(zip("abc", 10.0**noise, strict=True))


def by_theta(theta):
    return float(np.sum((theta - [0.3, 0.8]) ** 2))


def studied(cost, count, seed=0):
    """The record of someone with this cost and `count` answers, its stage, and all of them."""
    grown = Growth(Simulations(unrelated), SQUARE, 60, seed)
    bank = grown.stage(History()).bank
    costs = [cost(theta) for theta in bank.thetas[: count + 1]]
    record = in_chain(bank, range(count + 1), np.sign(np.diff(costs)).astype(int).tolist())
    return record, grown.stage(record), grown


def proposed(record, stage, seed=0):
    return BeyondKPIs(Simulations(unrelated), SQUARE, seed).propose(record, stage)


def test_who_judges_by_theta_is_shown_proposals_without_kpis_after_ten_answers():
    found = [without_kpis(*studied(by_theta, 10, s)) for s in range(3)]
    assert all(found)


def test_what_is_proposed_is_a_point_of_the_cube_and_the_same_for_the_same_seed():
    record, stage, _ = studied(by_theta, 12)
    one, again = (proposed(record, stage, 4) for _ in range(2))
    assert one.shape == (2,)
    assert np.all((one >= 0) & (one <= 1))
    assert np.array_equal(one, again)


def test_every_fourth_proposal_fills_the_space():
    record, stage, _ = studied(by_theta, 11)
    point = proposed(record, stage)
    assert np.array_equal(point, stage.bank.z[stage.spread[11]])
    record, stage, _ = studied(by_theta, 12)
    assert not np.any(np.all(stage.bank.z == proposed(record, stage), axis=1))


def by_theta_alone(count):
    """An agent after so many answers of someone whose answers KPIs do not explain."""
    study = Screening(SQUARE, simulate=unrelated, n_simulated=60, n_max=60)
    while study.history.answered < count:
        query = study.ask()
        costs = [by_theta(side.theta) for side in (query.challenger, query.incumbent) if side]
        study.tell(query, int(np.sign(costs[0] - costs[-1])) if len(costs) > 1 else None)
    return study


def test_a_later_session_recalls_shapes_of_proposals_without_kpis_and_proposes_the_same(monkeypatch):
    study, learned = by_theta_alone(24), list[int]()
    again = restore(SQUARE, study.state, simulate=unrelated)
    again.recall(study.remember(study.history))
    again.history, follow = study.history.until(24), ModelSelection._follow
    monkeypatch.setattr(
        ModelSelection,
        "_follow",
        lambda models, past, *rest: (learned.append(past.answered), follow(models, past, *rest))[1],
    )
    assert again.ask() == study.ask()
    assert again.growth.explains(again.history.past) is False
    assert [count for count in learned if count <= 20] == []


def test_what_looks_like_something_shown_is_alike_in_all_kpis_and_equal_where_they_are_infinite():
    rng, base = (
        np.random.default_rng(0),
        Growth(Simulations(lambda t: {"a": 1 + t[0], "b": t[1]}), SQUARE, 90, 0),
    )
    stage = base.stage(History())
    logs, shown = rng.normal(size=(len(stage.bank), 2)), range(0, len(stage.bank), 4)
    logs[rng.random(logs.shape) < 0.3] = np.inf
    logs[1::4] = logs[::4][: len(logs[1::4])] + rng.choice([-0.0049, 0.0, 0.0051], (len(logs[1::4]), 2))
    stage = replace(stage, logs=logs)
    known = in_chain(stage.bank, shown, [1] * (len(shown) - 1))
    apart = np.array(
        [
            [max(0.0 if x == y else abs(x - y) for x, y in zip(a, logs[b], strict=True)) for b in shown]
            for a in logs
        ]
    )
    found = _look_alike(stage, known)
    assert 0 < np.count_nonzero(found) - len(shown) < len(logs[1::4])
    assert np.array_equal(found, (apart < 0.005).any(axis=1))
    nameless = replace(stage, logs=logs[:, :0], scale=replace(stage.scale, names=()))
    assert _look_alike(nameless, known).all()
    assert not _look_alike(nameless, History()).any()
