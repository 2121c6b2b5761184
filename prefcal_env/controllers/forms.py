"""Say the numbers of a PID in the forms that control systems use: ISA, parallel, series and percent."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf, isfinite, nan, sqrt
from typing import Any

from prefcal_env.errors import SettingsError
from prefcal_env.units import conversion

from .pid import PID, tracking_time


@dataclass(frozen=True, slots=True)
class PIDParameter:
    """Parameter of a PID in one form."""

    form: str  # forms that have it
    name: str  # symbol
    value: float  # an infinite integral time is no integral action; NaN if the form cannot do this PID
    unit: str  # unit of the value
    derived: str = ""  # how it follows from the ISA form, or why there is none; empty if it is of that form


ISA, PARALLEL, SERIES, PERCENT = "ISA (standard)", "parallel", "series", "percent"
BOTH, ALL = "ISA, parallel", "all"
EQUATIONS: Mapping[str, str] = {
    ISA: "K_p (e + 1/T_i ∫e dt + T_d de/dt)",
    PARALLEL: "K_p e + K_i ∫e dt + K_d de/dt",
    SERIES: "K_p′ (1 + 1/(T_i′ s)) (1 + T_d′ s)/(1 + T_f s) e",
    PERCENT: "with input and output in percent of their ranges; K′ and PB′ are of the series form",
}
"""Forms, with what they are of the error e = r - y."""
FILTERED = (
    "T_f = T_d/N filters the derivative only, but in the series form all of it. "
    "K_p above 0 is reverse action, below 0 direct action."
)
"""What holds for all forms."""
ANTI_WINDUP = (
    "Against windup the integral also gets ∫(u − v)/T_t dt: v is the output before the limits, u after them."
)
"""What holds for all forms with integral action."""
_NEEDED = {"K_p", "T_i", "T_d", "T_s", "N", "b", "c"}
NO_SERIES = "the series form cannot have a T_d above about a quarter of T_i"


def pid_forms(
    settings: Mapping[str, Any],
    units: Mapping[str, str],
    time: str,
    *,
    shown: str = "",
    spans: tuple[float, float] | None = None,
) -> tuple[PIDParameter, ...]:
    """Return the parameters of the PIDs that `settings` describe, in each form; () for others.

    Source: Åström, Hägglund (2006), Advanced PID Control: the forms, and proportional band as 100 % / K.
    Deviation: the series form is exact with the filter; the book converts PIDs without one.

    Args:
        settings: Settings of the controller, as `prefcal_env.controllers` describes it.
        units: Units of the knobs of the study by name; that of K_p is the knob's.
        time: Unit of time of the settings.
        shown: Unit of time of the parameters; the same if empty.
        spans: Ranges of the measured output and of the input, high minus low, for the gain in percent.

    Raises:
        SettingsError: If `time` cannot be converted to `shown`, or a span is not above 0 and finite.
    """
    scale = conversion(time, shown or time)
    if scale is None:
        what = f"in {time} cannot be shown in {shown!r}: give s, min or h"
        none = f"in no unit cannot be shown in {shown!r}: the plant says none, so leave the unit out"
        raise SettingsError(f"times {what if time else none}")
    if spans is not None and not all(0 < span < inf for span in spans):
        raise SettingsError(f"the ranges of output and input must be above 0 and finite, got {spans}")
    found: list[PIDParameter] = []
    pids = _pids(settings)
    for number, pid in enumerate(pids, start=1):
        end = f"_{number}" if len(pids) > 1 else ""
        times = ("T_i", "T_d", "T_s", *(["T_t"] if pid.get("T_t") is not None else []))
        scaled = {n: _time(pid[n]) * scale.factor for n in times}
        found += _forms({**pid, **scaled}, end, units.get(f"K_p{end}", ""), shown or time)
        if spans is not None:
            found += _in_percent(found, spans[0] / spans[1], end)
    return tuple(found)


def _pids(settings: Mapping[str, Any]) -> Sequence[Mapping[str, Any]]:
    """Return the settings of the PIDs; () of other controllers, such as somebody's own of this name."""
    kind = settings.get("controller")
    pids = [settings] if kind == "PID" else settings.get("pids", []) if kind == "Decentralized" else []
    try:
        for pid in pids:
            PID.of_data({name: pid[name] for name in _NEEDED})
    except (KeyError, TypeError, SettingsError):
        return ()
    return list(pids)


def _time(value: float | None) -> float:
    return inf if value is None else value  # None in plain data, for no integral action


def _with_time(gain: str, time: str) -> tuple[str, str]:
    """Return the units of a gain per time and times time, such as %/(°C min) and % min/°C."""
    above, slash, below = gain.partition("/")
    if slash and time and not set("/( ") & set(below):
        return f"{above}/({below} {time})", f"{above} {time}/{below}"
    return f"{gain or '1'}/{time}", f"({gain}) {time}" if slash else f"{gain} {time}".strip()


def _forms(pid: Mapping[str, Any], end: str, gain: str, time: str) -> Iterator[PIDParameter]:
    K_p, T_i, T_d, N = (pid[name] for name in ("K_p", "T_i", "T_d", "N"))
    per_time, times = _with_time(gain, time)
    T_f, minutes = T_d / N, conversion(time, "min")
    yield PIDParameter(BOTH, f"K_p{end}", K_p, gain)
    yield PIDParameter(ISA, f"T_i{end}", T_i, time)
    if minutes is not None:
        rate = 1 / (T_i * minutes.factor)
        yield PIDParameter(ISA, f"1/T_i{end} (repeats per minute)", rate, "1/min", "1/T_i")
    yield PIDParameter(ISA, f"T_d{end}", T_d, time)
    yield PIDParameter(PARALLEL, f"K_i{end}", K_p / T_i, per_time, "K_p/T_i")
    yield PIDParameter(PARALLEL, f"K_d{end}", K_p * T_d, times, "K_p T_d")
    K, lag, lead = _series(K_p, T_i, T_d, T_f)
    none = NO_SERIES if K != K else ""
    yield PIDParameter(SERIES, f"K_p′{end}", K, gain, none or "K_p T_i′/T_i")
    yield PIDParameter(SERIES, f"T_i′{end}", lag, time, none or "T_i′ + T_d′ = T_i + T_f")
    yield PIDParameter(SERIES, f"T_d′{end}", lead, time, none or "T_i′ T_d′ = T_i (T_d + T_f)")
    yield PIDParameter(ALL, f"T_f{end} (filter of the derivative)", T_f, time, "T_d/N")
    if isfinite(T_i):
        stated, rule = pid.get("T_t"), "√(T_i T_d)" if 25 * T_d >= T_i else "T_i"
        tracking = tracking_time(T_i, T_d) if stated is None else stated
        name = f"T_t{end} (tracking time of the anti-windup)"
        yield PIDParameter(ALL, name, tracking, time, rule if stated is None else "")
    yield PIDParameter(BOTH, f"b{end} (set-point weight of K_p)", pid["b"], "")
    yield PIDParameter(BOTH, f"c{end} (set-point weight of T_d)", pid["c"], "")
    yield PIDParameter(ALL, f"T_s{end} (sampling time)", pid["T_s"], time)


def _series(K: float, T_i: float, T_d: float, T_f: float) -> tuple[float, float, float]:
    """Return K', T_i' and T_d' with the same zeros, poles and gain, filter included; NaN if there are none.

    K (1 + 1/(T_i s) + T_d s/(1 + T_f s)) = K' (1 + 1/(T_i' s)) (1 + T_d' s)/(1 + T_f s).
    """
    if T_i == inf:
        return K, inf, T_d + T_f
    total = T_i + T_f
    inner = 1 - 4 * (T_i / total) * ((T_d + T_f) / total)
    if inner < 0:
        return nan, nan, nan
    lag = total * (1 + sqrt(inner)) / 2
    return K * (lag / T_i), lag, T_i / lag * (T_d + T_f)


def _in_percent(found: Sequence[PIDParameter], ratio: float, end: str) -> Iterator[PIDParameter]:
    """Yield gain and band in percent of the ISA form, and of the series form if there is one."""
    gains = {p.name: p.value for p in found}
    for sign in ("", "′"):
        K = gains[f"K_p{sign}{end}"] * ratio
        if K == K:
            band = 100 / abs(K) if K else inf
            yield PIDParameter(PERCENT, f"K{sign}{end}", K, "%/%", f"K_p{sign} range of y / range of u")
            yield PIDParameter(PERCENT, f"PB{sign}{end} (proportional band)", band, "%", f"100 %/|K{sign}|")
