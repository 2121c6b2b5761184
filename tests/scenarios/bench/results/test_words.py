"""How numbers and names read."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefcal_scenarios.bench.results.campaign import HUGE, Regime
from prefcal_scenarios.bench.results.pictures import file_names
from prefcal_scenarios.bench.results.words import probability, ratio, regime_name, seeds_text, short


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"), (None, "–"), (float("nan"), "–"), (HUGE, "∞"), (0.123, "0.12"),
        (3553.0, "3600"), (2.5e7, "2.5e7"), (1.7e-9, "1.7e-9"), (49.0, "49"), (149.0, "150"),
    ],
)  # fmt: skip
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


def test_budgets_are_named_only_where_they_differ():
    a, b = Regime("perfect", 10, 50), Regime("perfect", 5, 20)
    assert regime_name(a, [a]) == "perfect calibrator"
    assert regime_name(b, [a, b]) == "perfect calibrator, 20 experiments (5 initial)"


def test_file_names_are_plain_and_differ():
    assert file_names(["only"]) == [""]
    assert file_names(["perfect", "a/b c"]) == ["-perfect", "-a-b-c"]
    assert len(set(file_names(["a b", "a/b", "c"]))) == 3
