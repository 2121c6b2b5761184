"""What the simulated θ promise, in words, and when to offer to stop."""

import pytest

from prefcal_app.simulating import Prospect
from prefcal_app.simulating.prospect import percent


def test_below_ten_percent_it_offers_to_stop():
    found = Prospect(940, 0.08)
    assert found.offer == (
        "The chance that the most promising of the 940 simulated is better than the best so far "
        "is 8 %. Stop here, or go on?"
    )
    assert found.text == found.offer.removesuffix(" Stop here, or go on?")


def test_from_ten_percent_on_it_only_says_what_is_left_to_gain():
    found = Prospect(940, 0.1)
    assert found.offer == ""
    assert found.text.endswith("better than the best so far is 10 %.")


@pytest.mark.parametrize(
    ("chance", "text"),
    [
        (0.0, "below 1 %"),
        (0.001, "below 1 %"),
        (0.5, "50 %"),
        (0.999, "above 99 %"),
        (1.0, "above 99 %"),
    ],
)
def test_nothing_reads_as_sure(chance, text):
    assert percent(chance) == text
