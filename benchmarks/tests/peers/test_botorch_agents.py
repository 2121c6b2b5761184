"""EUBO and BOPE: what they ask, what they do when a fit fails, and that torch is left alone."""

import numpy as np
import pytest

from bench_support.extras import need
from prefcal_bench import BOPE, EUBO
from prefcal_bench.peers.botorch_agents import BoTorchAgent, attempted
from prefcal_bench.peers.peer import torch_seeded
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.preferences.answer import Answer
from prefcal_env.preferences.history import Comparison, History
from support.histories import in_cube
from support.studies import by, drive

SQUARE = KnobSpace([Knob("x", 0.0, 1.0, step=0), Knob("y", 0.0, 1.0, step=0)])
HISTORY = History((in_cube([1.0, 0.0]),), (Comparison(0, None, Answer(None)),))
RANDOM = np.random.default_rng([3, 1]).random(2)


@pytest.fixture(autouse=True)
def _peers():
    need("peers")


def cost(theta):
    return float(np.sum((theta - [0.3, 0.7]) ** 2))


def kpis(theta):
    """Two KPIs; a run with a large x is interrupted."""
    late = np.inf if theta[0] > 0.8 else float(abs(theta[0] - 0.3))
    return {"late": late, "far": float(abs(theta[1] - 0.7))}


def run(agent, outcomes=None):
    return drive(agent, by(cost), kpis=outcomes)


def random_ones(seed, indices):
    return np.array([np.random.default_rng([seed, index]).random(2) for index in indices])


@pytest.mark.parametrize(("make", "outcomes"), [(EUBO, None), (BOPE, kpis)])
def test_they_find_the_minimum_of_a_bowl(make, outcomes):
    agent = make(SQUARE, n_init=5, n_max=16, seed=1)
    run(agent, outcomes)
    assert cost(agent.best) < 0.3 * min(map(cost, agent.samples[:5]))
    at_random = np.isclose(agent.samples[5:], random_ones(1, range(5, 16))).all(axis=1)
    assert np.count_nonzero(at_random) <= 1  # if all maxima of the acquisition ran already


def test_bope_asks_one_follow_up_an_experiment_after_the_start_about_runs_not_compared():
    agent = BOPE(SQUARE, n_init=4, n_max=9, seed=0)
    queries = run(agent, kpis)
    further = [query.further for query in queries]
    assert further == [False] * 4 + [True, False] * 5
    asked = [frozenset((q.challenger.index, q.incumbent.index)) for q in queries[1:]]
    assert len(set(asked)) == len(asked) == 2 * 9 - 4 - 1


def test_bope_without_kpis_is_eubo():
    both = [make(SQUARE, n_init=4, n_max=8, seed=2) for make in (EUBO, BOPE)]
    assert not any(query.further for agent in both for query in run(agent))
    assert np.array_equal(both[0].samples, both[1].samples)


def test_the_same_state_asks_the_same_follow_up_question():
    agent = BOPE(SQUARE, n_init=3, n_max=6, seed=0)
    queries = run(agent, kpis)
    agent.undo()
    agent.undo()
    assert agent.ask() == queries[-2]
    assert agent.ask().further
    assert BOPE.restore(SQUARE, agent.state).ask() == queries[-2]


@pytest.mark.parametrize(("make", "outcomes"), [(EUBO, None), (BOPE, None), (BOPE, kpis)])
def test_after_a_fit_that_fails_the_next_sample_is_random(make, outcomes, monkeypatch):
    import botorch.fit
    from botorch.exceptions.errors import ModelFittingError

    def fails(*_, **__):
        raise ModelFittingError("all attempts failed")

    monkeypatch.setattr(botorch.fit, "fit_gpytorch_mll", fails)
    agent = make(SQUARE, n_init=3, n_max=6, seed=4)
    run(agent, outcomes)
    assert agent.samples[3:] == pytest.approx(random_ones(4, (3, 4, 5)), abs=1e-9)


@pytest.mark.parametrize("make", [EUBO, BOPE])
def test_while_all_are_about_the_same_the_next_sample_is_random(make):
    agent = make(SQUARE, n_init=2, n_max=4, seed=0)
    while not agent.done:
        query = agent.ask()
        agent.tell(query, Answer(0, outcomes=(kpis(query.challenger.theta), None)))
    assert agent.samples[2:] == pytest.approx(random_ones(0, (2, 3)), abs=1e-9)


@pytest.mark.parametrize(
    ("points", "expected"),
    [([[1.0, 0.0], [0.5, 1.0 + 1e-12], [0.2, 0.2]], [0.5, 1.0]), ([[1.0, 0.0]], RANDOM), (None, RANDOM)],
)
def test_the_first_candidate_that_did_not_run_else_a_random_one(points, expected):
    class Proposing(BoTorchAgent):
        def _candidates(self, history, seed):
            return None if points is None else np.array(points)

    z = Proposing(SQUARE, n_init=1, seed=3).propose(HISTORY)
    assert z == pytest.approx(np.array(expected))


def test_a_failed_fit_gives_none_but_a_mistake_in_the_code_does_not_hide():
    from botorch.exceptions.errors import ModelFittingError
    from linear_operator.utils.errors import NotPSDError

    def fails(error):
        raise error

    for error in (ModelFittingError("all"), NotPSDError("no"), ValueError("nan")):
        assert attempted(lambda error=error: fails(error)) is None
    assert attempted(lambda: 3) == 3
    with pytest.raises(TypeError):
        attempted(lambda: fails(TypeError("code")))


def test_draws_follow_from_the_key_and_leave_the_callers_alone():
    import torch

    before, draws = torch.get_rng_state(), []
    for key in ((1, 2), (1, 2), (1, 3)):
        with torch_seeded(*key):
            draws.append(float(torch.rand(1)))
    assert draws[0] == draws[1] != draws[2]
    assert torch.equal(torch.get_rng_state(), before)
