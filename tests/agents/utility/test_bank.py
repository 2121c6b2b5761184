"""The bank of simulated θ."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contracts.proposals import HALF, MIXED, RARE, RING, SMALL, STAIRS, TINY
from prefcal_agents.people import Bank
from prefcal_agents.search import latin_hypercube
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.preferences.answer import Outcome
from prefcal_env.preferences.history import KPIValues

THETAS = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]])
SPACES = {
    "mixed": MIXED,
    "small": SMALL,
    "tiny": TINY,
    "half": HALF,
    "ring": RING,
    "rare": RARE,
    "stairs": STAIRS,
    "frozen": MIXED.narrowed({"weight": (0.31, 0.31), "gain": (1 / 3, 2 / 3)}),
    "one": KnobSpace([Knob("gain", 1e-6, 1e6, scale="log10")]),
}


def bank_of(*outcomes):
    return Bank.of(THETAS / 10, THETAS, KPIValues.of([Outcome(o) for o in outcomes]))


def test_a_theta_is_found_by_its_value_and_only_if_it_was_simulated():
    bank = bank_of({"a": 1.0}, {"a": 2.0}, {"a": 3.0})
    assert [bank.find(theta) for theta in THETAS] == [0, 1, 2]
    with pytest.raises(KeyError):
        bank.find([1.0, 4.0])


def test_a_theta_is_kept_once_in_the_order_simulated():
    thetas = np.array([[5.0, 6.0], [1.0, -0.0], [5.0, 6.0], [1.0, 0.0], [0.0, 9.0]])
    bank = Bank.of(thetas / 10, thetas, KPIValues(("a",), np.arange(5.0)[:, None]))
    assert bank.thetas.tolist() == [[5.0, 6.0], [1.0, 0.0], [0.0, 9.0]]
    assert bank.kpis[:, 0].tolist() == [0, 1, 4]
    assert np.array_equal(bank.z, bank.thetas / 10)


@pytest.mark.parametrize("name", SPACES)
def test_what_is_simulated_could_be_shown_to_the_last_bit(name):
    space = SPACES[name]
    design = latin_hypercube(space, 60, seed=3)
    z, thetas = space.proposals(design)
    for point, theta in zip(z, thetas, strict=True):
        assert np.array_equal(space.decode(point), theta)
        assert np.array_equal(space.decode(space.snap(point)), theta)  # as an agent proposes it
        assert space.searches(theta)
        assert space.allows(theta)


@given(outcomes=st.lists(st.dictionaries(st.sampled_from("abcd"), st.floats()), min_size=1, max_size=12))
def test_any_outcomes_make_a_bank_of_numbers(outcomes):
    thetas = np.arange(float(len(outcomes)))[:, None]
    bank = Bank.of(thetas, thetas, KPIValues.of([Outcome(o) for o in outcomes]))
    known = {name for o in outcomes for name, v in o.items() if not np.isnan(v)}
    assert bank.names == tuple(sorted(known))
    assert bank.kpis.shape == (len(outcomes), len(known))
    assert not np.isnan(bank.kpis).any()
    for row, outcome in zip(bank.kpis, outcomes, strict=True):
        for name, value in zip(bank.names, row, strict=True):
            given_value = outcome.get(name, np.nan)
            assert value == (np.inf if np.isnan(given_value) else given_value)
