import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefcal_agents.ledger import Ledger
from prefcal_agents.trust_region import around, half_width
from prefcal_env.preference import Answer


def ledger(answers):
    """Sample 0, and then one sample an answer."""
    known = Ledger().with_pending(np.zeros(2)).told(Answer(None), None)
    for answer in answers:
        known = known.with_pending(np.zeros(2)).told(Answer(answer), known.incumbent)
    return known


def always(index):
    return True


def test_it_doubles_with_success_and_shrinks_with_failure_and_ties():
    assert half_width(ledger([-1]), 0.1, always) == pytest.approx(0.2)
    assert half_width(ledger([1]), 0.1, always) == pytest.approx(0.07)
    assert half_width(ledger([0, -1]), 0.1, always) == pytest.approx(0.14)


def test_samples_proposed_elsewhere_and_abstentions_leave_it():
    assert half_width(ledger([1, -1, 1]), 0.1, lambda index: False) == 0.1
    assert half_width(ledger([None, None]), 0.1, always) == 0.1
    assert half_width(ledger([1]).retracted(1), 0.1, always) == 0.1


@given(st.lists(st.sampled_from([-1, 0, 1, None]), max_size=60))
def test_it_stays_between_its_limits(answers):
    assert 1e-4 <= half_width(ledger(answers), 0.3, always) <= 0.5


def test_the_box_ends_where_the_cube_does():
    low, high = around(np.array([0.1, 0.5, 1.0]), 0.25)
    assert low == pytest.approx([0.0, 0.25, 0.75])
    assert high == pytest.approx([0.35, 0.75, 1.0])
