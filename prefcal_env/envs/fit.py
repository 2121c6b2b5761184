"""Check that a plant fits a task, and derive the properties of the combination."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import PlantError, SettingsError
from prefcal_env.experiments.experiment import Channel, Channels
from prefcal_env.plants.jacobians import U, X
from prefcal_env.plants.plant import Plant

from .task import Task

_PARTS = ("f", "g", "hold", "states", "inputs", "outputs", "disturbances")
"""What an environment needs of a plant."""


def channels_of(plant: Plant, task: Task) -> Channels:
    """Return the plant's channels; a constant reference becomes the target of its output."""
    outputs = list(plant.outputs)
    if not callable(task.y_ref):
        for i in tracked_of(task):
            band = (task.bands or {}).get(i)
            outputs[i] = replace(outputs[i], target=float(task.reference(0.0)[i]), band=band)
    return Channels(plant.states, plant.inputs, tuple(outputs), plant.time_unit)


def tracked_of(task: Task) -> tuple[int, ...]:
    """Return the indices of tracked outputs: by default, all outputs with a reference."""
    if task.tracked is not None:
        return task.tracked
    return tuple(map(int, np.flatnonzero(np.isfinite(task.reference(0.0)))))


def observed_of(plant: Plant, task: Task) -> Float[np.ndarray, "n 2"]:
    """Return the lowest and highest value of each observed quantity, shape (n, 2), as in `Task`.

    A channel without a limit extends ten times the distance between its start and its reference,
    or its start and 0; ten units if these are all 0.
    """
    if task.observed is not None:
        return task.observed
    reference, d = task.reference(0.0), task.disturbance(0.0)
    aims = {
        (channel.name, channel.unit): reference[i]
        for i, channel in enumerate(plant.outputs)
        if i in tracked_of(task)
    }
    rows = [
        _reach(channel, start, aims.get((channel.name, channel.unit), start))
        for channel, start in zip(plant.states, task.x0, strict=True)
    ]
    rows += [_reach(c, start, start) for c, start in zip(plant.inputs, task.u0, strict=True)]
    rows += [_reach(plant.outputs[i], reference[i], 0.0) for i in tracked_of(task)]
    rows += [_reach(c, start, start) for c, start in zip(plant.disturbances, d, strict=True)]
    return np.array(rows, dtype=float)


def _reach(channel: Channel, start: float, aim: float) -> tuple[float, float]:
    """Return the limits of a channel, with a guess for each missing one."""
    reach = 10 * max(abs(start), abs(aim - start)) or 10.0
    low = channel.low if np.isfinite(channel.low) else min(start, channel.high) - reach
    high = channel.high if np.isfinite(channel.high) else max(start, channel.low) + reach
    return low, high


def check_fit(plant: Plant, task: Task) -> None:
    """Raise SettingsError if shapes, ranges or limits of plant and task do not fit."""
    if not isinstance(task, Task) or not all(hasattr(plant, part) for part in _PARTS):
        raise SettingsError(f"needs a plant and a Task, got {plant!r:.60} and {task!r:.60}")
    n_x, n_u, n_y, n_d = map(len, (plant.states, plant.inputs, plant.outputs, plant.disturbances))
    tracked = tracked_of(task)
    n_o = n_x + n_u + len(tracked) + n_d
    values: dict[str, tuple[np.ndarray, tuple[int, ...]]] = {
        "x0": (task.x0, (n_x,)),
        "u0": (task.u0, (n_u,)),
        "y_ref": (task.reference(0.0), (n_y,)),
        "d": (task.disturbance(0.0), (n_d,)),
    }
    if task.observed is not None:
        values["observed"] = (task.observed, (n_o, 2))
    for name, (value, shape) in values.items():
        if value.shape != shape:
            raise SettingsError(
                f"task: {name} must have shape {shape} for plant {plant.name!r}, got {value.shape}"
            )
    if task.noise is not None and (task.noise.shape != (n_y,) or np.any(task.noise < 0)):
        raise SettingsError(f"task: noise must be {n_y} standard deviations of 0 or more, got {task.noise}")
    if np.shape(task.measurement_delay) not in ((), (n_y,)):
        raise SettingsError(
            f"task: measurement_delay must be one number or {n_y}, got {task.measurement_delay}"
        )
    if any(not 0 <= i < n_y or np.isnan(task.reference(0.0)[i]) for i in tracked):
        raise SettingsError(
            f"task: tracked must be outputs 0 to {n_y - 1} that have a reference, got {tracked}"
        )
    if task.max_move is not None and (task.max_move.shape != (n_u,) or np.any(task.max_move <= 0)):
        raise SettingsError(f"task: max_move must be {n_u} positive numbers, got {task.max_move}")


def check_limits(plant: Plant) -> None:
    """Raise SettingsError if an input has no limits, which actions are scaled by."""
    for i, channel in enumerate(plant.inputs):
        if not np.isfinite([channel.low, channel.high]).all():
            raise SettingsError(
                f"input {i} ({channel.name!r}) needs finite limits to scale actions by, "
                f"got [{channel.low}, {channel.high}] {channel.unit}".rstrip()
            )


def check_rate(plant: Plant, x: X, u: U, d: Float[np.ndarray, "*n_d"]) -> None:
    """Raise PlantError if f is NaN at the start of an experiment, which no θ can mend.

    Anything else that is not finite is data: an unstable run that blows up.
    """
    now = d if d.ndim == 1 else d[0]
    with np.errstate(all="ignore"):
        rate = plant.f(x, u, now)
    if not np.isnan(rate).any() or not np.isfinite([*x, *u, *now]).all():
        return
    which = [channel.name for channel, v in zip(plant.states, rate, strict=True) if np.isnan(v)]
    at = "".join(f", {name} = {v.tolist()}" for name, v in (("u", u), ("d", now)) if len(v))
    raise PlantError(
        f"plant {plant.name!r}: f must be finite at the start of an experiment, got NaN for "
        f"{which} at x = {x.tolist()}{at}"
    )
