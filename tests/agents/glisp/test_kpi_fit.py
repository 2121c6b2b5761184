"""What GLISp learns from KPIs, and whole studies that use it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from prefcal_agents import GLISp, GLISpSettings, restore
from prefcal_agents.agent import AgentState, Setup
from prefcal_agents.glisp.agent import follow_up
from prefcal_agents.glisp.fits import ModelSelection, kpi_fits, most_promising
from prefcal_agents.people import DRAWS
from prefcal_agents.search import unsafe_penalty
from prefcal_env.knobs import Knob, KnobSpace, LinearConstraint
from prefcal_env.preferences.answer import Answer, Mark
from prefcal_env.preferences.history import History, Sample
from support.histories import in_cube, studied
from support.studies import by, drive

pytestmark = pytest.mark.unchecked  # for speed: the contract suite checks the shapes

SQUARE = KnobSpace([Knob("a", -2.0, 2.0), Knob("b", -1.0, 1.0)])
ALONE = GLISpSettings(kpis=False)
LEAN = GLISpSettings(validate_at=(), error_rate=0.0)
"""Half the time; what KPIs do is the same."""


def cost(theta):
    return float((theta[0] - 0.7) ** 2 + 3 * (theta[1] + 0.2) ** 2)


def terms(theta):
    return {"near": (theta[0] - 0.7) ** 2, "low": (theta[1] + 0.2) ** 2}


# What is learned from a record.


def record_of(kpis, wanted, *, seed=0, marks=()):
    """Random samples with these KPIs and costs; those with the numbers `marks` are unsafe."""
    points = np.random.default_rng(seed).random((len(kpis), 2))
    return studied(points, wanted, kpis=kpis, unsafe=marks)


def columns(count=30, seed=3):
    """Independent KPIs `a`, `b` and `c`, spread over a decade, and the cost of who wants `b`."""
    values = 10.0 ** np.random.default_rng(seed).uniform(-1, 0, (count, 3))
    return [dict(zip("abc", row, strict=True)) for row in values], values[:, 1]


def learned(record, seed=0):
    return kpi_fits(seed)(record)


def mistaken():
    """The record of `columns` and a wrong answer, which costs the best one its lead."""
    right = record_of(*columns())
    told = Answer(-1, outcomes=({"a": 1.0, "b": 0.9, "c": 1.0}, None))
    return right.with_pending(in_cube([0.11, 0.22])).with_answer(told, right.incumbent)


def test_the_expected_rank_orders_the_samples_as_the_person_does():
    kpis, wanted = columns()
    record = record_of(kpis, wanted)
    values = learned(record).values(record)
    assert values.shape == (30,)
    assert values.min() >= 0
    assert np.corrcoef(values, np.argsort(np.argsort(wanted)))[0, 1] > 0.9


def test_nothing_is_known_before_three_experiments_with_kpis_that_differ():
    kpis, wanted = columns(12)
    for known in ([None] * 12, [{}] * 12, [{"a": 1.0}] * 12, [*kpis[:2], *[None] * 10]):
        record = record_of(known, wanted)
        assert learned(record).scale.names == ()
        assert not learned(record).teaches
    assert not learned(record_of(kpis, wanted).until(1)).teaches
    assert learned(record_of([*kpis[:3], *[None] * 9], wanted)).scale.names == ("a", "b", "c")


def test_a_missing_kpi_is_that_of_the_nearest_sample_that_has_it():
    kpis, wanted = columns(12)
    gaps = [{**k, "b": np.nan} if i in (4, 7) else k for i, k in enumerate(kpis)]
    gaps[9] = None
    record = record_of(gaps, wanted)
    bank, z = learned(record).bank, np.array([s.z for s in record.samples])
    for row, names in ((4, "b"), (7, "b"), (9, "abc")):
        for name in names:
            there = [i for i in range(12) if gaps[i] and not np.isnan(gaps[i][name])]
            nearest = min(there, key=lambda i: np.sum((z[i] - z[row]) ** 2))
            assert bank.kpis[row, bank.names.index(name)] == kpis[nearest][name]
    assert not np.isnan(bank.kpis).any()


@pytest.mark.parametrize("count", [1, 200])
def test_one_kpi_and_two_hundred_are_learned_from(count):
    rng = np.random.default_rng(2)
    values = rng.random((6, 200))
    names = [f"k{j}" for j in range(count)]
    record = record_of([dict(zip(names, row, strict=False)) for row in values], values[:, 0])
    fit = learned(record)
    assert fit.utilities.normals.shape == (DRAWS, count)
    assert np.isfinite(fit.costs(rng.random((4, 2)), rng)).all()


def test_a_theta_that_was_run_twice_counts_once_and_is_found():
    kpis, wanted = columns(12)
    points = np.random.default_rng(0).random((6, 2))
    history = studied([points[k % 6] for k in range(12)], wanted, kpis=kpis)
    fit = learned(history)
    assert len(fit.bank) == 6
    once, again = fit.values(history).reshape(2, 6)
    assert np.array_equal(once, again)
    assert np.isfinite(fit.costs(points, np.random.default_rng(1))).all()


def test_an_experiment_that_is_probably_better_than_the_best_is_named_once():
    wanted = columns()[1]
    right, wrong = record_of(*columns()), mistaken()
    assert learned(right).find_doubted(right) is None
    best, rival = learned(wrong).find_doubted(wrong)
    assert best == wrong.incumbent == 30
    assert rival != right.incumbent  # these two were compared just now
    assert wanted[rival] < 0.9
    asked = wrong.with_follow_up(Answer(-1), best, rival)
    assert learned(asked).find_doubted(asked) != (best, rival)
    assert kpi_fits(0)(History()).find_doubted(History()) is None


def test_a_run_cut_short_is_not_doubted_in_favor_of_a_whole_one():
    wrong = mistaken()
    fit = learned(wrong)
    best, rival = fit.find_doubted(wrong)
    marked = [
        replace(c, answer=replace(c.answer, marks=(Mark.CHALLENGER_CUT_SHORT,)))
        if c.challenger == rival
        else c
        for c in wrong.comparisons
    ]
    pair = fit.find_doubted(replace(wrong, comparisons=tuple(marked)))
    assert pair is not None
    assert best in pair
    assert rival not in pair


@pytest.mark.parametrize(("error_rate", "asks"), [(0.1, True), (0.0, False)])
def test_nothing_is_asked_again_if_every_answer_counts_as_right(error_rate, asks):
    wrong = mistaken()
    chosen = GLISpSettings(validate_at=(), error_rate=error_rate)
    models = ModelSelection(Setup(SQUARE, 5, 0, chosen))
    assert (follow_up(wrong, models, chosen) is not None) == asks


def test_an_unsafe_experiment_is_neither_doubted_nor_good():
    kpis, wanted = columns()
    order = np.argsort(wanted)
    marks = {int(k) for k in order[:3] if k}
    record = record_of(kpis, np.where(np.isin(range(30), list(marks)), 9.0, wanted), marks=marks)
    pair = learned(record).find_doubted(record)
    assert pair is None or not marks & set(pair)
    assert not marks & {record.incumbent}


def test_a_kpi_that_comes_late_is_learned_from_all_answers():
    kpis, wanted = columns(30)
    late = [{**k, "b": 1.0} if i < 8 else k for i, k in enumerate(kpis)]
    wanted = np.where(np.arange(30) < 8, 1.0 + 0.01 * np.arange(30), wanted)
    fits, record = kpi_fits(0), record_of(late, wanted)
    assert fits(record.until(8)).scale.names == ("a", "c")
    fit = fits(record)
    assert fit.scale.names == ("a", "b", "c")
    assert np.argmax(fit.utilities.normals.mean(axis=0)) == 1


# What is proposed.


UNIT = KnobSpace([Knob("a", 0.0, 1.0), Knob("b", 0.0, 1.0)])


def kpis_of(theta):
    """Two KPIs; the person minds the first one, whose best θ is (0.3, 0.6)."""
    return {"off": abs(theta[0] - 0.3) + abs(theta[1] - 0.6), "other": theta[0]}


def promising_record(space, count, *, unsafe=lambda theta: False):
    """Return random θ, each compared with the best one before it."""
    history, rng = History(), np.random.default_rng(1)
    while history.answered < count:
        z = space.snap(rng.random(len(space)))
        theta, best = space.decode(z), history.incumbent
        if not space.allows(theta):
            continue
        off = kpis_of(theta)["off"]
        rival = None if best is None else kpis_of(history.samples[best].theta)["off"]
        answer = None if rival is None else int(np.sign(off - rival))
        marks = (Mark.CHALLENGER_UNSAFE,) if unsafe(theta) else ()
        history = history.with_pending(Sample.of(space, z))
        told = Answer(answer, marks=marks, outcomes=(kpis_of(theta), None))
        history = history.with_answer(told, best)
    return history


def proposed(space, history, seed=0, fit=None):
    """Return the most promising θ; a `fit` of the same record need not be made again."""
    fit = kpi_fits(seed)(history) if fit is None else fit
    penalty = unsafe_penalty(history, 30.0, 0.9)
    setup = Setup(space, 4, seed, LEAN)
    z = most_promising(setup, history, fit, penalty, np.random.default_rng(seed))
    return space.decode(space.snap(z))


def test_it_comes_closer_to_what_the_person_wants():
    history = promising_record(UNIT, 15)
    best = kpis_of(history.samples[history.incumbent].theta)["off"]
    found = [kpis_of(proposed(UNIT, history, seed))["off"] for seed in range(5)]
    assert np.median(found) < 0.7 * best


def test_the_same_generator_gives_the_same_theta():
    history = promising_record(UNIT, 8)
    first, again, other = (proposed(UNIT, history, seed) for seed in (0, 0, 1))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


@pytest.mark.parametrize("count", [2, 11])
def test_no_theta_runs_twice_as_long_as_there_is_another(count):
    space = KnobSpace([Knob("a", 0, 3, integer=True), Knob("b", 0, 2, integer=True)])
    history, z = History(), [(a, b) for a in range(4) for b in range(3)]
    for theta in map(np.array, z[:count]):
        best = history.incumbent
        told = Answer(None if best is None else 1, outcomes=(kpis_of(theta), None))
        history = history.with_pending(Sample.of(space, space.encode(theta))).with_answer(told, best)
    assert tuple(proposed(space, history).astype(int)) in z[count:]


def test_constraints_hold():
    space = KnobSpace(
        [Knob("a", 0.0, 1.0), Knob("b", 0.0, 1.0)],
        constraints=[LinearConstraint("sum", {"a": 1.0, "b": 1.0}, 0.8)],
    )
    history = promising_record(space, 12)
    fit = learned(history)
    for seed in range(4):
        assert space.allows(proposed(space, history, seed, fit))


def test_places_that_are_likely_unsafe_come_last():
    history = promising_record(UNIT, 30, unsafe=lambda theta: theta[0] < 0.45)
    fit = learned(history)
    assert all(proposed(UNIT, history, seed, fit)[0] > 0.4 for seed in range(4))


# Whole studies.


def study(kpis, count=11, *, n_init=6, seed=1, options=None, **answers):
    """An agent after `count` answers by `cost`, with the KPIs that `kpis` gives of θ."""
    agent = GLISp(SQUARE, n_init=n_init, n_max=count + 9, seed=seed, settings=options)
    drive(agent, by(answers.pop("cost", cost)), count, kpis=kpis, **answers)
    return agent


def proposals(agent):
    return [list(sample.z) for sample in agent.state.history.samples]


@pytest.mark.parametrize(
    "empty", [None, lambda theta: {}, lambda theta: {"k": np.nan}, lambda theta: {"k": 3.0}]
)
def test_without_kpis_that_teach_it_is_glisp_on_theta_bit_for_bit(empty):
    assert proposals(study(empty)) == proposals(study(None, options=ALONE))


def test_switched_off_kpis_change_nothing():
    assert proposals(study(terms, options=ALONE)) == proposals(study(None, options=ALONE))
    assert proposals(study(terms)) != proposals(study(None, options=ALONE))


RANDOM = np.random.default_rng(5)
ODD = {
    "useless": lambda theta: {f"n{i}": RANDOM.random() for i in range(6)},
    "reversed": lambda theta: {name: -value for name, value in terms(theta).items()},
    "NaN": lambda theta: {"near": np.nan, "low": np.nan if theta[0] > 0 else terms(theta)["low"]},
    "missing": lambda theta: terms(theta) if theta[0] > 0 else {},
    "huge": lambda theta: {name: 1e300 * value for name, value in terms(theta).items()},
    "never": lambda theta: {**terms(theta), "late": np.inf if theta[0] < 0 else theta[0]},
    "always infinite": lambda theta: {**terms(theta), "late": np.inf},
}


@pytest.mark.parametrize("kpis", ODD.values(), ids=ODD)
def test_kpis_that_mislead_do_not_for_long(kpis):
    found = [cost(study(kpis, 24, options=LEAN, seed=seed).best) for seed in (1, 2, 3)]
    assert np.median(found) < 0.02  # a corner has 25


@settings(max_examples=6)
@given(st.lists(st.dictionaries(st.sampled_from("kl"), st.floats(width=64)), min_size=9, max_size=9))
def test_no_kpis_break_a_proposal(known):
    told = iter(known * 3)
    agent = study(lambda theta: next(told), 9)
    assert SQUARE.check(agent.ask().challenger.theta) is not None
    assert np.isfinite(agent.surrogate(agent.samples)).all()


def test_the_surrogate_is_the_expected_cost_where_kpis_explain_the_answers():
    agent = study(terms, 14)
    values = agent.surrogate(agent.samples[:14])
    assert (values.min(), values.max()) == (pytest.approx(0, abs=1e-6), pytest.approx(1))
    costs = [cost(theta) for theta in agent.samples[:14]]
    assert np.corrcoef(np.argsort(np.argsort(values)), np.argsort(np.argsort(costs)))[0, 1] > 0.7


def never(theta):
    return {**terms(theta), "late": np.inf if theta[0] < 0 else theta[0]}


def test_after_an_undo_and_a_retraction_it_proposes_what_a_fresh_agent_with_that_record_does():
    agent = study(never, 13)
    for change in (agent.undo, lambda: agent.retract(8), agent.undo):
        change()
        fresh = restore(SQUARE, AgentState.from_dict(agent.state.to_dict()))
        assert fresh.ask() == agent.ask()
    drive(agent, by(cost), 2, kpis=never)
    assert restore(SQUARE, agent.state).ask() == agent.ask()


def test_who_judges_by_what_no_kpi_measures_is_still_led_to_the_optimum():
    def unrelated(theta):
        noise = np.random.default_rng(np.abs(theta.view(np.int64))).uniform(-1, 1, 3)
        return dict(zip("abc", 10.0**noise, strict=True))

    found, left = [], 0
    for seed in range(3):
        agent = study(unrelated, 26, seed=seed, options=LEAN)
        found.append(cost(agent.best))
        left += agent._models.kpi_fit(agent.history) is None
    assert left >= 2
    # 26 random θ reach 0.2 (median of 1,000 times).
    assert np.median(found) < 0.03
