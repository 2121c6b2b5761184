"""What a scenario may be called: those that come with prefcal, and people's own."""

import re
from collections.abc import Iterable, Mapping

from prefcal_env.optional import ENDINGS, WORLDS

CASES = ("cstr", "overtake")  # names of the paper's case studies
CLOSED_LOOPS = (
    "lag",
    "integrating",
    "oscillatory",
    "unstable",
    "tank",
    "quadruple-tank",
    "distillation",
    "building",
    "servo",
    "cart-pole",
    "boost-converter",
    "steering",
    "mpc-oscillatory",
    "mpc-quadruple-tank",
    "mpc-boost-converter",
)
"""Names of the closed loops of `prefcal_scenarios.cases.loops`."""
BUILT_IN = (*CASES, *CLOSED_LOOPS)
NAMES = ", ".join([*CASES, "a closed loop such as servo"])
"""What a scenario may be called, for messages: the closed loops are too many to list."""
CONTROLLERS: Mapping[str, str] = {"pid": "PID", "lqr": "LQR"}
"""Standard controllers that `prefcal calibrate NAME --plant model.py:plant` tunes, and their classes.

A new one is `described/NAME_scenario.py` and a row here: a function NAME_scenario, called as
`pid_scenario` is, and, unless `prefcal_env.controllers` has it, the class, decorated as `storable`.
"""
OWN = ("path/to/own.py:NAME", "tank.toml", *(world.file for world in WORLDS if world.file))
"""What people's own scenarios may be called, for messages, beside standard controllers."""
TABLES = (".csv", ".tsv", ".txt", ".parquet", ".xlsx", ".xls", ".xlsb", ".ods")
"""Endings of tables of runs, among which `prefcal choose` lets people choose."""
KEPT_PLANT = ".plant.json"
"""Ending of the file beside the record of a step test that keeps what was identified."""
_RANDOM_LOOP = re.compile(r"(loop|rough)-(0|[1-9]\d*)", re.ASCII)


def either(words: Iterable[str]) -> str:
    """Return the words as a choice: "a, b or c"."""
    *others, last = words
    return f"{', '.join(others)} or {last}" if others else last


def is_built_in(source: str) -> bool:
    """Return whether the scenario is built in, with or without a configuration."""
    name = source.partition("{")[0].strip()
    return name in BUILT_IN or is_random_loop(name)


def is_random_loop(name: str) -> bool:
    """Return whether this is the name of a random closed loop, such as "loop-17" or "rough-17"."""
    return _RANDOM_LOOP.fullmatch(name) is not None


def is_own(source: str) -> bool:
    """Return whether the scenario is a user's own, configured or not.

    It is path/to/own.py:attribute, or described by plain data (see `is_described`).
    """
    name = source.partition("{")[0].strip()
    return (is_described(name) and not is_table(name)) or name.rpartition(":")[0].endswith(".py")


def is_table(source: str) -> bool:
    """Return whether a scenario is a table of runs or the storage of an Optuna study: no code is run."""
    name = source.partition("{")[0].strip()
    return name.lower().endswith(TABLES) or "://" in name


def is_described(source: str) -> bool:
    """Return whether a scenario is described by plain data.

    It is a TOML file, a file of an optional world, a table of runs, or a standard controller such as
    "pid", configured or not.
    """
    name = source.partition("{")[0].strip()
    return name in CONTROLLERS or name.endswith((".toml", *ENDINGS)) or is_table(name)
