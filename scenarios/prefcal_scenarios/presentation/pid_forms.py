"""Give a PID in the forms in which control systems ask for it."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import inf
from typing import Any

from prefcal_env.knobs.space import KnobSpace


@dataclass(frozen=True, slots=True)
class Parameter:
    """Parameter of a PID in one form."""

    form: str  # forms that have it
    name: str  # symbol
    value: float  # value; an infinite integral time is no integral action
    unit: str  # unit of the value
    derived: str = ""  # how it follows from parameters of the ISA form; empty if it is one of them


ISA, PARALLEL, BOTH = "ISA (standard)", "parallel", "both"
"""Forms: K_p (e + 1/T_i ∫e dt + T_d de/dt), and K_p e + K_i ∫e dt + K_d de/dt."""


def pid_forms(settings: Mapping[str, Any], space: KnobSpace, time_unit: str) -> tuple[Parameter, ...]:
    """Return the parameters of the PIDs that `settings` describe, ISA and parallel; () for others.

    Args:
        settings: Settings of the controller, as `prefcal_env.controllers` describes it.
        space: Knobs of the study; the unit of K_p is that of the knob of this name.
        time_unit: Unit of time.
    """
    kind = settings.get("controller")
    pids = [settings] if kind == "PID" else settings["pids"] if kind == "Decentralized" else []
    units = {knob.name: knob.unit for knob in space}
    found: list[Parameter] = []
    for number, pid in enumerate(pids, start=1):
        end = f"_{number}" if len(pids) > 1 else ""
        found += _forms(pid, end, units.get(f"K_p{end}", ""), time_unit)
    return tuple(found)


def _forms(pid: Mapping[str, Any], end: str, gain: str, time: str) -> Iterator[Parameter]:
    K_p, T_d, N = pid["K_p"], pid["T_d"], pid["N"]
    T_i = inf if pid["T_i"] is None else pid["T_i"]  # None in plain data, for no integral action
    plain = gain or "1"
    yield Parameter(BOTH, f"K_p{end}", K_p, gain)
    yield Parameter(ISA, f"T_i{end}", T_i, time)
    yield Parameter(ISA, f"T_d{end}", T_d, time)
    yield Parameter(PARALLEL, f"K_i{end}", K_p / T_i, f"{plain}/{time}", "K_p/T_i")
    yield Parameter(PARALLEL, f"K_d{end}", K_p * T_d, f"{gain} {time}".strip(), "K_p T_d")
    yield Parameter(BOTH, f"T_f{end} (filter of the derivative)", T_d / N, time, "T_d/N")
    yield Parameter(BOTH, f"b{end} (set-point weight of K_p)", pid["b"], "")
    yield Parameter(BOTH, f"c{end} (set-point weight of T_d)", pid["c"], "")
    yield Parameter(BOTH, f"T_s{end} (sampling time)", pid["T_s"], time)
