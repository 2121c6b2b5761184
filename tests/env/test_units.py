"""Units: equal spellings, conversions there and back, and what is no unit."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefcal_env.errors import RecordError
from prefcal_env.units import Conversion, conversion, convert, known, same, seconds
from support.new_process import in_a_new_process

EQUAL = {
    "°C": ["degC", "ºC", "℃", "deg C", "Cel", "Celsius", "° C", "degrees C", "C"],
    "K": ["kelvin", "Kelvin", "degK"],
    "min": ["Min", "MIN", "minutes", "Minutes", "min.", " min "],
    "s": ["sec", "Sec", "seconds", "sec."],
    "h": ["hr", "hours", "Hours"],
    "m³/h": ["m3/h", "m^3/h", "m**3 / h", "m³·h⁻¹", "m3 per h", "㎥/h", "M3/H", "cbm/h"],
    "µm": ["μm", "um"],
    "%": ["percent", "pct", "％"],
    "": ["-", "1", "–"],
    "%RH": ["% RH", "%rh"],
    "kg/h": ["KG/H", "kg/hr"],
    "mmHg": ["mm Hg"],
    "pH": ["PH"],
    "rpm": ["U/min", "RPM", "r/min"],
    "l/min": ["L/min", "lpm", "liters/min"],
    "bar": ["Bar", "BAR"],
    "kW": ["KW", "kilowatt", "kJ/s"],
    "N m": ["Nm", "N·m", "N*m", "N.m"],
    "kPa": ["kpa", "KPA"],
    "barg": ["bar(g)", "bar g", "bar (g)"],
    "1/s": ["s-1", "s^-1", "/s", "Hz"],
    "W/(m² K)": ["W/m2/K", "W/(m2.K)"],
    "ticks": ["Ticks", " ticks "],
}
"""Other spellings of units, and of a label."""
QUANTITIES = {
    "time": ["ms", "s", "min", "h", "d", "week"],
    "temperature": ["°C", "K", "°F"],
    "power": ["mW", "W", "kW", "MW", "hp"],
    "pressure": ["Pa", "mbar", "bar", "psi", "mmHg"],
    "flow": ["m3/h", "l/min", "l/s", "gpm"],
    "speed": ["m/s", "km/h", "mph"],
    "rotation": ["rpm", "rad/s", "deg/s"],
    "gain": ["%/°C", "%/K", "1/°F"],
    "frequency": ["Hz", "1/min"],
    "share": ["%", "1", "ppm"],
    "label": ["ticks"],
    "other label": ["pH"],
    "normal volume": ["Nm3/h"],
    "gauge": ["barg"],
}
"""Units of one quantity each: they convert into each other, and into no unit of the others."""
EVERY = [(name, unit) for name, units in QUANTITIES.items() for unit in units]


@pytest.mark.parametrize(("one", "other"), [(u, o) for u, others in EQUAL.items() for o in others])
def test_a_unit_is_the_same_however_it_is_spelled(one, other):
    assert same(one, other)
    assert same(other, one)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("mW", "MW"),
        ("Mpa", "mPa"),
        ("mX", "MX"),
        ("s", "S"),
        ("h", "H"),
        ("m s", "ms"),
        ("°C", "K"),
        ("a", "A"),
    ],
)
def test_capitals_that_mean_something_else_stay_apart(one, other):
    assert not same(one, other)


@pytest.mark.parametrize(
    ("one", "other", "value", "expected"),
    [
        ("min", "s", 9.0, 540.0),
        ("s", "min", 540.0, 9.0),
        ("kW", "W", 1.5, 1500.0),
        ("°C", "K", 20.0, 293.15),
        ("°F", "°C", 212.0, 100.0),
        ("MW", "mW", 1.0, 1e9),
        ("%/°C", "1/K", 50.0, 0.5),
        ("l/min", "m3/h", 1.0, 0.06),
        ("rpm", "rad/s", 60.0, 2 * np.pi),
        ("°/s", "rpm", 6.0, 1.0),
        ("1/min", "Hz", 60.0, 1.0),
        ("bar", "Pa", 1.0, 1e5),
        ("m min", "m s", 2.0, 120.0),
        ("kgmol/m3", "mol/l", 8.57, 8.57),
        ("K/min", "°C/s", 60.0, 1.0),
        ("Δ°C", "K", 3.0, 3.0),
    ],
)
def test_values_are_converted(one, other, value, expected):
    assert convert(value, one, other, "a value", RecordError) == pytest.approx(expected, rel=1e-12)


def test_a_difference_of_temperatures_has_no_offset():
    assert conversion("°C", "K", difference=True) == Conversion(1.0, 0.0)
    assert conversion("°F", "K", difference=True) == Conversion(pytest.approx(5 / 9), 0.0)
    assert conversion("°C", "Δ°C") is None
    assert conversion("°C min", "K s") == Conversion(60.0, 0.0)


@given(
    st.sampled_from([units for units in QUANTITIES.values() if len(units) > 1]),
    st.data(),
    st.floats(-1e6, 1e6),
    st.booleans(),
)
def test_there_and_back_is_the_value(units, data, value, difference):
    one, other = (data.draw(st.sampled_from(units)) for _ in range(2))
    there = conversion(one, other, difference=difference)
    back = conversion(other, one, difference=difference)
    size = abs(value) + abs(there.offset / there.factor) + abs(back.offset) + 1e-300
    assert abs(back.to(there.to(value)) - value) <= 1e-12 * size
    assert abs(there.back(there.to(value)) - value) <= 1e-12 * size


@given(st.sampled_from(EVERY), st.sampled_from(EVERY))
def test_only_units_of_one_quantity_are_converted(one, other):
    assert (conversion(one[1], other[1]) is not None) == (one[0] == other[0])


@given(st.text(max_size=12), st.text(max_size=12))
def test_any_text_is_a_unit_or_a_label(one, other):
    assert same(one, one)
    assert same(one, other) == same(other, one)


def test_what_cannot_be_converted_is_named():
    with pytest.raises(RecordError, match="column 'level' is in m, which cannot be converted to no unit"):
        convert(1.0, "m", "", "column 'level'", RecordError)


@pytest.mark.parametrize("text", ["", "1", "2", "A", "T1", "in", "north", "old", "ref", "max", "a", "%RH"])
def test_a_word_or_a_number_is_no_unit(text):
    assert not known(text)


@pytest.mark.parametrize("text", ["s", "°C", "ºC", "kW", "m3/h", "K", "mm", "1/min", "km/h", "hPa", "%"])
def test_units_are_known(text):
    assert known(text)


def test_times_have_a_length():
    lengths = {"ms": 1e-3, "Min": 60.0, "hours": 3600.0, "days": 86400.0, "m": None, "": None, "ticks": None}
    assert {unit: seconds(unit) for unit in lengths} == lengths


def test_the_library_is_loaded_only_for_units_that_differ():
    code = (
        "import sys; from prefcal_env import Knob; from prefcal_env.units import same, conversion, known; "
        "same('ºC', 'degC'), conversion('min', 's'), known('kW'), same('m³/h', 'm3/h'), same('x', 'x'); "
        "assert 'pint' not in sys.modules; conversion('kW', 'W'); assert 'pint' in sys.modules"
    )
    in_a_new_process(code)
