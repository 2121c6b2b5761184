"""The adapters to other people's optimizers: they propose what the packages would."""

import sys

import numpy as np
import pytest

from bench_support.extras import quick_peers  # noqa: F401
from bench_support.peers import peers
from prefcal_agents.search import latin_hypercube
from prefcal_bench.global_random import seeded
from prefcal_bench.peers.botorch_agents import BOPE, EUBO
from prefcal_bench.peers.optuna_agents import OptunaGP, OptunaPreferential, OptunaTPE
from prefcal_bench.peers.reference import ReferenceGLIS, ReferenceGLISp
from prefcal_bench.problems.functions import FUNCTIONS
from prefcal_env.errors import MissingExtraError
from prefcal_env.knobs import Knob, KnobSpace

PEERS = {**peers(), **peers(by_value=True)}

HARTMAN = FUNCTIONS["hartman3"]
SQUARE = KnobSpace([Knob("x", 0.0, 1.0, step=0), Knob("y", 0.0, 1.0, step=0)])


def tell(agent, query):
    new, best = query.challenger, query.incumbent
    if agent.by_value:
        agent.tell(query, HARTMAN(new.theta))
    else:
        agent.tell(query, None if best is None else HARTMAN.prefer(new.theta, best.theta))


def run(agent):
    while not agent.done:
        tell(agent, agent.ask())
    return agent.samples


@pytest.mark.usefixtures("quick_peers")
def test_the_reference_glisp_proposes_what_the_package_does_when_driven_by_hand():
    from glis.solvers import GLISp

    solver = GLISp((np.zeros(3), np.ones(3)), n_initial_random=5, display=0, expected_max_evals=16)
    with seeded(2, 0):
        best, x = solver.initialize()
    tried = [best]
    for index in range(2, 17):
        tried.append(x)
        with seeded(2, index):
            x = solver.update(HARTMAN.prefer(x, solver.xbest))
    inside = np.clip(tried, 0, 1)
    agent = ReferenceGLISp(HARTMAN.space, n_init=5, n_max=16, seed=2)
    assert run(agent) == pytest.approx(inside, abs=1e-9)
    assert len({round(theta, 6) for theta in agent._thetas.values()}) > 1  # it was calibrated


@pytest.mark.usefixtures("quick_peers")
def test_the_reference_glis_proposes_what_the_package_does_when_driven_by_hand():
    from glis.solvers import GLIS

    solver = GLIS((np.zeros(3), np.ones(3)), n_initial_random=5, display=0)
    with seeded(2, 0):
        x = solver.initialize()
    tried = []
    for index in range(1, 17):
        tried.append(x)
        with seeded(2, index):
            x = solver.update(np.float64(HARTMAN(x)))
    agent = ReferenceGLIS(HARTMAN.space, n_init=5, n_max=16, seed=2)
    assert run(agent) == pytest.approx(np.clip(tried, 0, 1), abs=1e-9)


@pytest.mark.usefixtures("quick_peers")
@pytest.mark.parametrize("make", PEERS.values(), ids=PEERS)
def test_two_agents_and_the_caller_do_not_disturb_each_other(make):
    import torch

    before = torch.get_rng_state()
    alone = [run(make(HARTMAN.space, n_init=4, n_max=8, seed=s)) for s in (0, 1)]
    with seeded(9):
        undisturbed = np.random.rand(8)  # noqa: NPY002
    agents = [make(HARTMAN.space, n_init=4, n_max=8, seed=s) for s in (0, 1)]
    own = []
    with seeded(9):
        for _ in range(8):
            for agent in agents:
                tell(agent, agent.ask())
            own.append(np.random.rand())  # noqa: NPY002
    for agent, samples in zip(agents, alone, strict=True):
        assert np.array_equal(agent.samples, samples)
    assert np.array_equal(own, undisturbed)
    assert torch.equal(torch.get_rng_state(), before)


@pytest.mark.usefixtures("quick_peers")
def test_optuna_goes_on_after_a_fit_that_diverged(monkeypatch):
    import optuna_dashboard.preferential.samplers.gp as gp

    fits = []

    def fit(*_):
        fits.append(len(fits))
        if fits[-1] in (1, 3, 4):  # the fourth and fifth are of one proposal: that is random
            raise RuntimeError("not positive-definite")

    monkeypatch.setattr(gp._PreferentialGP, "fit_params_EP", fit)
    agent = OptunaPreferential(HARTMAN.space, n_init=4, n_max=9, seed=0)
    run(agent)
    assert len(fits) == 5 + 2
    fits.clear()
    twin = OptunaPreferential(HARTMAN.space, n_init=4, n_max=9, seed=0)
    assert np.array_equal(run(twin), agent.samples)


@pytest.mark.parametrize(
    ("make", "module"),
    [
        (ReferenceGLISp, "glis.solvers"),
        (ReferenceGLIS, "glis.solvers"),
        (OptunaPreferential, "optuna_dashboard.preferential.samplers.gp"),
        (OptunaTPE, "optuna"),
        (OptunaGP, "torch"),
        (EUBO, "botorch.models.pairwise_gp"),
        (BOPE, "botorch.models.pairwise_gp"),
    ],
)
def test_without_the_extra_the_word_is_clear(make, module, monkeypatch):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(MissingExtraError, match=r"pip install 'prefcal-bench\[peers\]'"):
        make(HARTMAN.space)


# Optuna's samplers that are told values.


def cost(theta):
    return float(np.sum((theta - [0.3, 0.7]) ** 2))


def run_by(agent):
    while not agent.done:
        query = agent.ask()
        agent.tell(query, cost(query.challenger.theta))
    return agent.samples


@pytest.mark.usefixtures("quick_peers")
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
    found = run_by(make(SQUARE, n_init=4, n_max=9, seed=3))
    assert found == pytest.approx(np.array(tried), abs=1e-6)


@pytest.mark.usefixtures("quick_peers")
def test_after_two_fits_that_diverge_the_next_sample_is_random(monkeypatch):
    from optuna.samplers import GPSampler

    def diverges(*_, **__):
        raise RuntimeError("not positive-definite")

    agent = OptunaGP(SQUARE, n_init=3, n_max=6, seed=0)
    monkeypatch.setattr(GPSampler, "_sample_relative_impl", diverges)
    samples = run_by(agent)
    expected = [np.random.default_rng([0, index]).random(2) for index in (3, 4, 5)]
    assert samples[3:] == pytest.approx(np.array(expected), abs=1e-9)
