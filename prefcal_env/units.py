"""Compare units by what they mean, and convert values between them."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from math import isclose
from typing import Any
from unicodedata import normalize

from .errors import PrefcalError

Values = Any  # a number, or an array of any shape


@dataclass(frozen=True, slots=True)
class Conversion:
    """Conversion of a value to another unit: factor · value + offset."""

    factor: float = 1.0  # value of one unit in the other unit, not 0
    offset: float = 0.0  # what 0 is in the other unit

    def to(self, values: Values) -> Values:
        """Return a value, or an array of them, in the other unit."""
        return values if self == AS_IT_IS else self.factor * values + self.offset

    def back(self, values: Values) -> Values:
        """Return a value in the other unit, or an array of them, in the first one."""
        return values if self == AS_IT_IS else (values - self.offset) / self.factor


AS_IT_IS = Conversion()  # conversion into the same unit


def same(one: str, other: str) -> bool:
    """Return whether two units are equal, whatever their spelling: "ºC" is "degC", mW is not MW."""
    units = {plain(one), plain(other)}
    if len(units) == 2 and units <= _AT_ONCE:
        return False  # without loading the library
    return conversion(one, other) == AS_IT_IS


def conversion(one: str, other: str, *, difference: bool = False) -> Conversion | None:
    """Return how a value in one unit becomes one in the other; None if it cannot.

    No unit converts into none, "-" or "1" only. A unit that is not known is a label: it converts into
    itself. Angles are no pure numbers: rpm converts into rad/s, but not into Hz.

    Args:
        difference: Whether the value is a difference, so that 9 °C are 9 K.
    """
    found = _conversion(plain(one), plain(other), difference)
    return _conversion(_small(one), _small(other), difference) if found is None else found


def convert(
    values: Values, one: str, other: str, what: str, error: type[PrefcalError], *, difference: bool = False
) -> Values:
    """Return a value in one unit, or an array of them, in the other unit.

    Args:
        what: What has the unit, for messages: "column 'level'".
        difference: Whether it is a difference, so that 9 °C are 9 K.

    Raises:
        PrefcalError: An `error`, if it cannot be converted.
    """
    found = conversion(one, other, difference=difference)
    if found is None:
        raise error(f"{what} is in {named(one)}, which cannot be converted to {named(other)}")
    return found.to(values)


def seconds(unit: str) -> float | None:
    """Return the length of a unit of time in seconds; None if it is none."""
    return _TIMES.get(plain(unit))


def known(text: str) -> bool:
    """Return whether a text is surely a unit, and no word, number, or name such as A, T1 or "in"."""
    if _NAMES.fullmatch(text.strip()):
        return False
    unit = plain(text)
    return unit not in ("", "1") and (unit in _AT_ONCE or _parsed(unit) is not None)


def named(unit: str) -> str:
    """Return a unit for a message, in short."""
    return unit[:40] or "no unit"


# --- Spell units alike, without a library: most questions are answered by equal texts.


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


_SECONDS = {"ns": 1e-9, "us": 1e-6, "ms": 1e-3, "s": 1.0}
_TIMES = {**_SECONDS, "min": 60.0, "h": 3600.0, "d": 86400.0, "week": 604800.0}
_SPELLINGS = {
    "ns": "nsec nanos nanosecond nanoseconds",
    "us": "usec μs μsec micros microsecond microseconds",
    "ms": "msec msecs millis millisecond milliseconds",
    "s": "sec secs second seconds",
    "min": "min mins minute minutes",
    "h": "hr hrs hour hours",
    "d": "day days",
    "week": "wk weeks",
    "degC": "C Cel celsius",
    "degF": "F fahrenheit",
    "delta_degC": "ΔdegC",
    "delta_degF": "ΔdegF",
    "K": "kelvin ΔK",
    "%": "percent pct",
    "°": "deg degree degrees",
    "l": "L liter liters litre litres",
    "N*m": "Nm",
    "bar": "bar",
    "rpm": "rpm U/min r/min rev/min",
    "m3/h": "cbm/h cmh CMH",
    "mmH2O": "mmWC mmWS mmWG",
    "um": "micron microns",
    "pH": "PH",
    "l/min": "lpm",
    "gal/min": "gpm",
    "ft3/min": "cfm",
    "1": "- – — none unitless dimensionless",
}
_SPELLED = {spelling: unit for unit, words in _SPELLINGS.items() for spelling in words.split()}
_AT_ONCE = _words("degC degF K % bar mbar kPa Pa m mm kg m/s m3/h l/min rpm W kW V A Hz °") | _TIMES.keys()
"""Units that are known without the library."""
_SIGNS = str.maketrans({**dict.fromkeys("º˚", "°"), **dict.fromkeys("·⋅∙•×", "*"), "∆": "Δ"})
_MINUS = str.maketrans({"⁻": "-", "−": "-", "^": None})
_DEGREES = re.compile(r"(?:\bdeg(?:rees?)?|°)[ _.]*([CFK])(?:elsius|ahrenheit|elvin)?\b", re.IGNORECASE)
_GAUGE = re.compile(r"(\b[kM]?Pa|\bm?bar|\bpsi)[ (]*([ag])\)?$")  # above the atmosphere, or absolute
_NAMES = re.compile(r"(?![Kdhms]$)[A-Za-z]\d*|in", re.ASCII)  # what units are called, but other things, too
_TOKEN = re.compile(r"([^\W\d]+(?:\d+[^\W\d]+)*|[%°])(-?\d+)?")  # a name such as mmH2O, and its power


@lru_cache(2048)
def plain(unit: str) -> str:
    """Return a unit in one of its spellings, the same for most of them: "m3/h" for "m³ / h"."""
    text = normalize("NFKC", unit.translate(_SIGNS).translate(_MINUS)).translate(_MINUS)
    text = text.replace("**", "").replace("Ohm", "ohm").strip().rstrip(".")
    text = _DEGREES.sub(lambda found: {"c": "degC", "f": "degF", "k": "K"}[found[1].lower()], text)
    text = _GAUGE.sub(r"\1\2", text)
    text = re.sub(r"\s+per\s+", "/", text)
    text = re.sub(r"\s*([/*()])\s*", r"\1", text)
    text = re.sub(r"[\s.]+", "*", text)
    if text.startswith("/"):
        text = f"1{text}"
    return _SPELLED.get(text) or _TOKEN.sub(_alike, text)


def _alike(found: re.Match[str]) -> str:
    """Return the usual spelling of a name; that of long ones does not depend on capitals."""
    name, power = found[1], found[2] or ""
    spelled = _SPELLED.get(name)
    if spelled is None and len(name) > 2:
        spelled = _SPELLED.get(name.lower())
    # Nm3 are normal cubic meters.
    return f"{name if spelled is None or (power and '*' in spelled) else spelled}{power}"


def _small(unit: str) -> str:
    """Return a plain unit; a ratio in capitals only without these, if it is known then: M3/H, KG/H."""
    small = plain(unit.lower())
    shouted = "/" in unit and unit == unit.upper()
    return small if shouted and _parsed(small) is not None else plain(unit)


@lru_cache(2048)
def _conversion(one: str, other: str, difference: bool) -> Conversion | None:
    """Return the conversion between two plain units."""
    if one == other or {one, other} == {"", "1"}:
        return AS_IT_IS
    if not one or not other:
        return None
    if one in _TIMES and other in _TIMES:
        # Of whole numbers, so that minutes there and back are exact.
        long = _TIMES[one] > _TIMES[other]
        ratio = max(_TIMES[one], _TIMES[other]) / min(_TIMES[one], _TIMES[other])
        return Conversion(float(f"{ratio:.12g}") if long else 1 / float(f"{ratio:.12g}"))
    units = _parsed(one), _parsed(other)
    if units[0] is None or units[1] is None:
        return AS_IT_IS if _label(one) == _label(other) else None
    return _converted(units[0], units[1], difference)


def _label(unit: str) -> str:
    """Return a unit without products and capitals, but for single letters and what may be a prefix.

    So "% RH" is "%rh", but mX is not MX.
    """

    def small(found: re.Match[str]) -> str:
        kept = 1 if found[0][0] in "mMpP" or len(found[1]) == 1 else 0
        return found[0][:kept] + found[0][kept:].lower()

    return re.sub(r"\(([%\w]+)\)", r"\1", _TOKEN.sub(small, unit).replace("*", ""))


# --- What pint knows of units. It takes a moment to load, so only units that differ need it.

_METRIC = _words(
    "second meter gram liter ampere volt watt joule newton pascal bar hertz mole ohm siemens farad henry "
    "tesla weber coulomb volt_ampere watt_hour lux lumen candela radian electron_volt kelvin calorie "
    "poise stokes meter_H2O meter_Hg force_gram var"
)
"""Units that may have a prefix."""
_OTHERS = _words(
    "minute hour day week degree_Celsius degree_Fahrenheit degree_Rankine delta_degree_Celsius "
    "delta_degree_Fahrenheit percent ppm degree turn revolutions_per_minute inch foot yard mile "
    "mile_per_hour kilometer_per_hour knot pound ounce force_pound force_kilogram gallon barrel "
    "pound_force_per_square_inch standard_atmosphere torr inch_H2O inch_Hg "
    "horsepower british_thermal_unit metric_ton standard_gravity cubic_centimeter kgmol"
)
"""Units without a prefix. All others of pint are labels: it reads pH as picohenry, cfm as centifermi."""
_PREFIXES = _words("pico nano micro milli centi deci hecto kilo mega giga tera") | {""}
_FROM_ANOTHER_ZERO = {"degree_Celsius", "degree_Fahrenheit"}
_ANGLES = {"radian", "degree", "turn", "revolutions_per_minute"}  # pint takes them for pure numbers


@lru_cache(1)
def _registry() -> Any:
    import pint

    registry: Any = pint.UnitRegistry()
    registry.define("var = volt * ampere")
    registry.define("kgmol = 1000 * mole")
    return registry


@lru_cache(2048)
def _parsed(unit: str) -> Any:
    """Return a plain unit as one of pint; None if it is a label."""
    names = [(found, _name(found[1])) for found in _TOKEN.finditer(unit)]
    if not all(name for _, name in names):
        return None
    spelled = {found.start(): name for found, name in names}
    text = _TOKEN.sub(lambda f: f" {spelled[f.start()]} " + (f"**{f[2]}" if f[2] else ""), unit)
    try:
        return _registry().parse_units(text)
    except Exception:  # it has many for texts that are no units, AssertionError among them
        return None


def _name(token: str) -> str:
    """Return the name that pint has for a part of a unit; "" if it is no unit of ours."""
    token = {"%": "percent", "°": "degree"}.get(token, token)
    return next(_candidates(token), "")


def _candidates(token: str) -> Iterator[str]:
    """Yield what a part of a unit may mean, the likeliest first.

    If only capitals make it unknown, it may mean what these make known, but not with a prefix of two
    meanings: Mpa may be MPa or mPa.
    """
    if token == "pH":
        return
    for prefix, name, _ in _registry().parse_unit_name(token):
        if (name in _OTHERS and not prefix) or (name in _METRIC and prefix in _PREFIXES):
            yield f"{prefix}{name}"
    if len(token) > 1:
        kilo = f"k{token[1:]}" if token[0] == "K" else token
        for prefix, name, _ in _registry().parse_unit_name(kilo, case_sensitive=False):
            if (name in _METRIC and prefix in ("", "kilo")) or (name in _OTHERS and not prefix):
                yield f"{prefix}{name}"


def _converted(one: Any, other: Any, difference: bool) -> Conversion | None:
    """Return the conversion between two units of pint; None if they measure something else."""
    if one.dimensionality != other.dimensionality or _angles(one) != _angles(other):
        return None
    registry = _registry()
    above_zero = [str(unit) in _FROM_ANOTHER_ZERO for unit in (one, other)]
    steps = [
        registry.parse_units(f"delta_{unit}") if from_zero else unit
        for unit, from_zero in zip((one, other), above_zero, strict=True)
    ]
    factor = _round(registry.Quantity(1.0, steps[0]).to(steps[1]).magnitude)
    if difference or not any(above_zero):
        return Conversion(factor)
    if "delta_" in f"{one} {other}":
        return None  # a temperature is no difference of temperatures
    return Conversion(factor, _round(registry.Quantity(0.0, one).to(other).magnitude))


def _angles(unit: Any) -> float:
    """Return the power of angles in a unit of pint."""
    return float(sum(power for name, power in unit._units.items() if name in _ANGLES))


def _round(value: Any) -> float:
    short = float(f"{value:.12g}")  # 1 l/min is 0.06 m3/h, not 0.06000000000000001
    return short if isclose(short, value, rel_tol=1e-15) else float(value)
