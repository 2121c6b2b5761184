"""The next sample of an agent that uses BoTorch."""

import numpy as np
import pytest

from prefcal_bench.peers.botorch_agent import BoTorchAgent, attempted
from prefcal_env.knobs.knob import Knob
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.answer import Answer
from prefcal_env.preferences.history import Comparison, History
from support.extras import need
from support.histories import in_cube

SQUARE = KnobSpace([Knob("x", 0.0, 1.0, step=0), Knob("y", 0.0, 1.0, step=0)])
HISTORY = History((in_cube([1.0, 0.0]),), (Comparison(0, None, Answer(None)),))
RANDOM = np.random.default_rng([3, 1]).random(2)


@pytest.fixture(autouse=True)
def _peers():
    need("peers")


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
