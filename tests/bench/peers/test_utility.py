"""The utility learned from comparisons, and the comparisons that help most."""

import numpy as np
import pytest

from prefcal_bench.peers.peer import torch_seeded
from prefcal_bench.peers.utility import Utility, strict_pairs
from prefcal_env.preferences.answer import Answer
from prefcal_env.preferences.history import Comparison, History
from support.extras import need
from support.histories import in_cube

POINTS = np.linspace(0.0, 1.0, 6)[:, None]
PAIRS = np.array([[3, k] for k in (0, 1, 5)] + [[4, 1], [2, 0], [4, 5]])
"""The best is near 0.65."""


@pytest.fixture
def utility():
    need("peers")
    with torch_seeded(0):
        yield Utility.of(POINTS, PAIRS)


def test_only_strict_answers_count_and_the_winner_comes_first():
    answers = [None, Answer(-1), Answer(1), Answer(0), Answer(None), Answer(1)]
    samples = tuple(in_cube([k / 10]) for k in range(6))
    comparisons = tuple(
        Comparison(k, 0 if k else None, answer or Answer(None), retracted=k == 5)
        for k, answer in enumerate(answers)
    )
    assert strict_pairs(History(samples, comparisons)).tolist() == [[1, 0], [0, 2]]


def test_what_won_is_worth_more(utility):
    means = utility.means()
    assert means[3] > means[1] > means[0] - 0.5
    assert means[[3, 4]].min() > means[[0, 1, 5]].max()


def test_the_challenger_is_not_where_experiments_lost(utility):
    assert 0.4 < utility.challengers(3)[0, 0] < 0.9


def test_the_best_pair_is_that_of_the_package(utility):
    import torch
    from botorch.acquisition.preference import AnalyticExpectedUtilityOfBestOption

    first, second = np.triu_indices(6, 1)
    pairs = torch.tensor(np.stack([POINTS[first], POINTS[second]], axis=1))
    with torch.no_grad():
        k = int(AnalyticExpectedUtilityOfBestOption(utility.model)(pairs).argmax())
    assert utility.best_pair(np.ones((6, 6), dtype=bool)) == (first[k], second[k])
    allowed = np.ones((6, 6), dtype=bool)
    allowed[first[k], second[k]] = False
    assert utility.best_pair(allowed) not in (None, (first[k], second[k]))
    assert utility.best_pair(np.zeros((6, 6), dtype=bool)) is None
