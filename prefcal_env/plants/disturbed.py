"""A plant with constant disturbances of its outputs and inputs: loads, known or to be estimated."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import SettingsError
from prefcal_env.experiments.experiment import Channel

from .equations import Equations, equations_of
from .jacobians import D, Jacobians, States, Times, U, X, Y
from .plant import Plant

_OPTIONAL = ("input_delay", "output_delay", "entry_delay", "sample_time", "has_named_states")
"""What a plant may have beside the attributes of `Plant`; these disturbances have no dead time."""


class Disturbed:
    """A `Plant` with ẋ = f(x, u + w, d), y = g(x, u + w, d) + p.

    (p, w) are measured disturbances and follow d. The limits of the inputs hold for u alone: w is
    what acts beside the actuator. An MPC that uses this plant as its model and an estimate of
    (p, w) needs no shifted references or limits: its y is that of the real plant.

    Args:
        plant: Plant without these disturbances.
        on_outputs: Indices of the outputs with a disturbance p, in the output's unit.
        on_inputs: Indices of the inputs with a disturbance w, in the input's unit.
        inputs: The inputs with other limits; None for those of the plant.

    Raises:
        SettingsError: If an index is not valid or appears twice.
    """

    def __init__(
        self,
        plant: Plant,
        on_outputs: Sequence[int] = (),
        on_inputs: Sequence[int] = (),
        inputs: tuple[Channel, ...] | None = None,
    ) -> None:
        self.plant, self.name, self.time_unit = plant, plant.name, plant.time_unit
        self.on_y = _selection("on_outputs", on_outputs, len(plant.outputs))
        self.on_u = _selection("on_inputs", on_inputs, len(plant.inputs))
        self.inputs = plant.inputs if inputs is None else inputs
        self.states, self.outputs = plant.states, plant.outputs
        chosen = [plant.outputs[i] for i in on_outputs] + [plant.inputs[i] for i in on_inputs]
        self.offsets = tuple(Channel(f"disturbance of {c.name}", c.unit) for c in chosen)
        self.disturbances = (*plant.disturbances, *self.offsets)
        self._on = np.array(on_outputs, np.int64), np.array(on_inputs, np.int64)
        for name in _OPTIONAL:
            if hasattr(plant, name):
                setattr(self, name, getattr(plant, name))

    @cached_property
    def equations(self) -> Equations:
        """Equations of the plant with these disturbances, for compiled functions."""
        on_outputs, on_inputs = self._on
        return replace(equations_of(self.plant), on_outputs=on_outputs, on_inputs=on_inputs)

    def __getstate__(self) -> dict[str, Any]:
        # Addresses mean nothing in another process.
        return {name: value for name, value in self.__dict__.items() if name != "equations"}

    def around(self, plant: Plant, inputs: tuple[Channel, ...]) -> "Disturbed":
        """Return the same disturbances of another plant with the same channels, with other limits."""
        on_outputs, on_inputs = (chosen.tolist() for chosen in self._on)
        return Disturbed(plant, on_outputs, on_inputs, inputs)

    def f(self, x: X, u: U, d: D) -> X:
        """Return the state derivative, per `time_unit`."""
        return self.plant.f(x, *self._acting(u, d))

    def g(self, x: X, u: U, d: D) -> Y:
        """Return the outputs as they are measured."""
        n_d, n_p = len(self.plant.disturbances), self.on_y.shape[1]
        y = self.plant.g(x, *self._acting(u, d))
        return np.asarray(y + self.on_y @ d[n_d : n_d + n_p]) if n_p else y

    def entries(self, x: X, u: U, d: D) -> Float[np.ndarray, "n_y n"]:
        """Return what each input and its load add to the outputs, if the plant can tell."""
        found: np.ndarray = self.plant.entries(x, *self._acting(u, d))  # type: ignore[attr-defined]
        return found

    def jacobians(self, x: X, u: U, d: D) -> Jacobians:
        """Return the derivatives with respect to x and u."""
        return self.plant.jacobians(x, *self._acting(u, d))

    def hold(self, x: X, u: U, d: D, times: Times) -> States:
        """Return the states at `times`, with all inputs and disturbances held."""
        return self.plant.hold(x, *self._acting(u, d), times)

    def _acting(self, u: U, d: D) -> tuple[Any, Any]:
        """Return the inputs and the disturbances that act on the plant."""
        n_d = len(self.plant.disturbances)
        return u + self.on_u @ d[n_d + self.on_y.shape[1] :], d[:n_d]


def _selection(name: str, chosen: Sequence[int], n: int) -> Float[np.ndarray, "n k"]:
    if len(set(chosen)) < len(chosen) or not set(chosen) <= set(range(n)):
        raise SettingsError(f"{name} must be different indices below {n}, got {tuple(chosen)}")
    return np.eye(n)[:, list(chosen)]
