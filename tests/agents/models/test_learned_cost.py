"""The index that nobody could write down: found, tested on other answers, and as Python."""

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefcal_agents import GLISp, RandomSearch
from prefcal_agents.learned_cost import CostTerm, LearnedCost
from prefcal_env import Knob, KnobSpace
from prefcal_env.preferences.history import History
from support.studies import by, drive

SQUARE = KnobSpace([Knob("a", 0.0, 1.0), Knob("b", 0.0, 1.0)])
NUMBER = st.floats(width=64)


def kpis(theta):
    """Six KPIs; the person minds `slow` and `rough`, in this proportion."""
    a, b = theta
    return {
        "slow": (a - 0.3) ** 2,
        "rough": (b - 0.8) ** 2,
        "late": a * b,
        "hot": np.sin(9 * a),
        "wide": (1 - a) * b,
        "loud": np.cos(7 * b),
    }


def cost(theta):
    known = kpis(theta)
    return 2 * known["slow"] + known["rough"]


def study(agent, prefer, count):
    drive(agent, prefer, count, kpis=kpis)
    return agent


honest = by(cost)


def index_of(agent, seed=0):
    return LearnedCost.of(agent.state.history, seed)


@pytest.mark.parametrize("seed", range(4))
def test_the_two_that_a_person_minds_come_first_after_30_answers(seed):
    index = index_of(study(RandomSearch(SQUARE, n_max=40, seed=seed), honest, 31))
    assert set(list(index.weights)[:2]) == {"slow", "rough"}
    assert sum(list(index.weights.values())[:2]) > 0.6
    assert sum(index.weights.values()) == pytest.approx(1.0)
    assert list(index.weights.values()) == sorted(index.weights.values(), reverse=True)


def test_answers_that_follow_kpis_are_predicted_and_coin_tosses_are_not():
    follows = index_of(study(RandomSearch(SQUARE, n_max=60, seed=2), honest, 50))
    rng = np.random.default_rng(4)
    tossed = index_of(study(RandomSearch(SQUARE, n_max=60), lambda *_: rng.choice([-1, 1]), 50))
    assert follows.predicted > 0.8 * follows.answers
    assert follows.explains
    assert not tossed.explains


@pytest.mark.parametrize(
    ("right", "of", "explains"),
    [(31, 44, True), (24, 44, False), (3, 3, True), (2, 2, False), (0, 0, False), (2, 3, False)],
)
def test_hardly_more_than_half_does_not_explain(right, of, explains):
    assert LearnedCost({}, right, of).explains == explains


def test_without_kpis_or_strict_answers_there_is_none():
    assert LearnedCost.of(History(), 0) is None
    assert index_of(GLISp(SQUARE)) is None
    assert index_of(study(RandomSearch(SQUARE, n_max=12), lambda *_: 0, 9)) is None
    assert index_of(study(RandomSearch(SQUARE, n_max=12), lambda *_: None, 9)) is None
    bare = GLISp(SQUARE, n_init=3, n_max=12)
    for _ in range(6):
        bare.tell(bare.ask(), -1)
    assert bare.index is None


def test_it_ranks_experiments_as_the_person_does():
    index = index_of(study(RandomSearch(SQUARE, n_max=40, seed=1), honest, 31))
    thetas = np.random.default_rng(8).random((60, 2))
    ranked = [index(kpis(theta)) for theta in thetas]
    true = [cost(theta) for theta in thetas]
    assert np.corrcoef(np.argsort(np.argsort(ranked)), np.argsort(np.argsort(true)))[0, 1] > 0.8


KPI = st.dictionaries(st.sampled_from(["k", "l", "'\"\\\n{x}"]), NUMBER)
LIMITS = st.tuples(NUMBER, NUMBER).filter(lambda p: p[0] < p[1] and np.isfinite(p[0]))


@given(st.dictionaries(st.sampled_from(["k", "l", "'\"\\\n{x}"]), LIMITS), st.lists(KPI, max_size=5))
def test_the_module_computes_the_same_for_any_kpis(limits, mappings):
    index = LearnedCost({name: CostTerm(0.3, *pair) for name, pair in limits.items()}, 3, 4)
    namespace = {}
    exec(index.to_python(), namespace)
    for mapping in mappings:
        value = namespace["index"](mapping)
        assert value == index(mapping)
        assert np.isfinite(value)
        assert abs(value) <= 0.3 * len(limits) + 1e-12


def test_by_hand_and_what_is_unknown_or_never_counts_in_full():
    index = LearnedCost({"k": CostTerm(0.75, 10.0, 20.0), "l": CostTerm(0.25, 0.0, np.inf)}, 3, 4)
    assert index({"k": 12.0, "l": 5.0}) == pytest.approx(0.15)
    assert index({"k": 8.0, "l": 5.0}) == pytest.approx(-0.15)
    assert index({"k": -np.inf, "l": -np.inf}) == -1.0
    for worst in ({}, {"k": 21.0, "l": np.inf}, {"k": np.nan, "l": np.nan}, {"k": 1e300}):
        assert index(worst) == 1.0


def test_the_module_needs_nothing_but_python(tmp_path):
    index = study(GLISp(SQUARE, n_init=10, n_max=20), honest, 12).index
    (tmp_path / "mine.py").write_text(index.to_python(), encoding="utf-8")
    known = kpis([0.4, 0.1])
    plain = {name: float(value) for name, value in known.items()}
    code = "import sys, mine; assert not {'numpy', 'prefcal_env'} & set(sys.modules); "
    code += f"print(repr(mine.index({plain})))"
    done = subprocess.run(
        [sys.executable, "-S", "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True, env={}
    )
    assert float(done.stdout) == pytest.approx(index(known), rel=1e-12)
