"""What was measured corrects what is simulated, and replaces a simulation that misleads."""

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from prefcal_agents import Screening, minimize_by_preference, restore
from prefcal_agents.people import Measured, draw_on_plant
from prefcal_agents.screening.findings import findings
from prefcal_env.errors import SettingsError, SimulationError
from prefcal_env.preferences.answer import Answer, Mark, Reading
from prefcal_env.preferences.history import History
from support.simulated import SQUARE, bank_of, in_chain
from support.studies import by, drive

EXACT = Reading()
POINTS = np.random.default_rng(2).random((120, 2))
ROWS = np.arange(0, 120, 15)
TREND = np.log(0.1 + POINTS[:, :1] ** 2)


def plausible(simulated, real, rows=ROWS, draws=200):
    return draw_on_plant(POINTS, simulated, rows, real[rows], draws, np.random.default_rng(0))


def error(simulated, real):
    """The median error of the expected value where nothing was measured."""
    expected = np.median(plausible(simulated, real), axis=0)
    others = np.setdiff1d(np.arange(len(POINTS)), ROWS)
    return float(np.median(np.abs(expected - real)[others]))


def test_what_was_measured_is_known():
    found = plausible(TREND, TREND + 0.3)
    assert np.array_equal(found[:, ROWS], np.broadcast_to(TREND[ROWS] + 0.3, (200, len(ROWS), 1)))


def test_a_plant_that_differs_smoothly_is_predicted():
    real = TREND + 0.5 - 0.4 * POINTS[:, 1:]
    assert error(TREND, real) < 0.03
    assert float(np.median(np.abs(TREND - real))) > 0.25


def test_with_one_measurement_the_twin_is_trusted_but_not_surely():
    found = plausible(TREND, TREND, rows=np.array([0]))
    assert np.median(np.abs(np.median(found, axis=0) - TREND)) < 0.2
    assert np.median(np.minimum(found, 5.0).std(axis=0)) > 0.1


def test_of_a_kpi_with_the_wrong_sign_the_twin_is_left_out():
    real = 2 * TREND.mean() - TREND
    assert error(TREND, real) < 0.5 * float(np.median(np.abs(TREND - real)))


def test_each_kpi_is_trusted_for_itself():
    wrong = 2 * TREND.mean() - TREND
    simulated, real = np.hstack([TREND, TREND]), np.hstack([TREND, wrong])
    spread = np.minimum(plausible(simulated, real), 5.0).std(axis=0)
    assert np.median(spread[:, 1]) > 3 * np.median(spread[:, 0])


def test_infinite_kpis_are_worse_than_all_others():
    real = np.where(POINTS[:, :1] > 0.5, np.inf, TREND)
    expected = np.median(plausible(real, real), axis=0)
    assert np.array_equal(np.isinf(expected), np.isinf(real))
    assert not np.isnan(plausible(TREND, real)).any()
    assert not np.isnan(plausible(np.full_like(TREND, np.inf), real)).any()


def test_without_a_simulation_kpis_follow_from_those_measured():
    rows = np.arange(0, 120, 3)
    found = plausible(None, TREND, rows=rows)
    others = np.setdiff1d(np.arange(len(POINTS)), rows)
    missed = np.abs(np.median(found, axis=0) - TREND)[others]
    assert np.median(missed) < 0.1 * TREND.std()
    assert np.array_equal(found[:, rows], np.broadcast_to(TREND[rows], (200, len(rows), 1)))
    assert found[:, others].std(axis=0).min() > 0


@pytest.mark.parametrize("real", [np.full((120, 1), np.inf), np.zeros((120, 1))])
def test_without_a_simulation_kpis_may_be_infinite_or_all_the_same(real):
    found = plausible(None, real)
    assert not np.isnan(found).any()
    assert np.array_equal(found[0, ROWS], real[ROWS])


@pytest.mark.parametrize(
    ("told", "marks"),
    [
        (({"a": 3.0, "b": 4.0}, {"a": 1.0, "b": 2.0}), ()),  # as simulated
        (({"a": 9.0}, None), (Mark.CHALLENGER_CUT_SHORT,)),  # bounds
        (({"speed": 9.0}, None), ()),  # other KPIs
    ],
)
def test_kpis_as_simulated_bounds_and_other_kpis_are_not_taken_for_measured_ones(told, marks):
    bank = bank_of([[1.0, 2.0], [3.0, 4.0]])
    record = in_chain(bank, [0, 1], [Answer(1, outcomes=told, marks=marks)])
    assert not len(Measured.of(bank, record, EXACT))
    assert not len(Measured.of(bank, History(), EXACT))


def test_a_kpi_that_was_not_measured_keeps_its_simulated_value():
    bank = bank_of([[1.0, 2.0], [3.0, 4.0]])
    record = in_chain(bank, [0, 1], [Answer(1, outcomes=({"a": 9.0, "other": 1.0}, None))])
    measured = Measured.of(bank, record, EXACT)
    assert measured.on(bank).kpis.tolist() == [[1.0, 2.0], [9.0, 4.0]]
    assert bank.kpis.tolist() == [[1.0, 2.0], [3.0, 4.0]]


def test_a_twin_with_other_names_is_refused_with_both():
    def prefer(a, b):
        return Answer(1, outcomes=({"speed": 9.0}, None))

    with pytest.raises(SimulationError, match="got rough, slow simulated and speed measured"):
        minimize_by_preference(prefer, SQUARE, twin=plant, n_simulated=30, n_max=4)


def plant(theta):
    x, y = theta
    return {"slow": 0.05 + (x - 0.7) ** 2, "rough": 0.05 + (y - 0.2) ** 2}


def biased(theta):
    """A twin whose optimum is elsewhere."""
    return plant(np.clip(theta - np.array([0.15, -0.1]), 0.0, 1.0))


def mirrored(theta):
    """A twin with the wrong sign of a KPI: what is slow seems to be quick."""
    found = plant(theta)
    return found | {"slow": 0.05 * 0.54 / found["slow"]}


def cost(theta):
    return sum(plant(theta).values())


def told(a, b):
    """Compare on the plant, and tell what was measured there."""
    return Answer(-1 if cost(a) < cost(b) else 1, outcomes=(plant(a), plant(b)))


def gap(twin, prefer, seed):
    found = minimize_by_preference(prefer, SQUARE, twin=twin, n_simulated=300, n_max=12, seed=seed)
    return cost(found.best) - 0.1


def silent(a, b):
    return told(a, b).preference


@pytest.mark.parametrize("twin", [biased, mirrored], ids=["biased", "mirrored"])
def test_measured_kpis_lead_away_from_what_the_twin_has_wrong(twin):
    seeds = range(5)
    corrected_gap = np.median([gap(twin, told, seed) for seed in seeds])
    believed_gap = np.median([gap(twin, silent, seed) for seed in seeds])
    assert corrected_gap < 0.5 * believed_gap


def test_what_the_twin_refuses_is_not_run_even_where_it_is_not_trusted():
    def refusing(theta):
        return dict.fromkeys(plant(theta), np.inf) if theta[0] > 0.5 else mirrored(theta)

    for seed in range(3):
        found = minimize_by_preference(told, SQUARE, twin=refusing, n_simulated=100, n_max=14, seed=seed)
        assert found.samples[:, 0].max() <= 0.5


def test_a_restored_study_asks_the_same_next_question():
    agent = Screening(SQUARE, simulate=biased, n_simulated=100, n_max=8, seed=1)
    drive(agent, by(cost), 5, kpis=plant)
    again = restore(SQUARE, agent.state, simulate=biased)
    assert again.ask() == agent.ask()
    assert np.array_equal(again.bank.kpis, agent.bank.kpis)


def study(twin, n_max=9):
    """An agent whose study was answered to the end, with what was measured."""
    agent = Screening(SQUARE, simulate=twin, n_simulated=150, n_max=n_max, seed=0)
    drive(agent, by(cost), kpis=plant)
    return agent


def test_where_kpis_differ_every_fourth_theta_is_one_of_those_that_fill_the_space():
    agent = study(biased)
    stage = agent.stage(agent.history)
    filling = {theta.tobytes() for theta in stage.bank.thetas[stage.spread]}
    shown = [theta.tobytes() in filling for theta in agent.samples]
    assert [shown[4], shown[8]] == [True, True]
    assert not all(shown)  # the others are near the leaders


@settings(max_examples=25)
@given(
    st.lists(st.sampled_from([0.0, 1.0, np.nan, np.inf, -np.inf, 1e308, -1e308]), min_size=10, max_size=10)
)
def test_any_measured_kpis_leave_a_study(values):
    agent = Screening(SQUARE, simulate=plant, n_simulated=30, n_max=5)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for slow, rough in zip(values[::2], values[1::2], strict=True):
            outcome = {"slow": slow, "rough": rough}
            agent.tell(agent.ask(), Answer(-1, outcomes=(outcome, None)))
            assert not np.isnan(agent.bank.kpis).any()
            chance = findings(agent).chance_of_better
            assert chance is None or 0 <= chance <= 1
        while not agent.done:  # a question was about two known ones
            agent.tell(agent.ask(), -1)
    assert len({theta.tobytes() for theta in agent.samples}) == 5


def test_a_study_has_either_a_simulation_or_a_twin():
    with pytest.raises(SettingsError, match="either simulate or twin"):
        minimize_by_preference(told, SQUARE, simulate=plant, twin=biased)
