"""Whether a plant and a task fit each other, and what they are together."""

from dataclasses import replace

import numpy as np

from prefcal_env.envs.task import Task
from prefcal_env.errors import SettingsError
from prefcal_env.experiment import Channels
from prefcal_env.plants.plant import Plant


def channels_of(plant: Plant, task: Task) -> Channels:
    """The plant's channels; a constant reference becomes the target of its output."""
    outputs = list(plant.outputs)
    if not callable(task.y_ref):
        for i in task.tracked:
            band = (task.bands or {}).get(i)
            outputs[i] = replace(outputs[i], target=float(task.reference(0.0)[i]), band=band)
    return Channels(plant.states, plant.inputs, tuple(outputs), plant.time_unit)


def check_fit(plant: Plant, task: Task) -> None:
    """Raise SettingsError where shapes, ranges or limits of the two do not fit each other."""
    for i, channel in enumerate(plant.inputs):
        if not np.isfinite([channel.low, channel.high]).all():
            raise SettingsError(
                f"input {i} ({channel.name!r}) needs finite limits to scale actions by, "
                f"got [{channel.low}, {channel.high}] {channel.unit}".rstrip()
            )
    n_x, n_u, n_y, n_d = map(len, (plant.states, plant.inputs, plant.outputs, plant.disturbances))
    n_o = n_x + n_u + len(task.tracked) + n_d
    values = {
        "x0": (task.x0, (n_x,)),
        "u0": (task.u0, (n_u,)),
        "y_ref": (task.reference(0.0), (n_y,)),
        "d": (task.disturbance(0.0), (n_d,)),
        "observed": (task.observed, (n_o, 2)),
    }
    for name, (value, shape) in values.items():
        if value.shape != shape:
            raise SettingsError(
                f"task: {name} must have shape {shape} for plant {plant.name!r}, got {value.shape}"
            )
    if any(not 0 <= i < n_y for i in task.tracked):
        raise SettingsError(f"task: tracked must be outputs 0 to {n_y - 1}, got {task.tracked}")
    if task.max_move is not None and (task.max_move.shape != (n_u,) or np.any(task.max_move <= 0)):
        raise SettingsError(f"task: max_move must be {n_u} positive numbers, got {task.max_move}")
