"""A plant with constant disturbances of its outputs and inputs, known or to be estimated."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import SettingsError
from prefcal_env.experiments.experiment import Channel
from prefcal_env.plants.equations import Equations, equations_of
from prefcal_env.plants.jacobians import D, Jacobians, States, Times, U, X, Y
from prefcal_env.plants.plant import Plant

P = Float[np.ndarray, " n_p"]
W = Float[np.ndarray, " n_w"]


class Disturbed:
    """A `Plant` with ẋ = f(x, u + w, d), y = g(x, u + w, d) + p.

    (p, w) are measured disturbances and follow d. An MPC that uses this plant as its model and an
    estimate of (p, w) needs no shifted references or limits: its y is that of the real plant.

    Args:
        plant: Plant without these disturbances.
        on_outputs: Indices of the outputs with a disturbance p, in the output's unit.
        on_inputs: Indices of the inputs with a disturbance w, in the input's unit.

    Raises:
        SettingsError: If an index is not valid or appears twice.
    """

    def __init__(
        self, plant: Plant, on_outputs: Sequence[int] = (), on_inputs: Sequence[int] = ()
    ) -> None:
        self.plant = plant
        self.on_y = _selection("on_outputs", on_outputs, len(plant.outputs))
        self.on_u = _selection("on_inputs", on_inputs, len(plant.inputs))
        self.name, self.time_unit = f"{plant.name} with disturbances", plant.time_unit
        self.states, self.inputs, self.outputs = plant.states, plant.inputs, plant.outputs
        chosen = [plant.outputs[i] for i in on_outputs] + [plant.inputs[i] for i in on_inputs]
        self.offsets = tuple(Channel(f"disturbance of {c.name}", c.unit) for c in chosen)
        self.disturbances = (*plant.disturbances, *self.offsets)
        self._on = np.array(on_outputs, np.int64), np.array(on_inputs, np.int64)

    @cached_property
    def equations(self) -> Equations:
        """Equations of the plant with these disturbances, for compiled functions."""
        on_outputs, on_inputs = self._on
        return replace(equations_of(self.plant), on_outputs=on_outputs, on_inputs=on_inputs)

    def __getstate__(self) -> dict[str, Any]:
        # Addresses mean nothing in another process.
        return {name: value for name, value in self.__dict__.items() if name != "equations"}

    def f(self, x: X, u: U, d: D) -> X:
        """Return the state derivative, per `time_unit`."""
        d, _, w = self._split(d)
        return self.plant.f(x, u + self.on_u @ w, d)

    def g(self, x: X, u: U, d: D) -> Y:
        """Return the outputs as they are measured."""
        d, p, w = self._split(d)
        return np.asarray(self.plant.g(x, u + self.on_u @ w, d) + self.on_y @ p)

    def jacobians(self, x: X, u: U, d: D) -> Jacobians:
        """Return the derivatives with respect to x and u."""
        d, _, w = self._split(d)
        return self.plant.jacobians(x, u + self.on_u @ w, d)

    def hold(self, x: X, u: U, d: D, times: Times) -> States:
        """Return the states at `times`, with all inputs and disturbances held."""
        d, _, w = self._split(d)
        return self.plant.hold(x, u + self.on_u @ w, d, times)

    def _split(self, d: D) -> tuple[np.ndarray, P, W]:
        n_d, n_p = len(self.plant.disturbances), self.on_y.shape[1]
        return d[:n_d], d[n_d : n_d + n_p], d[n_d + n_p :]


def _selection(name: str, chosen: Sequence[int], n: int) -> Float[np.ndarray, "n k"]:
    if len(set(chosen)) < len(chosen) or not set(chosen) <= set(range(n)):
        raise SettingsError(f"{name} must be different indices below {n}, got {tuple(chosen)}")
    return np.eye(n)[:, list(chosen)]
