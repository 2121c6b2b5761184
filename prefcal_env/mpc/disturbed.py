"""A plant with constant disturbances of its outputs and inputs, known or to be estimated."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import SettingsError
from prefcal_env.experiments.experiment import Channel
from prefcal_env.plants.equations import Equations
from prefcal_env.plants.plant import Jacobians, Plant

X = Float[np.ndarray, " n_x"]
U = Float[np.ndarray, " n_u"]
D = Float[np.ndarray, " n_d"]
Y = Float[np.ndarray, " n_y"]
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
        compiled: Equations | None = getattr(plant, "equations", None)
        self.equations = compiled and replace(
            compiled, on_outputs=np.array(on_outputs, np.int64),
            on_inputs=np.array(on_inputs, np.int64),
        )  # fmt: skip

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

    def hold(self, x: X, u: U, d: D, times: Float[np.ndarray, " K"]) -> Float[np.ndarray, "K n_x"]:
        """Return the states at `times`, with all inputs and disturbances held."""
        d, _, w = self._split(d)
        return self.plant.hold(x, u + self.on_u @ w, d, times)

    def _split(self, d: D) -> tuple[np.ndarray, P, W]:
        n_d, n_p = len(self.plant.disturbances), self.on_y.shape[1]
        return d[:n_d], d[n_d : n_d + n_p], d[n_d + n_p :]


class Augmented:
    """A `Plant` whose disturbances (p, w) are additional constant states, after x.

    An estimator uses it to estimate both the state and the disturbances of a `Disturbed` plant.
    """

    def __init__(self, disturbed: Disturbed) -> None:
        plant = self.disturbed = disturbed
        self.name, self.time_unit = f"{plant.name}, augmented", plant.time_unit
        self.states = (*plant.states, *plant.offsets)
        self.inputs, self.outputs = plant.inputs, plant.outputs
        self.disturbances = plant.plant.disturbances

    def f(self, x: X, u: U, d: D) -> X:
        """Return the state derivative, per `time_unit`; 0 for the disturbances."""
        x, offsets = self.split(x)
        rate = self.disturbed.f(x, u, np.concatenate([d, offsets]))
        return np.concatenate([rate, np.zeros(len(offsets))])

    def g(self, x: X, u: U, d: D) -> Y:
        """Return the outputs as they are measured."""
        x, offsets = self.split(x)
        return self.disturbed.g(x, u, np.concatenate([d, offsets]))

    def jacobians(self, x: X, u: U, d: D) -> Jacobians:
        """Return the exact derivatives; those with respect to p and w are part of A and C."""
        x, offsets = self.split(x)
        J = self.disturbed.jacobians(x, u, np.concatenate([d, offsets]))
        n_x, n_o = len(x), len(offsets)
        on_y, on_u = self.disturbed.on_y, self.disturbed.on_u
        A = np.zeros((n_x + n_o, n_x + n_o))
        A[:n_x, :n_x], A[:n_x, n_x + on_y.shape[1] :] = J.A, J.B @ on_u
        B = np.concatenate([J.B, np.zeros((n_o, J.B.shape[1]))])
        return Jacobians(A, B, np.concatenate([J.C, on_y, J.D @ on_u], axis=1), J.D)

    def hold(self, x: X, u: U, d: D, times: Float[np.ndarray, " K"]) -> Float[np.ndarray, "K n_x"]:
        """Return states and disturbances at `times`."""
        x, offsets = self.split(x)
        states = self.disturbed.hold(x, u, np.concatenate([d, offsets]), times)
        return np.concatenate([states, np.tile(offsets, (len(times), 1))], axis=1)

    def split(self, x: X) -> tuple[np.ndarray, np.ndarray]:
        """Return the plant's state and the disturbances (p, w)."""
        n_x = len(self.disturbed.states)
        return x[:n_x], x[n_x:]


def _selection(name: str, chosen: Sequence[int], n: int) -> Float[np.ndarray, "n k"]:
    if len(set(chosen)) < len(chosen) or not set(chosen) <= set(range(n)):
        raise SettingsError(f"{name} must be different indices below {n}, got {tuple(chosen)}")
    return np.eye(n)[:, list(chosen)]
