"""How numbers and names read."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefcal_bench.results.campaign import HUGE
from prefcal_bench.results.pictures import file_names
from prefcal_bench.results.statistics import MeanEstimate
from prefcal_bench.results.words import (
    chance,
    interval,
    plain_number,
    probability,
    ratio,
    seeds_text,
    short,
    short_name,
    with_interval,
)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (None, "–"),
        (float("nan"), "–"),
        (HUGE, "∞"),
        (0.123, "0.12"),
        (3553.0, "3600"),
        (2.5e7, "2.5e7"),
        (1.7e-9, "1.7e-9"),
        (49.0, "49"),
        (149.0, "150"),
    ],
)
def test_two_significant_digits(value, text):
    assert short(value) == text


@given(st.floats(1e-12, 1e12))
def test_short_is_right_to_two_digits(value):
    assert float(short(value)) == pytest.approx(value, rel=0.051)


def test_probabilities_and_missing_differences():
    found = [probability(p) for p in (0.0001, 0.012, 0.5, 1.0, None)]
    assert found == ["<0.001", "0.012", "0.50", "1.00", "–"]
    assert ratio(None) == "–"


def test_seeds_that_follow_each_other_are_a_range():
    assert seeds_text([0, 1, 2, 5]) == "seeds 0 to 2, 5"
    assert seeds_text([3, 4]) == "seeds 3, 4"
    assert seeds_text([7]) == "seed 7"


def test_file_names_are_plain_and_differ():
    assert file_names(["only"]) == [""]
    assert file_names(["perfect", "a/b c"]) == ["-perfect", "-a-b-c"]
    assert len(set(file_names(["a b", "a/b", "c"]))) == 3


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
    assert interval(MeanEstimate(1.234, 1.0, 2.0), 2) == "1.23 [1.00, 2.00]"
    assert interval(None) == "–"


def test_a_name_loses_its_folder_alone():
    assert short_name("some/where/own.py:Mine") == "own.py:Mine"
    assert short_name("GLISp") == "GLISp"
