"""Numbers as people read them."""

import pytest

from prefcal_env import Knob
from prefcal_scenarios.wording import counted, knob_number


@pytest.mark.parametrize(
    ("value", "text"), [(2.716, "2.72"), (14.98, "15"), (12345.0, "12300"), (1.234e-05, "1.23e−05")]
)
def test_a_logarithmic_knob_has_three_digits_and_large_values_no_powers_of_ten(value, text):
    assert knob_number(Knob("K_p", 1e-6, 1e6, scale="log10"), value) == text


def test_one_of_something_is_no_plural():
    assert [counted(n, "more KPI") for n in (0, 1, 2)] == ["0 more KPIs", "1 more KPI", "2 more KPIs"]
