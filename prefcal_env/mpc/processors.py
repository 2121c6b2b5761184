"""Fit processors to measurements, and read and write them as JSON files."""

import json
from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from prefcal_env.errors import SettingsError

from .computation import Processor, StepSize

FORMAT = 1
"""Format of the files, stored under the key "prefcal processor"."""
FEWEST_SIZES = 3
"""Number of problem sizes a fit needs to separate fixed costs from those that grow with size."""
_SCALE = np.array([1e-4, 1e-6, 1e-9, 1e-10])  # gives the columns of the fit similar sizes
_FREE = 1e-18  # seconds per operation if the fit finds that it takes no time: keeps rates finite


class TimedStep(NamedTuple):
    """One MPC step with its measured time.

    Args:
        size: Size of its problem.
        iterations: Number of solver iterations.
        seconds: Duration of the step.
    """

    size: StepSize
    iterations: int
    seconds: float


def fit_processor(name: str, steps: Sequence[TimedStep]) -> Processor:
    """Fit the four coefficients of a `Processor` to measured steps.

    Uses non-negative least squares of the relative error: a short step counts as much as a long
    one.

    Args:
        name: Name of the processor.
        steps: Steps with `FEWEST_SIZES` or more problem sizes.

    Raises:
        SettingsError: If there are too few problem sizes, or a time is not positive and finite.
    """
    from scipy.optimize import nnls  # imported here because it is slow to import and rarely used

    sizes = {step.size for step in steps}
    if len(sizes) < FEWEST_SIZES:
        raise SettingsError(
            f"processor {name!r} needs steps of {FEWEST_SIZES} or more problem sizes "
            f"(N_p and N_u), got {len(sizes)}"
        )
    seconds = np.array([step.seconds for step in steps])
    if not (np.isfinite(seconds).all() and (seconds > 0).all()):
        raise SettingsError(f"processor {name!r}: every step must take a positive, finite time")
    rows = [(1.0, s.iterations, s.size.building, s.iterations * s.size.iterating) for s in steps]
    # Measure in units of the shortest step, so that the fit does not depend on the clock's speed.
    unit = float(seconds.min()) / _SCALE[0]
    columns = np.array(rows) * _SCALE * unit / seconds[:, None]
    solution, _ = nnls(columns, np.ones(len(rows)))
    step, iteration, building, solving = (solution * _SCALE * unit).tolist()
    return Processor(name, step, iteration, 1 / max(building, _FREE), 1 / max(solving, _FREE))


def fit_error(processor: Processor, steps: Sequence[TimedStep]) -> tuple[float, float]:
    """Return the 5 and 95 % quantiles of measured time / modeled time; 1 is a perfect fit."""
    model = [processor.t_comp(s.size, np.array([s.iterations]))[0] for s in steps]
    ratios = np.array([s.seconds for s in steps]) / np.array(model)
    low, high = np.quantile(ratios, (0.05, 0.95))
    return float(low), float(high)


def write_processor(processor: Processor, path: Path | str) -> Path:
    """Write `processor` as a JSON file.

    Raises:
        SettingsError: If the file cannot be written.
    """
    text = json.dumps(as_dict(processor), indent=2, ensure_ascii=False) + "\n"
    try:
        Path(path).write_text(text, "utf-8")
    except OSError as error:
        raise SettingsError(f"cannot write {path}: {error.strerror or error}") from error
    return Path(path)


def read_processor(path: Path | str) -> Processor:
    """Read a processor that `write_processor` wrote.

    Raises:
        SettingsError: If there is no such file, or it does not hold a processor; the message says
            what is wrong.
    """
    try:
        content = json.loads(Path(path).read_text("utf-8"))
    except OSError as error:
        raise SettingsError(f"cannot read {path}: {error.strerror or error}") from error
    except ValueError as error:  # includes bytes that cannot be decoded
        raise SettingsError(f"{path} must be a JSON file: {error}") from error
    return processor_of(content, str(path))


def as_dict(processor: Processor) -> dict[str, Any]:
    """Return `processor` as plain data, for JSON."""
    return {"prefcal processor": FORMAT, **asdict(processor)}


def processor_of(content: Any, source: str) -> Processor:
    """Read the data that `as_dict` returns; errors name `source`.

    Raises:
        SettingsError: If the data is not that of a processor.
    """
    if not isinstance(content, dict) or content.get("prefcal processor") != FORMAT:
        raise SettingsError(
            f'{source} must be a processor (a JSON object with "prefcal processor": {FORMAT}, as '
            "`prefcal processor measure` writes it)"
        )
    given = {k: v for k, v in content.items() if k != "prefcal processor"}
    names = {f.name for f in fields(Processor)}
    if set(given) != names:
        raise SettingsError(
            f"{source} must have exactly the keys {', '.join(sorted(names))}, "
            f"got {', '.join(sorted(given)) or 'none'}"
        )
    if not isinstance(given["name"], str):
        raise SettingsError(f"{source}: name must be a string, got {given['name']!r}")
    numbers = {k: v for k, v in given.items() if k != "name"}
    for key, value in numbers.items():
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise SettingsError(f"{source}: {key} must be a number, got {value!r}")
    return Processor(given["name"], **{k: float(v) for k, v in numbers.items()})
