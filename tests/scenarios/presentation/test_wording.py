"""Values of knobs as people read them; a PID in ISA and in parallel form."""

import numpy as np
import pytest

from prefcal_env import PID as Controller
from prefcal_env import Knob, KnobSpace, Measurement
from prefcal_scenarios.wording import BOTH, ISA, PARALLEL, knob_number, pid_forms


@pytest.mark.parametrize(
    ("value", "text"), [(2.716, "2.72"), (14.98, "15"), (12345.0, "12300"), (1.234e-05, "1.23e−05")]
)
def test_a_logarithmic_knob_has_three_digits_and_large_values_no_powers_of_ten(value, text):
    assert knob_number(Knob("K_p", 1e-6, 1e6, scale="log10"), value) == text


SPACE = KnobSpace([Knob("K_p", 0.1, 10, "%/°C"), Knob("T_i", 1, 100, "s")])
PID = {"controller": "PID", "K_p": 2.0, "T_i": 8.0, "T_d": 3.0, "N": 10.0, "b": 0.5, "c": 0.0, "T_s": 0.1}


def found(settings, space=SPACE):
    return {p.name: p for p in pid_forms(settings, space, "s")}


def test_the_parallel_form_follows_from_the_isa_form():
    forms = found(PID)
    assert {n: (forms[n].value, forms[n].unit, forms[n].form) for n in ("K_p", "T_i", "T_d")} == {
        "K_p": (2.0, "%/°C", BOTH),
        "T_i": (8.0, "s", ISA),
        "T_d": (3.0, "s", ISA),
    }
    assert (forms["K_i"].value, forms["K_i"].unit) == (0.25, "%/°C/s")  # 2/8
    assert (forms["K_d"].value, forms["K_d"].unit) == (6.0, "%/°C s")  # 2 * 3
    assert forms["K_d"].form == PARALLEL
    assert forms["T_f (filter of the derivative)"].value == pytest.approx(0.3)  # 3/10


@pytest.mark.parametrize(
    ("T_d", "stated", "value", "rule"),
    [(3.0, None, 24**0.5, "√(T_i T_d)"), (0.1, None, 8.0, "T_i"), (3.0, 5.0, 5.0, "")],
)
def test_the_anti_windup_has_the_tracking_time_of_the_pid_that_runs(T_d, stated, value, rule):
    told = found(PID | {"T_d": T_d, "T_t": stated})["T_t (tracking time of the anti-windup)"]
    assert (told.value, told.unit, told.derived) == (pytest.approx(value), "s", rule)

    def second(applied):  # the move after one of which this was applied
        runs = Controller(2.0, 8.0, T_d, T_s=0.1, b=0.5, T_t=stated)
        for u in (0.0, applied):
            seen = Measurement(0.0, np.zeros(1), np.array([u]), np.zeros(0), np.ones(1), np.zeros(1))
            made = runs.move(seen).u[0]
        return made

    assert second(1.0) - second(0.0) == pytest.approx(0.1 / value)


def test_no_integral_action_is_an_infinite_time_and_a_gain_of_0():
    forms = found(PID | {"T_i": None})
    assert forms["T_i"].value == float("inf")
    assert forms["K_i"].value == 0.0
    assert not any(name.startswith("T_t") for name in forms), "there is nothing to wind up"


def test_a_gain_without_a_unit_has_parameters_per_time():
    forms = found(PID, KnobSpace([Knob("K_p", 0.1, 10)]))
    assert (forms["K_i"].unit, forms["K_d"].unit) == ("1/s", "s")


def test_several_pids_are_numbered_and_other_controllers_have_no_forms():
    two = {"controller": "Decentralized", "pids": [PID, PID | {"K_p": 4.0}]}
    space = KnobSpace([Knob("K_p_1", 0.1, 10, "V"), Knob("K_p_2", 0.1, 10, "A")])
    forms = found(two, space)
    assert (forms["K_p_1"].unit, forms["K_p_2"].unit) == ("V", "A")
    assert forms["K_i_2"].value == 0.5  # 4/8
    assert found({"controller": "LQR"}) == found({}) == {}
