"""What the simulated θ promise, in words, and when to offer to stop."""

import pytest

from prefcal_scenarios.app.screening import Prospect
from prefcal_scenarios.app.screening.prospect import percent


def test_below_fifteen_percent_it_offers_to_stop():
    found = Prospect(940, 0.08)
    assert found.offer == (
        "Nothing among the 940 simulated is expected to be preferred to the best so far (chance of "
        "the most promising: 8 %). Stop here, or go on?"
    )
    assert Prospect(940, 0.149).stop
    assert found.text == found.offer.removesuffix(" Stop here, or go on?")


def test_from_fifteen_percent_on_it_says_what_is_left_to_gain():
    found = Prospect(940, 0.15)
    assert (found.stop, found.offer) == (False, "")
    assert found.text == (
        "The most promising of the 940 simulated is preferred to the best so far with a chance of "
        "15 %."
    )


@pytest.mark.parametrize(
    ("chance", "text"),
    [
        (0.0, "0 %"),
        (0.001, "less than 1 %"),
        (0.5, "50 %"),
        (0.999, "more than 99 %"),
        (1.0, "100 %"),
    ],
)
def test_only_what_is_sure_reads_as_sure(chance, text):
    assert percent(chance) == text
