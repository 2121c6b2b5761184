"""The tables and keys of a live rig's description, and their types."""

from typing import Any, Literal

import msgspec

Range = tuple[float, float]
Entries = dict[str, dict[str, Any]]


class KnobTable(msgspec.Struct, frozen=True):
    """A knob on the plant: see `LiveKnob` and `prefcal_env.Knob`; "log" is short for "log10"."""

    node: str
    low: float
    high: float
    rate: float
    unit: str = ""
    scale: Literal["linear", "log", "log10"] = "linear"
    integer: bool = False
    step: float | None = None
    about: str = ""


class TagTable(msgspec.Struct, frozen=True):
    """A recorded output or input: see `Tag`."""

    node: str
    unit: str = ""
    low: float = float("-inf")
    high: float = float("inf")
    abort: Range = (float("-inf"), float("inf"))


class ReferenceTable(msgspec.Struct, frozen=True):
    """A recorded reference: see `Tag`."""

    node: str
    unit: str = ""


class StartTable(msgspec.Struct, frozen=True):
    """A value that starts a run: see `LiveStart`."""

    node: str
    value: float
    low: float
    high: float
    rate: float
    unit: str = ""
    integer: bool = False


class LiveTable(msgspec.Struct, frozen=True, kw_only=True):
    """A live rig as plain data; None stands for the default of `LiveRig` or `OPCUAPlant`."""

    url: str
    duration: float
    knobs: Entries
    outputs: Entries
    inputs: Entries = {}
    references: Entries = {}
    start: Entries = {}
    ready: dict[str, Range] = {}
    done: dict[str, Range] = {}
    period: float | None = None
    ready_within: float | None = None
    hold: float | None = None
    blind: float | None = None
    after: Literal["restore", "keep"] | None = None
    journal: str | None = None
    instructions: str | None = None
    user: str | None = None
    password_variable: str | None = None
    security: str | None = None
    timeout: float | None = None
