"""Numbers as people read them."""

import shlex

import numpy as np
import pytest

from prefcal_app.terminal.showing import theta_of
from prefcal_env import Knob
from prefcal_env.knobs import KnobSpace
from prefcal_scenarios.wording import counted, knob_number, sentence, symbols_in, typed_theta


@pytest.mark.parametrize(
    ("value", "text"), [(2.716, "2.72"), (14.98, "15"), (12345.0, "12300"), (1.234e-05, "1.23e−05")]
)
def test_a_logarithmic_knob_has_three_digits_and_large_values_no_powers_of_ten(value, text):
    assert knob_number(Knob("K_p", 1e-6, 1e6, scale="log10"), value) == text


def test_one_of_something_is_no_plural():
    assert [counted(n, "more KPI") for n in (0, 1, 2)] == ["0 more KPIs", "1 more KPI", "2 more KPIs"]


def test_what_is_printed_to_be_typed_is_plain_and_is_read_back_exactly():
    knobs = [
        Knob("T_s", 0.1, 1.5, "h"),
        Knob("N_p", 4, 40, integer=True),
        Knob("log Q_Δu", -6.0, 2.0),
        Knob("K_p", -9.0, 9.0),
        Knob("gain[1,2]", 1e-9, 1.0, scale="log10"),
    ]
    space, theta = KnobSpace(knobs), [0.123456789012345, 20, -4.4, -1 / 3, 1.25e-7]
    said = typed_theta(space, theta)
    assert said == ("T_s=0.123456789012345, N_p=20, log_Q=-4.4, K_p=-0.3333333333333333, gain[1,2]=1.25e-07")
    assert theta_of(shlex.split(shlex.join(["--start", said]))[1], space).tolist() == theta
    assert str(symbols_in(f'--start "{said}"')).count("<sub>") == 0


def test_no_line_of_a_page_ends_between_a_number_and_its_unit():
    text = "from 68 to 78 degC at 40 %, 5 s or 12 min; ≤ 3 °C/%: 298 of 299 runs (seed 1) --runs 20 --seed 3"
    kept = str(symbols_in(text)).replace("\N{NO-BREAK SPACE}", "~")
    assert (
        kept
        == "from 68 to 78~degC at 40~%, 5~s or 12~min; ≤~3~°C/%: 298 of 299 runs (seed 1) --runs 20 --seed 3"
    )


@pytest.mark.parametrize("other", ["log Q", "log Q_y"])
def test_a_name_that_is_not_clear_without_its_other_letters_keeps_them(other):
    space = KnobSpace([Knob("log Q_Δu", -6.0, 2.0), Knob(other, -6.0, 2.0)])
    said = typed_theta(space, [-4.4, 1.0])
    assert said == f"log_Q_Δu=-4.4, {other.replace(' ', '_')}=1"
    assert np.array_equal(theta_of(said, space), [-4.4, 1.0])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("take that one", "Take that one."),
        ("verify it, with --seed 1 --limit 'x <= 2.5 s'", "Verify it, with --seed 1 --limit 'x <= 2.5 s'"),
        ("run: prefcal calibrate a.toml --start K=2", "Run: prefcal calibrate a.toml --start K=2"),
        ("leave --robust out, or wait", "Leave --robust out, or wait."),
    ],
)
def test_a_command_at_the_end_of_a_sentence_is_pasted_without_a_full_stop(text, said):
    assert sentence(text) == said
