"""A plant defined by its equations only."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import PlantError
from prefcal_env.experiments.experiment import Channel

from .derivative import derivative
from .integrate import integrate
from .plant import Jacobians

Equation = Callable[[Any, Any, Any], Any]
"""Function of (x, u, d), each an array, that returns an array or a sequence of numbers."""


class FunctionPlant:
    """A `Plant` with ẋ = f(x, u, d), y = g(x, u, d) and measured disturbances d.

    The Jacobians are computed from f and g (see `derivative`): exact to rounding where these are
    analytic. Where f overflows or divides by zero, the derivative is NaN, so that the experiment
    ends there instead of raising.

    Args:
        f: State derivative per `time_unit`, n_x numbers.
        g: Controlled outputs, n_y numbers; None means y = x.
        states: The n_x states, in the order of x.
        inputs: The n_u inputs, with the limits of the actuators.
        outputs: The n_y outputs; required if and only if `g` is given.
        disturbances: The n_d measured disturbances.
        name: Name of the plant, as shown to people.
        time_unit: Unit of time.
        max_step: Largest step of the integrator (Runge-Kutta of order 4), in `time_unit`.

    Raises:
        PlantError: If there is no state or no input, only one of `g` and `outputs` is given, or
            the step is not positive; when called, if an equation returns the wrong number of
            values.
    """

    def __init__(
        self,
        f: Equation,
        g: Equation | None = None,
        *,
        states: Sequence[Channel],
        inputs: Sequence[Channel],
        outputs: Sequence[Channel] = (),
        disturbances: Sequence[Channel] = (),
        name: str = "plant",
        time_unit: str = "s",
        max_step: float = 0.01,
    ) -> None:
        if not states or not inputs:
            raise PlantError("a plant needs at least one state and one input")
        if (g is None) != (not outputs):
            raise PlantError("a plant needs both g and its outputs, or neither: then y = x")
        if not 0 < max_step < np.inf:
            raise PlantError(f"max_step must be positive and finite, got {max_step}")
        self.name, self.time_unit, self.max_step = name, time_unit, max_step
        self.states, self.inputs = tuple(states), tuple(inputs)
        self.outputs = tuple(outputs) if g is not None else self.states
        self.disturbances = tuple(disturbances)
        self._f, self._g = f, g

    def f(
        self,
        x: Float[np.ndarray, " n_x"],
        u: Float[np.ndarray, " n_u"],
        d: Float[np.ndarray, " n_d"],
    ) -> Float[np.ndarray, " n_x"]:
        """Return the state derivative, per `time_unit`."""
        return np.asarray(self._values("f", x, u, d), dtype=float)

    def g(
        self,
        x: Float[np.ndarray, " n_x"],
        u: Float[np.ndarray, " n_u"],
        d: Float[np.ndarray, " n_d"],
    ) -> Float[np.ndarray, " n_y"]:
        """Return the controlled outputs."""
        return np.asarray(self._values("g", x, u, d), dtype=float)

    def jacobians(
        self,
        x: Float[np.ndarray, " n_x"],
        u: Float[np.ndarray, " n_u"],
        d: Float[np.ndarray, " n_d"],
    ) -> Jacobians:
        """Return the derivatives of f and g at one point."""
        n_x = len(self.states)
        point = np.concatenate([x, u])
        AB = derivative(lambda p: self._values("f", p[:n_x], p[n_x:], d), point)
        CD = derivative(lambda p: self._values("g", p[:n_x], p[n_x:], d), point)
        return Jacobians(AB[:, :n_x], AB[:, n_x:], CD[:, :n_x], CD[:, n_x:])

    def hold(
        self,
        x: Float[np.ndarray, " n_x"],
        u: Float[np.ndarray, " n_u"],
        d: Float[np.ndarray, " n_d"],
        times: Float[np.ndarray, " K"],
    ) -> Float[np.ndarray, "K n_x"]:
        """Return the states at `times` after x, with u and d held; NaN once they blow up."""
        with np.errstate(all="ignore"):
            return integrate(self._f_or_nan, x, u, d, times, self.max_step)

    def _f_or_nan(self, x: Any, u: Any, d: Any) -> Float[np.ndarray, " n_x"]:
        try:
            return self.f(x, u, d)
        except ArithmeticError:
            return np.full(len(self.states), np.nan)

    def _values(self, name: str, x: Any, u: Any, d: Any) -> Any:
        """Return the result of f or g as a float or complex array of the right shape."""
        if name == "g" and self._g is None:
            return np.array(x)
        equation, channels = (self._f, self.states) if name == "f" else (self._g, self.outputs)
        values = np.asarray(equation(x, u, d))  # type: ignore[misc]
        if values.shape != (len(channels),):
            raise PlantError(
                f"{name} of plant {self.name!r} must return {len(channels)} values, "
                f"{[c.name for c in channels]}, got shape {values.shape}"
            )
        return values
