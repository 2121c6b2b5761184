"""The tables and keys of a described scenario, and how they are checked."""

from collections.abc import Mapping
from math import inf
from typing import Any, Literal

import msgspec

from prefcal_env import described
from prefcal_env.described import Table
from prefcal_env.errors import ScenarioError
from prefcal_env.wording import did_you_mean

Signals = dict[str, dict[str, Any]]


class SignalTable(msgspec.Struct, frozen=True):
    """One recorded column of a rig."""

    unit: str = ""
    low: float = -inf
    high: float = inf
    band: float | None = None
    sensor: tuple[float, float] | None = None


class RigTable(msgspec.Struct, frozen=True):
    """A plant that only a person can run."""

    outputs: Signals
    inputs: Signals = {}
    instructions: str = ""
    time_unit: str = "s"
    max_gap: float | None = None
    max_rows: int | None = None
    headings: dict[str, str] = {}
    time_format: str | None = None


class Description(msgspec.Struct, frozen=True, kw_only=True):
    """A scenario as plain data.

    Exactly one of `fmu`, `controller`, `rig` and `opcua` says what is calibrated.
    """

    name: str = ""
    title: str = ""
    brief: str = ""
    simulated: bool | None = None
    fmu: str | None = None
    controller: str | None = None
    plant: str | dict[str, Any] | None = None
    rig: dict[str, Any] | None = None
    opcua: dict[str, Any] | None = None
    knobs: dict[str, str | dict[str, Any]] = {}
    show: list[str] = []
    reference: dict[str, float] = {}
    stop_time: float | None = None
    timeout: float | None = None
    kpis: dict[str, float | str | dict[str, Any]] | Literal["none"] | None = None
    panels: dict[str, dict[str, Any]] = {}
    starts: dict[str, dict[str, float]] = {}


def checked(values: Mapping[str, Any], table: type[Table], where: str) -> Table:
    """Return `values` as a `table`.

    Args:
        values: Plain data by key.
        table: Keys that are known, and their types.
        where: Place in the file, for messages.

    Raises:
        ScenarioError: If a key is unknown or missing, or a value has the wrong type.
    """
    return described.checked(values, table, where, ScenarioError, did_you_mean)


def stated(values: Mapping[str, Any], table: type, where: str, *, partial: bool = True) -> dict[str, Any]:
    """Return what a file says about a `table` with a name, which is no key; see `checked`."""
    return described.entries(
        values, (table,), where, ScenarioError, did_you_mean, known=("name",), partial=partial
    )
