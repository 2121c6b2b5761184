import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.stats import norm

from prefcal_agents import GLISp
from prefcal_agents.acquisition.expected_improvement import ExpectedImprovement, _log_gain
from prefcal_agents.models.gaussian_process import GaussianProcess
from prefcal_env.knobs.knob import Knob
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.answer import Answer

RNG = np.random.default_rng(0)
SAMPLES = RNG.random((15, 2))
BOWL = np.sum((SAMPLES - 0.5) ** 2, axis=1)
OBJECTIVE = ExpectedImprovement(GaussianProcess.through(SAMPLES, (BOWL - BOWL.min())[None]))
WAVES = np.sin(9 * SAMPLES[:, 0]) + np.cos(7 * SAMPLES[:, 1])
BOTH = np.array([WAVES - WAVES.min(), BOWL - BOWL.min(), 3 * (WAVES.max() - WAVES)])
WAVY = ExpectedImprovement(GaussianProcess.through(SAMPLES, BOTH))
coordinate = st.floats(0, 1)


@pytest.mark.parametrize("u", [-30.0, -4.0, -1.01, -0.99, 0.0, 2.0])
def test_the_gain_is_the_integral_that_it_stands_for(u):
    # The mean of max(u + x, 0) for a normal x, with y = u + x and exp(-u²/2) taken out.
    integral = quad(lambda y: y * np.exp(-0.5 * y**2 + u * y), 0, 30)[0]
    expected = np.log(integral) - 0.5 * u**2 - 0.5 * np.log(2 * np.pi)
    assert _log_gain(np.array([u]))[0][0] == pytest.approx(expected, rel=1e-6)


@given(st.floats(-1e6, 100))
def test_the_gain_grows_and_its_slope_is_right(u):
    step = 1e-4 * max(1.0, abs(u))
    (below, at, above), slope = _log_gain(np.array([u - step, u, u + step]))
    assert below < at < above
    assert slope[1] == pytest.approx((above - below) / (2 * step), rel=1e-3, abs=1e-9)


@given(st.tuples(coordinate, coordinate))
def test_its_gradient_agrees_with_differences(point):
    point, steps = np.array(point), 1e-7 * np.eye(2)
    if np.min(np.linalg.norm(SAMPLES - point, axis=1)) < 0.01:
        return  # EI goes to 0 there within the noise
    differences = (WAVY(point + steps) - WAVY(point - steps)) / 2e-7
    value, slope = WAVY.value_and_gradient(point)
    assert value == pytest.approx(WAVY(point[None])[0])
    assert slope == pytest.approx(differences, rel=1e-3, abs=1e-3)


def test_by_hand():
    process = GaussianProcess.through(SAMPLES, BOTH)
    z = np.array([[0.41, 0.5], [0.9, 0.1]])
    mean, deviation = process(z)
    u = -mean / deviation
    gain = deviation * (norm.pdf(u) + u * norm.cdf(u))
    expected = -np.log(gain.mean(axis=1))  # over three functions that are equally likely
    assert ExpectedImprovement(process)(z) == pytest.approx(expected)


def test_units_of_the_costs_do_not_matter_and_one_that_is_flat_breaks_nothing():
    one, many = (ExpectedImprovement.of(SAMPLES, x) for x in (BOWL[None], 7 * BOWL[None] + 3))
    z = RNG.random((9, 2))
    # Processors round differently, and a badly conditioned matrix makes more of it.
    assert one(z) == pytest.approx(many(z), rel=1e-5)
    flat = ExpectedImprovement.of(SAMPLES, np.array([BOWL, np.ones(15)]))
    assert np.all(np.isfinite(flat(z)))
    assert np.all(np.isfinite(flat.value_and_gradient(z[0])[1]))


def test_what_is_known_gains_less_than_what_is_not():
    assert OBJECTIVE(SAMPLES).min() > OBJECTIVE(np.array([[0.5, 0.5]]))[0] + 3


SPACE = KnobSpace([Knob("a", 0, 1), Knob("b", 0, 1)])


def kpis(theta):
    return {"off": abs(theta[0] - 0.3), "spent": abs(theta[1] - 0.8)}


def cost(theta):
    return kpis(theta)["off"] ** 2 + 1e-3 * kpis(theta)["spent"] ** 2


def gap(seed):
    agent = GLISp(SPACE, n_init=5, n_max=20, seed=seed)
    while not agent.done:
        query = agent.ask()
        new, old = query.challenger.theta, query.incumbent
        verdict = None if old is None else int(np.sign(cost(new) - cost(old.theta)))
        pair = (kpis(new), None if old is None else kpis(old.theta))
        agent.tell(query, Answer(verdict, outcomes=pair))
    return cost(agent.best)


def test_studies_with_kpis_come_to_the_optimum_with_it():
    # 20 random samples come to 5e-4 (median of 1000 times).
    assert np.median([gap(seed) for seed in range(6)]) < 1e-4


def test_a_delta_asks_for_the_acquisition_that_has_one():
    assert not GLISp(SPACE, delta=0.5).settings.kpis
    assert not GLISp.paper(SPACE).settings.kpis
