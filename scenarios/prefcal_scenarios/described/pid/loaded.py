"""A plant with limited inputs and a load disturbance that adds to each of them."""

from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.experiments.experiment import Channel
from prefcal_env.plants.plant import Jacobians, Plant

X = Float[np.ndarray, " n_x"]
U = Float[np.ndarray, " n_u"]
D = Float[np.ndarray, " n_d"]


class Loaded:
    """A `Plant` with ẋ = f(x, u + w, d), y = g(x, u + w, d); w follows the disturbances d.

    The input's limits hold for u alone: w is what acts on the plant beside the actuator. Dead times
    and the sample time of the plant are kept; w has no dead time.

    Args:
        plant: Plant without load.
        inputs: Its inputs, with finite limits.
    """

    def __init__(self, plant: Plant, inputs: tuple[Channel, ...]) -> None:
        self.plant, self.inputs, self._n_d = plant, inputs, len(plant.disturbances)
        self.name, self.time_unit = plant.name, plant.time_unit
        self.states, self.outputs = plant.states, plant.outputs
        loads = tuple(Channel(f"load on {c.name}", c.unit) for c in inputs)
        self.disturbances = (*plant.disturbances, *loads)
        self.input_delay = getattr(plant, "input_delay", ())
        self.output_delay = getattr(plant, "output_delay", ())
        self.entry_delay = getattr(plant, "entry_delay", ())
        self.sample_time = getattr(plant, "sample_time", 0.0)
        self.has_named_states = getattr(plant, "has_named_states", True)

    def f(self, x: X, u: U, d: D) -> X:
        """Return the state derivative, per `time_unit`."""
        return self.plant.f(x, *self._acting(u, d))

    def g(self, x: X, u: U, d: D) -> Float[np.ndarray, " n_y"]:
        """Return the controlled outputs."""
        return self.plant.g(x, *self._acting(u, d))

    def entries(self, x: X, u: U, d: D) -> Float[np.ndarray, "n_y n"]:
        """Return what each input and its load add to the outputs, if the plant can tell."""
        found: np.ndarray = self.plant.entries(x, *self._acting(u, d))  # type: ignore[attr-defined]
        return found

    def jacobians(self, x: X, u: U, d: D) -> Jacobians:
        """Return the derivatives with respect to x and u."""
        return self.plant.jacobians(x, *self._acting(u, d))

    def hold(self, x: X, u: U, d: D, times: Float[np.ndarray, " K"]) -> Float[np.ndarray, "K n_x"]:
        """Return the states at `times`, with u, w and d held."""
        return self.plant.hold(x, *self._acting(u, d), times)

    def _acting(self, u: U, d: D) -> tuple[Any, Any]:
        return u + d[self._n_d :], d[: self._n_d]
