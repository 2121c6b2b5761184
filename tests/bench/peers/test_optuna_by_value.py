"""Optuna's samplers that are told values: they propose what the package would."""

import numpy as np
import pytest

from prefcal_agents.space.design import latin_hypercube
from prefcal_agents.support.global_random import seeded
from prefcal_bench.peers.optuna_agents import OptunaGP, OptunaTPE
from prefcal_env.knobs.knob import Knob
from prefcal_env.knobs.space import KnobSpace
from support.extras import need

SQUARE = KnobSpace([Knob("x", 0.0, 1.0, step=0), Knob("y", 0.0, 1.0, step=0)])


@pytest.fixture(autouse=True)
def _peers():
    need("peers")


def cost(theta):
    return float(np.sum((theta - [0.3, 0.7]) ** 2))


def run(agent):
    while not agent.done:
        query = agent.ask()
        agent.tell(query, cost(query.challenger.theta))
    return agent.samples


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(("make", "name"), [(OptunaTPE, "TPESampler"), (OptunaGP, "GPSampler")])
def test_they_propose_what_the_package_does_when_driven_by_hand(make, name):
    import optuna

    optuna.logging.set_verbosity(optuna.logging.ERROR)
    with seeded(3) as seed:
        sampler = getattr(optuna.samplers, name)(seed=seed, n_startup_trials=1)
    study = optuna.create_study(sampler=sampler)
    knobs = {f"z{k}": optuna.distributions.FloatDistribution(0.0, 1.0) for k in range(2)}
    tried = []
    for z in latin_hypercube(SQUARE, 4, 3):
        params = dict(zip(knobs, map(float, z), strict=True))
        study.add_trial(optuna.trial.create_trial(params=params, distributions=knobs, value=cost(z)))
        tried.append(z)
    for _ in range(5):
        trial = study.ask(knobs)
        z = np.array([trial.params[knob] for knob in knobs])
        study.tell(trial, cost(z))
        tried.append(z)
    found = run(make(SQUARE, n_init=4, n_max=9, seed=3))
    assert found == pytest.approx(np.array(tried), abs=1e-6)


def test_after_two_fits_that_diverge_the_next_sample_is_random(monkeypatch):
    from optuna.samplers import GPSampler

    def diverges(*_, **__):
        raise RuntimeError("not positive-definite")

    agent = OptunaGP(SQUARE, n_init=3, n_max=6, seed=0)
    monkeypatch.setattr(GPSampler, "_sample_relative_impl", diverges)
    samples = run(agent)
    expected = [np.random.default_rng([0, index]).random(2) for index in (3, 4, 5)]
    assert samples[3:] == pytest.approx(np.array(expected), abs=1e-9)
