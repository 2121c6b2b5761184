"""Limits of eq. MPC_constraints: inputs and moves are hard, outputs soft with one slack."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import SettingsError
from prefcal_env.plants.plant import Plant

from .settings import MPCSettings


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits in the plant's units; infinite for no limit. `soft`: whether outputs are limited."""

    u_min: Float[np.ndarray, " n_u"]
    u_max: Float[np.ndarray, " n_u"]
    du_min: Float[np.ndarray, " n_u"]
    du_max: Float[np.ndarray, " n_u"]
    y_min: Float[np.ndarray, " n_y"]
    y_max: Float[np.ndarray, " n_y"]
    softness: Float[np.ndarray, " n_y"]
    Q_eps: float
    soft: bool = field(init=False)

    def __post_init__(self) -> None:
        soft = np.isfinite(self.y_min).any() or np.isfinite(self.y_max).any()
        object.__setattr__(self, "soft", bool(soft))

    @classmethod
    def of(cls, plant: Plant, settings: MPCSettings) -> "Limits":
        """Return the limits of `settings`; missing limits of inputs are the plant's."""
        s, n_u, n_y = settings, len(plant.inputs), len(plant.outputs)
        low, high = [c.low for c in plant.inputs], [c.high for c in plant.inputs]
        limits = cls(
            u_min=_vector("u_min", low if s.u_min is None else s.u_min, n_u, -np.inf),
            u_max=_vector("u_max", high if s.u_max is None else s.u_max, n_u, np.inf),
            du_min=_vector("du_min", s.du_min, n_u, -np.inf),
            du_max=_vector("du_max", s.du_max, n_u, np.inf),
            y_min=_vector("y_min", s.y_min, n_y, -np.inf),
            y_max=_vector("y_max", s.y_max, n_y, np.inf),
            softness=_vector("softness", s.softness, n_y, 1.0),
            Q_eps=s.Q_eps,
        )
        if np.any(limits.u_min > limits.u_max):
            raise SettingsError(
                "u_min must not be above u_max (the plant's where none is given), "
                f"got {limits.u_min}, {limits.u_max}"
            )
        if np.any(limits.du_min > 0) or np.any(limits.du_max < 0):
            raise SettingsError(
                "du_min must not be above 0 and du_max not below 0 (an input may always be held), "
                f"got {limits.du_min}, {limits.du_max}"
            )
        if np.any(limits.softness < 0):
            raise SettingsError(f"softness must be 0 or more, got {limits.softness}")
        return limits

    @property
    def hard(self) -> tuple[Float[np.ndarray, " n_u"], ...]:
        """Limits of the inputs and of the moves."""
        return self.u_min, self.u_max, self.du_min, self.du_max

    @property
    def give(self) -> tuple[Float[np.ndarray, " n_y"], ...]:
        """Limits of the outputs, and how far each gives way: softness / √Q_ε."""
        return self.y_min, self.y_max, self.softness / np.sqrt(self.Q_eps)


def _vector(name: str, value: object, n: int, default: float) -> Float[np.ndarray, " n"]:
    vector = np.full(n, default) if value is None else np.array(value, dtype=float)
    if vector.shape != (n,) or np.isnan(vector).any():
        raise SettingsError(f"{name} must have shape ({n},) and no NaN, got {value!r}")
    return vector
