"""Read cycle counts of an embedded target from a CSV file."""

import csv
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from prefcal_env.envs.overtake.road.rules import Phase
from prefcal_env.errors import SettingsError
from prefcal_env.mpc import control_horizon
from prefcal_env.mpc.computation import StepSize
from prefcal_env.mpc.processors import TimedStep
from prefcal_env.plants.bicycle import Bicycle

from .controller import SPACE, mpc_settings

PHASES: Mapping[str, Phase] = {p.name.lower().replace("_", " "): p for p in Phase}
_NEEDED = ("phase", "N_p", "iterations", "cycles")
_HORIZON = SPACE.knobs[SPACE.names.index("N_p")]


def read_cycles(path: Path | str, clock_mhz: float) -> list[TimedStep]:
    """Read the steps of a target: one row each, in any order.

    Columns: `phase` ("lane keeping" or "overtaking"), `N_p`, then `N_u` or the knob `ε_c` (also
    written eps_c), `iterations` of the solver, and `cycles` of the whole step.

    Args:
        path: A CSV file with a header.
        clock_mhz: Clock rate of the target [MHz].

    Raises:
        SettingsError: If the clock rate is not positive, the file does not exist, a column is
            missing, or a value is not valid; the message names the line.
    """
    if not 0 < clock_mhz < float("inf"):
        raise SettingsError(f"--clock-mhz must be positive and finite, got {clock_mhz} MHz")
    try:
        text = Path(path).read_text("utf-8-sig")
    except OSError as error:
        raise SettingsError(f"cannot read {path}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise SettingsError(f"{path} must be a CSV file in UTF-8: {error}") from error
    reader = csv.DictReader(text.splitlines(), skipinitialspace=True)
    columns = [(name or "").strip() for name in reader.fieldnames or ()]
    reader.fieldnames = ["ε_c" if name == "eps_c" else name for name in columns]
    _check_columns(reader.fieldnames, path)
    steps = [_step(row, f"{path}, line {reader.line_num}", clock_mhz) for row in reader]
    if not steps:
        raise SettingsError(f"{path} must have a row for each timed step, got none")
    return steps


def _check_columns(names: list[str], path: Path | str) -> None:
    missing = [name for name in _NEEDED if name not in names]
    if not {"N_u", "ε_c"} & set(names):
        missing.append("N_u (or ε_c)")
    if missing:
        raise SettingsError(
            f"{path} must have the columns {', '.join(_NEEDED)} and N_u or ε_c; "
            f"missing: {', '.join(missing)}"
        )


def _step(row: Mapping[str, str | None], where: str, clock_mhz: float) -> TimedStep:
    phase = PHASES.get((row["phase"] or "").strip())
    if phase is None:
        raise SettingsError(
            f"{where}: phase must be one of {', '.join(PHASES)}, got {row['phase']!r}"
        )
    N_p = int(_number(row, "N_p", where, _HORIZON.low, _HORIZON.high, whole=True))
    if (row.get("N_u") or "").strip():
        N_u = int(_number(row, "N_u", where, 1, N_p, whole=True))
    else:
        N_u = control_horizon(_number(row, "ε_c", where, 0.1, 1.0), N_p)
    iterations = int(_number(row, "iterations", where, 0, 1e6, whole=True))
    cycles = _number(row, "cycles", where, 1, 1e18)
    return TimedStep(_size(phase, N_p, N_u), iterations, cycles / (clock_mhz * 1e6))


def _size(phase: Phase, N_p: int, N_u: int) -> StepSize:
    """Return the size of the car's problem in `phase` with these horizons."""
    settings = mpc_settings(SPACE.decode(np.full(len(SPACE), 0.5)), phase)
    return StepSize.of(Bicycle(), replace(settings, N_p=N_p, N_u=N_u))


def _number(
    row: Mapping[str, str | None], name: str, where: str, low: float, high: float,
    whole: bool = False,
) -> float:  # fmt: skip
    text = (row.get(name) or "").strip()
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not low <= value <= high or (whole and value != round(value)):
        kind = "a whole number" if whole else "a number"
        raise SettingsError(f"{where}: {name} must be {kind} in [{low:g}, {high:g}], got {text!r}")
    return value
