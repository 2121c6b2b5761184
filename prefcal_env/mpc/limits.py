"""Limits of eq. MPC_constraints: inputs and moves are hard, outputs soft with one slack."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import SettingsError
from prefcal_env.plants.plant import Plant

from .model import Prediction
from .settings import MPCSettings

Rows = tuple[np.ndarray, np.ndarray, np.ndarray]
"""G (m, n), low (m,) and high (m,) of low <= G z <= high."""

_LARGEST_TRUSTED_GROWTH = 1e9


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

    def rows(
        self,
        of_inputs: Rows,
        model: Prediction,
        U: Float[np.ndarray, "N_u n_u n_v1"],
        X: Float[np.ndarray, "N n_x n_v1"],
        unit: float,
    ) -> Rows:
        """Return the inputs' rows low <= G z <= high and, for limited outputs, their soft rows.

        y_min - ε <= y_k <= y_max + ε for k = 1 ... N_p, and ε >= 0. The slack variable is
        √Q_ε ε / `unit`, so that its weight is 1 like that of a deviation.

        Use the soft rows only if `trusted` returns True.
        """
        if not self.soft:
            return of_inputs
        G, low, high = of_inputs
        n_v = G.shape[1]
        steps = len(X) - 1
        C, D = (M if len(M) == 1 else M[1 : steps + 1] for M in (model.C, model.D))
        Y = C @ X[1:]  # (steps, n_y, n_v + 1)
        if D.any():
            Y += D @ U[np.minimum(np.arange(1, steps + 1), len(U) - 1)]
        Y[:, :, n_v] += model.e[1 : steps + 1]
        give = self.softness * unit / np.sqrt(self.Q_eps)
        n_rows = len(G) + steps * int(np.isfinite([self.y_max, self.y_min]).sum()) + 1
        matrix = np.zeros((n_rows, n_v + 1))
        lows, highs = np.full(n_rows, -np.inf), np.full(n_rows, np.inf)
        r = len(G)
        matrix[:r, :n_v], lows[:r], highs[:r] = G, low, high
        for bound, sign in ((self.y_max, 1.0), (self.y_min, -1.0)):
            limited = np.flatnonzero(np.isfinite(bound))
            rows = sign * Y[:, limited].reshape(-1, n_v + 1)
            end = r + len(rows)
            matrix[r:end, :n_v], matrix[r:end, n_v] = rows[:, :n_v], np.tile(-give[limited], steps)
            highs[r:end] = np.tile(sign * bound[limited], steps) - rows[:, n_v]
            r = end
        matrix[r, n_v], lows[r] = 1.0, 0.0  # ε >= 0
        return matrix, lows, highs

    def trusted(self, X: Float[np.ndarray, "N n_x n_v1"]) -> bool:
        """Return whether the soft rows contain more than rounding errors.

        If the inputs are held for long, an unstable model grows until only the growing mode is
        left in an output's row. Rows of the inputs do not have this problem: their feedback is
        stable.
        """
        if not self.soft:
            return True
        growth = float(np.abs(X).max()) / max(1.0, float(np.abs(X[1]).max()))
        return growth < _LARGEST_TRUSTED_GROWTH


def _vector(name: str, value: object, n: int, default: float) -> Float[np.ndarray, " n"]:
    vector = np.full(n, default) if value is None else np.array(value, dtype=float)
    if vector.shape != (n,) or np.isnan(vector).any():
        raise SettingsError(f"{name} must have shape ({n},) and no NaN, got {value!r}")
    return vector
