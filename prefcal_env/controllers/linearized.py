"""A plant linearized at a steady state, as plain numbers: the model of LQR and LQG."""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.arrays import vector
from prefcal_env.errors import SettingsError
from prefcal_env.plants.plant import Plant

_RESTS = 1e-6
"""Largest movement in one sampling period, relative to the size of the state, that is rest."""


@dataclass(frozen=True, slots=True, eq=False)
class Linearized:
    """A model ẋ = A (x - x0) + B (u - u0), y = y0 + C (x - x0) + D (u - u0), with input limits.

    Args:
        A: Dynamics, per unit of time, shape (n_x, n_x).
        B: Effect of the inputs, shape (n_x, n_u).
        C: Outputs from states, shape (n_y, n_x).
        D: Outputs from inputs, shape (n_y, n_u).
        x0: State at rest, shape (n_x,).
        u0: Input at rest, shape (n_u,).
        y0: Output at rest, shape (n_y,).
        low: Lower limits of the inputs, shape (n_u,).
        high: Upper limits of the inputs, shape (n_u,).

    Raises:
        SettingsError: If the shapes do not fit each other, or a number but a limit is not finite.
    """

    A: Float[np.ndarray, "n_x n_x"]
    B: Float[np.ndarray, "n_x n_u"]
    C: Float[np.ndarray, "n_y n_x"]
    D: Float[np.ndarray, "n_y n_u"]
    x0: Float[np.ndarray, " n_x"]
    u0: Float[np.ndarray, " n_u"]
    y0: Float[np.ndarray, " n_y"]
    low: Float[np.ndarray, " n_u"]
    high: Float[np.ndarray, " n_u"]

    def __post_init__(self) -> None:
        n_x, n_u, n_y = np.size(self.x0), np.size(self.u0), np.size(self.y0)
        shapes = {
            "A": (n_x, n_x),
            "B": (n_x, n_u),
            "C": (n_y, n_x),
            "D": (n_y, n_u),
            "x0": (n_x,),
            "u0": (n_u,),
            "y0": (n_y,),
            "low": (n_u,),
            "high": (n_u,),
        }
        for field in fields(self):
            name = field.name
            array = np.array(getattr(self, name), dtype=float)
            if array.shape != shapes[name]:
                raise SettingsError(f"{name} must have shape {shapes[name]}, got {array.shape}")
            limit = name in ("low", "high")
            if np.isnan(array).any() or (not limit and np.isinf(array).any()):
                raise SettingsError(f"{name} must be finite, got {array.tolist()}")
            array.setflags(write=False)
            object.__setattr__(self, name, array)


def linearized(plant: Plant, x0: Any, u0: Any, d0: Any, T_s: float) -> Linearized:
    """Return the model of `plant` at a steady state; None means zeros.

    Args:
        plant: Plant; its dead time is left out.
        x0: State at rest, shape (n_x,).
        u0: Input at rest, shape (n_u,).
        d0: Measured disturbances at rest, shape (n_d,).
        T_s: Time within which the plant must hardly move, in its unit of time.

    Raises:
        SettingsError: If the plant does not rest there.
    """
    x, u, d = (
        vector(name, np.zeros(len(channels)) if value is None else value, len(channels), "finite")
        for name, value, channels in (
            ("x0", x0, plant.states),
            ("u0", u0, plant.inputs),
            ("d0", d0, plant.disturbances),
        )
    )
    rate = np.asarray(plant.f(x, u, d), dtype=float)
    if not np.abs(rate).max(initial=0.0) * T_s <= _RESTS * (1 + np.abs(x).max(initial=0.0)):
        raise SettingsError(
            f"plant {plant.name!r} does not rest at x0={x.tolist()}, u0={u.tolist()}: its state "
            f"changes by {rate.tolist()} per {plant.time_unit}; give a steady state"
        )
    J = plant.jacobians(x, u, d)
    low, high = (np.array([getattr(c, k) for c in plant.inputs]) for k in ("low", "high"))
    return Linearized(J.A, J.B, J.C, J.D, x, u, np.asarray(plant.g(x, u, d)), low, high)
