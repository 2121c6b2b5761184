"""Worth, intervals and probabilities as text."""

import pytest

from prefcal_scenarios.bench.worth.words import chance, plain_number, short_name, with_interval


@pytest.mark.parametrize(
    ("value", "text"), [(1.0, "1.0"), (9.94, "9.9"), (9.96, "10"), (1234.5, "1234"), (None, "–")]
)
def test_worth_has_two_digits_or_all_before_the_point(value, text):
    assert plain_number(value) == text


def test_intervals_are_in_brackets_if_there_are_any():
    assert with_interval(90.2, 60.1, 130.0) == "90 [60, 130]"
    assert with_interval(90.2, None, None) == "90"
    assert with_interval(None, None, None) == "–"
    assert chance(0.625, 0.5, 0.754) == "62 % [50, 75]"
    assert chance(0.625, None, None) == "62 %"
    assert chance(None, None, None) == "–"


def test_a_name_loses_its_folder_alone():
    assert short_name("some/where/own.py:Mine") == "own.py:Mine"
    assert short_name("GLISp") == "GLISp"
