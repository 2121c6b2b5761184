"""KPIs beside θ: they help where they explain the answers, and never break or mislead for long."""

import json

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.optimize import check_grad

from prefcal_agents import AgentState, GLISp, GLISpSettings, RandomSearch, restore
from prefcal_agents.history.lessons import Preferences, cube_of
from prefcal_agents.models.cross_validation import Validation
from prefcal_agents.models.kpi_model import Composite, KPIModel, Outcomes
from prefcal_agents.models.preference_qp import Learning
from prefcal_agents.models.rbf import Shape, Surrogate
from prefcal_env import Answer, Knob, KnobSpace
from prefcal_env.errors import SettingsError
from prefcal_env.preferences.history import History
from prefcal_env.qp import make_backend
from support.histories import in_cube
from support.studies import by, drive

SQUARE = KnobSpace([Knob("a", -2.0, 2.0), Knob("b", -1.0, 1.0)])
ALONE = GLISpSettings(outcome_scales=(0.0,))
LEAN = GLISpSettings(validate_at=(10, 20), rescale=False)
"""Half the time; what KPIs do is the same."""


def cost(theta):
    return float((theta[0] - 0.7) ** 2 + 3 * (theta[1] + 0.2) ** 2)


def terms(theta):
    return {"near": (theta[0] - 0.7) ** 2, "low": (theta[1] + 0.2) ** 2}


def study(kpis, count=11, *, n_init=6, seed=1, options=None):
    """An agent after `count` answers by `cost`, with the KPIs that `kpis` gives of θ."""
    agent = GLISp(SQUARE, n_init=n_init, n_max=count + 9, seed=seed, settings=options)
    drive(agent, by(cost), count, kpis=kpis)
    return agent


def history_of(columns):
    """A history whose samples have these KPIs: name to values."""
    names, count = list(columns), len(next(iter(columns.values())))
    rng = np.random.default_rng(0)
    history = History()
    for i in range(count):
        kpis = {name: columns[name][i] for name in names if columns[name][i] is not None}
        history = history.with_pending(in_cube(rng.random(2)))
        history = history.with_answer(
            Answer(None if i == 0 else 1, outcomes=(kpis, None)), 0 if i else None
        )
    return history


def test_shares_run_from_the_best_to_the_worst_and_one_lost_run_does_not_flatten_them():
    outcomes = Outcomes.of(history_of({"k": [1.0, 2.0, 3.0, 1e6]}))
    # Median 2.5: all above 2.5 + 2 * 1.5 = 5.5 counts as 5.5.
    assert outcomes.columns[:, 0] == pytest.approx([0, 1 / 4.5, 2 / 4.5, 1])
    assert outcomes.ranges[0] == pytest.approx((1.0, 5.5))
    assert outcomes.models[0](2 * cube_of(history_of({"k": [0.0] * 4})) - 1) == pytest.approx(
        outcomes.columns[:, 0], abs=1e-6
    )


def test_infinite_is_as_bad_as_can_be_and_a_missing_one_is_predicted():
    outcomes = Outcomes.of(history_of({"k": [1.0, 2.0, np.inf, None, 3.0], "l": [5, 4, 3, 2, 1]}))
    column = outcomes.columns[:, outcomes.names.index("k")]
    assert column[2] == 1.0
    assert 0.0 <= column[3] <= 1.0
    assert outcomes.columns[:, outcomes.names.index("l")] == pytest.approx([1, 0.75, 0.5, 0.25, 0])


def test_what_cannot_teach_is_left_out():
    columns = {"same": [3.0] * 5, "rare": [1.0, 2.0, None, None, None], "nan": [np.nan] * 5}
    assert len(Outcomes.of(history_of(columns))) == 0
    assert len(Outcomes.of(History())) == 0
    assert Outcomes.of(history_of({**columns, "good": [1.0, 2.0, 3.0, 4.0, 5.0]})).names == (
        "good",
    )


KPI = st.none() | st.floats(width=64)


@given(st.lists(st.tuples(KPI, KPI), min_size=1, max_size=8))
@example([(1e300, -1e300), (-1e300, 1e300), (0.0, 0.0), (5e-324, 1.0)])
@example([(np.inf, -np.inf), (-np.inf, np.inf), (np.inf, 0.0)])
@example([(1.7e308, 0.0), (-1.7e308, 1.0), (0.0, 2.0)])
def test_whatever_the_values_shares_are_between_0_and_1_and_models_finite(rows):
    first, second = zip(*rows, strict=True)
    history = history_of({"k": first, "l": second})
    outcomes = Outcomes.of(history)
    assert outcomes.columns.shape == (len(rows), len(outcomes))
    assert ((outcomes.columns >= 0) & (outcomes.columns <= 1)).all()
    judgment = KPIModel(outcomes, np.ones(len(outcomes)))
    z = np.random.default_rng(1).random((5, 2))
    assert np.isfinite(judgment(z)).all()
    assert np.isfinite(judgment.gradient(z[0])).all()
    for k, (name, (best, worst)) in enumerate(zip(outcomes.names, outcomes.ranges, strict=True)):
        values = np.array(
            [v if v is not None else np.nan for v in (first if name == "k" else second)]
        )
        assert best < worst
        assert (outcomes.columns[values == np.inf, k] == 1.0).all()


@settings(max_examples=6)
@given(
    st.lists(st.dictionaries(st.sampled_from("kl"), st.floats(width=64)), min_size=9, max_size=9)
)
def test_no_kpis_break_a_proposal(known):
    told = iter(known * 3)
    agent = study(lambda theta: next(told), 9)
    assert SQUARE.check(agent.ask().challenger.theta) is not None
    assert np.isfinite(agent.surrogate(agent.samples)).all()


def test_slopes_are_those_of_the_values():
    agent = RandomSearch(SQUARE, n_max=20)
    drive(agent, by(cost), 16, kpis=terms)
    history = agent.state.history.until(16)
    judgment = KPIModel(Outcomes.of(history), np.array([0.4, 2.0]))
    z = cube_of(history)
    over_theta = Surrogate(z, np.sin(np.arange(float(len(z)))), Shape(1.0, (1.0, 2.0)))
    composite = Composite(over_theta, judgment)
    slopes = [
        (composite, lambda z: composite.value_and_gradient(z)[1]),
        (composite.over_kpis, composite.over_kpis.gradient),
    ]
    for z in np.random.default_rng(3).random((6, 2)):
        assert composite.value_and_gradient(z)[0] == pytest.approx(composite(z[None])[0])
        for part, slope in slopes:
            size = max(np.abs(slope(z)).max(), 1e-9)
            wrong = check_grad(lambda x, f=part: f(x[None])[0], slope, z, epsilon=1e-6)
            assert wrong < 1e-3 * size


def proposals(agent):
    return [list(sample.z) for sample in agent.state.history.samples]


@pytest.mark.parametrize("empty", [None, lambda theta: {}, lambda theta: {"k": np.nan}])
def test_without_outcomes_it_is_glisp_bit_for_bit(empty):
    assert proposals(study(empty)) == proposals(study(None, options=ALONE))


def test_switched_off_kpis_change_nothing():
    assert proposals(study(terms, options=ALONE)) == proposals(study(None, options=ALONE))
    always = GLISpSettings(outcome_scales=(1.0,))
    assert proposals(study(terms, options=always)) != proposals(study(None, options=ALONE))


RANDOM = np.random.default_rng(5)
MISLEADING = {
    "useless": lambda theta: {f"n{i}": RANDOM.random() for i in range(6)},
    "reversed": lambda theta: {name: -value for name, value in terms(theta).items()},
    "NaN": lambda theta: {"near": np.nan, "low": np.nan if theta[0] > 0 else terms(theta)["low"]},
    "missing": lambda theta: terms(theta) if theta[0] > 0 else {},
    "huge": lambda theta: {name: 1e300 * value for name, value in terms(theta).items()},
}


@pytest.mark.parametrize("kpis", MISLEADING.values(), ids=MISLEADING)
def test_kpis_that_mislead_do_not_for_long(kpis):
    assert cost(study(kpis, 24, options=LEAN).best) < 0.02  # a corner has 25


def test_kpis_that_explain_the_answers_help_to_predict_others():
    """What is preferred goes up and down over θ too often for θ alone to tell."""
    samples = np.random.default_rng(0).random((41, 2))
    wave = np.sin(40 * samples[:, 0]) + np.cos(31 * samples[:, 1])
    first, second = np.arange(1, 41), np.arange(40)
    b = np.sign(wave[first] - wave[second]).astype(int)
    preferences = Preferences(samples, first, second, b, np.ones(40))
    backend, rng = make_backend("piqp"), np.random.default_rng(1)
    dealt = Validation.deal(preferences, Learning(margin_power=1.0), backend, rng)
    shape = Shape(1.0, (1.0, 1.0))
    assert dealt.reproduced(shape, (1.0,))[0] < 32
    assert dealt.reproduced(shape, (1.0,), 10 * wave[:, None])[0] > 36


def test_an_agent_with_outcomes_is_saved_and_restored_with_the_identical_next_query():
    never = lambda theta: {**terms(theta), "late": np.inf if theta[0] < 0 else theta[0]}  # noqa: E731
    agent = study(never)
    text = json.dumps(agent.state.to_dict(), allow_nan=False)
    twin = restore(SQUARE, AgentState.from_dict(json.loads(text)))
    assert twin.state == agent.state
    assert twin.ask() == agent.ask()
    assert agent.copy().ask() == agent.ask()


@pytest.mark.parametrize(
    "scales", [(), (-1.0,), (1.0, 0.5), (np.nan,), (np.inf,), 1.0, "0", (0.0, 0.0)]
)
def test_impossible_scales_are_refused(scales):
    with pytest.raises(SettingsError, match="outcome_scales"):
        GLISpSettings(outcome_scales=scales)
