"""The numbers of a PID in other forms: all of them are the same controller."""

from typing import Any

import numpy as np
import pytest

from prefcal_env import PID
from prefcal_env.controllers.forms import ALL, BOTH, ISA, PARALLEL, PERCENT, SERIES, pid_forms
from prefcal_env.errors import SettingsError
from prefcal_env.experiments.experiment import Measurement

UNITS = {"K_p": "%/°C", "T_i": "s"}
GIVEN = {"controller": "PID", "K_p": 2.0, "T_i": 8.0, "T_d": 3.0, "N": 10.0, "b": 0.5, "c": 0.0, "T_s": 0.1}


def forms(
    given: dict[str, Any], units: dict[str, str] = UNITS, time: str = "s", **more: Any
) -> dict[str, Any]:
    return {p.name: p for p in pid_forms(given, units, time, **more)}


def response(form: str, found: dict[str, Any], s: complex) -> complex:
    """Return the transfer function from the error to the input, of the numbers of one form."""
    n = {name.partition(" ")[0]: p.value for name, p in found.items()}
    low_pass = 1 + n["T_f"] * s
    if form == PARALLEL:
        return n["K_p"] + n["K_i"] / s + n["K_d"] * s / low_pass
    if form == SERIES:
        return n["K_p′"] * (1 + 1 / n["T_i′"] / s) * (1 + n["T_d′"] * s) / low_pass
    return n["K_p"] * (1 + 1 / n["T_i"] / s + n["T_d"] * s / low_pass)


@pytest.mark.parametrize(
    "change", [{}, {"T_d": 0.0}, {"T_i": None}, {"T_i": None, "T_d": 0.0}, {"T_i": 1e200}]
)
def test_all_forms_are_the_same_controller_with_its_filter(change: dict[str, Any]) -> None:
    found = forms(GIVEN | {"K_p": -1.2, "T_i": 50.0, "T_d": 9.0} | change)
    for omega in (1e-3, 0.1, 5.0, 1e3):
        values = [response(form, found, 1j * omega) for form in (ISA, PARALLEL, SERIES)]
        np.testing.assert_allclose(values, values[0], rtol=1e-12)


def test_the_series_form_needs_an_integral_time_of_about_four_derivative_times() -> None:
    fits, not_ = (forms(GIVEN | {"T_i": 40.0, "T_d": T_d}) for T_d in (9.5, 9.6))
    assert fits["T_d′"].value > 0
    assert not_["T_d′"].value != not_["T_d′"].value  # NaN
    assert "quarter" in not_["K_p′"].derived


def test_the_parallel_form_follows_from_the_isa_form() -> None:
    found = forms(GIVEN)
    assert {n: (found[n].value, found[n].unit, found[n].form) for n in ("K_p", "T_i", "T_d")} == {
        "K_p": (2.0, "%/°C", BOTH),
        "T_i": (8.0, "s", ISA),
        "T_d": (3.0, "s", ISA),
    }
    assert (found["K_i"].value, found["K_i"].unit) == (0.25, "%/(°C s)")  # 2/8
    assert (found["K_d"].value, found["K_d"].unit) == (6.0, "% s/°C")  # 2 * 3
    assert found["K_d"].form == PARALLEL
    T_f = found["T_f (filter of the derivative)"]
    assert (T_f.value, T_f.form) == (pytest.approx(0.3), ALL)  # 3/10


def test_no_integral_action_is_an_infinite_time_and_a_gain_of_0() -> None:
    found = forms(GIVEN | {"T_i": None})
    assert found["T_i"].value == float("inf")
    assert found["K_i"].value == found["1/T_i (repeats per minute)"].value == 0.0
    assert not any(name.startswith("T_t") for name in found), "there is nothing to wind up"


@pytest.mark.parametrize(
    ("T_d", "stated", "value", "rule"),
    [(3.0, None, 24**0.5, "√(T_i T_d)"), (0.1, None, 8.0, "T_i"), (3.0, 5.0, 5.0, "")],
)
def test_the_anti_windup_has_the_tracking_time_of_the_pid_that_runs(
    T_d: float, stated: float | None, value: float, rule: str
) -> None:
    told = forms(GIVEN | {"T_d": T_d, "T_t": stated})["T_t (tracking time of the anti-windup)"]
    assert (told.value, told.unit, told.derived) == (pytest.approx(value), "s", rule)
    minutes = forms(GIVEN | {"T_d": T_d, "T_t": stated}, shown="min")
    assert minutes["T_t (tracking time of the anti-windup)"].value == pytest.approx(value / 60)

    def second(applied: float) -> float:  # the move after one of which this was applied
        runs = PID(2.0, 8.0, T_d, T_s=0.1, b=0.5, T_t=stated)
        for u in (0.0, applied):
            seen = Measurement(0.0, np.zeros(1), np.array([u]), np.zeros(0), np.ones(1), np.zeros(1))
            made = float(runs.move(seen).u[0])
        return made

    assert second(1.0) - second(0.0) == pytest.approx(0.1 / value)


def test_a_gain_without_a_unit_has_parameters_per_time() -> None:
    found = forms(GIVEN, {})
    assert (found["K_i"].unit, found["K_d"].unit) == ("1/s", "s")
    flow = forms(GIVEN, {"K_p": "m3/h/K"})
    assert (flow["K_i"].unit, flow["K_d"].unit) == ("m3/h/K/s", "(m3/h/K) s")


def test_times_may_be_shown_in_minutes() -> None:
    found = forms(GIVEN | {"T_i": 120.0}, shown="min")
    # 120 s are 2 min: half a repeat per minute, and a gain of 2 %/°C in 2 min.
    assert (found["T_i"].value, found["T_i"].unit) == (2.0, "min")
    assert (found["K_i"].value, found["K_i"].unit) == (1.0, "%/(°C min)")
    for time, T_i in (("s", 120.0), ("min", 2.0), ("h", 1 / 30)):
        repeats = forms(GIVEN | {"T_i": T_i}, time=time)["1/T_i (repeats per minute)"]
        assert (repeats.value, repeats.unit) == (pytest.approx(0.5), "1/min")


def test_percent_of_ranges_and_proportional_band() -> None:
    # 4 %/K over 50 K and 100 %: 2 % a %, a band of 50 %, whichever way it acts.
    for sign in (1, -1):
        found = forms(GIVEN | {"K_p": sign * 4.0}, spans=(50.0, 100.0))
        assert (found["K"].value, found["K"].unit, found["K"].form) == (sign * 2.0, "%/%", PERCENT)
        assert (found["PB (proportional band)"].value, found["PB (proportional band)"].unit) == (50.0, "%")
        assert not {"K′", "PB′ (proportional band)"} & set(found)  # the T_d of GIVEN is too long for it
    assert "K" not in forms(GIVEN)


@pytest.mark.parametrize("change", [{}, {"T_i": None}, {"T_d": 0.0, "K_p": -1.2}])
def test_the_series_form_in_percent_is_of_its_own_gain(change: dict[str, Any]) -> None:
    found = forms(GIVEN | {"T_i": 50.0, "T_d": 9.0} | change, spans=(50.0, 100.0))
    K = found["K′"].value
    assert found["K_p′"].value / 2 == K
    assert found["PB′ (proportional band)"].value == pytest.approx(100 / abs(K))
    same = {"T_i", "T_d"} & set(change) != set()
    assert (pytest.approx(found["K"].value) == K) == same, "without both parts, series and ISA are alike"


def test_several_pids_are_numbered_and_other_controllers_have_no_forms() -> None:
    two = {"controller": "Decentralized", "pids": [GIVEN, GIVEN | {"K_p": 4.0}]}
    found = forms(two, {"K_p_1": "V", "K_p_2": "A"})
    assert (found["K_p_1"].unit, found["K_p_2"].unit) == ("V", "A")
    assert found["K_i_2"].value == 0.5  # 4/8
    assert forms({"controller": "LQR"}) == forms({}) == {}


@pytest.mark.parametrize("change", [{"K_p": "high"}, {"T_i": 0.0}, {"N": None}, {"T_s": [1.0]}])
def test_settings_that_no_pid_has_have_no_forms(change: dict[str, Any]) -> None:
    assert forms(GIVEN | change) == {}
    assert forms({"controller": "Decentralized", "pids": [GIVEN, GIVEN | change]}) == {}
    assert forms({"controller": "Decentralized", "pids": [3]}) == {}


@pytest.mark.parametrize("spans", [(0.0, 1.0), (1.0, -1.0), (np.inf, 1.0), (1.0, np.nan)])
def test_a_range_that_is_none_is_refused(spans: tuple[float, float]) -> None:
    with pytest.raises(SettingsError, match="ranges of output and input"):
        forms(GIVEN, spans=spans)


@pytest.mark.parametrize(
    ("time", "shown", "words"),
    [
        ("s", "bar", "times in s cannot be shown in 'bar': give s, min or h"),
        ("", "s", "times in no unit cannot be shown in 's': the plant says none, so leave the unit out"),
    ],
)
def test_a_unit_that_times_do_not_have_is_refused(time: str, shown: str, words: str) -> None:
    with pytest.raises(SettingsError, match=words):
        forms(GIVEN, time=time, shown=shown)
