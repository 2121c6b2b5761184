"""A plant defined by its equations only."""

import sys
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import PlantError
from prefcal_env.experiments.experiment import Channel
from prefcal_env.optional import world_of

from .jacobians import D, ExactEquation, Jacobians, States, Times, U, X, Y, derivative
from .plant import Equations, equations_of, integrate
from .systems import Numbers, plant_numbers

Equation = Callable[[Any, Any, Any], Any]
"""Function of (x, u, d), each an array, that returns an array or a sequence of numbers."""


class FunctionPlant:
    """A `Plant` with ẋ = f(x, u, d), y = g(x, u, d) and measured disturbances d.

    The Jacobians are computed from f and g (see `derivative`): exact to rounding where these are
    analytic. Where f overflows or divides by zero, the derivative is NaN, so that the experiment
    ends there instead of raising.

    f and g may be CasADi Functions of (x, u) or (x, u, d), whose Jacobians CasADi derives. If f,
    and g if given, are compiled by `numba.njit`, the simulation and the MPC never wait for Python:
    a period takes 7 to 30 µs instead of 40 to 1,400. They must return an array, or a tuple of
    floats.

    Args:
        f: State derivative per `time_unit`, n_x numbers.
        g: Controlled outputs, n_y numbers; None means y = x.
        states: The n_x states, in the order of x.
        inputs: The n_u inputs, with the limits of the actuators.
        outputs: The n_y outputs; required if and only if `g` is given.
        disturbances: The n_d measured disturbances.
        name: Name of the plant, as shown to people.
        time_unit: Unit of time.
        delay: Dead time between input and plant, one number or one for each input, in `time_unit`.
            The environment applies it (`PlantEnv`).
        x0: State at the start of an `LTILoop`, and where the search for a steady state begins,
            shape (n_x,) or one number; None for 0, and for a search that begins anywhere.
        u0: Input before the start, shape (n_u,) or one number; None for 0.
        max_step: Largest step of the integrator, in `time_unit`; None means that only the error
            counts. Set it if f is so different in a short range that a step could miss it.

    Raises:
        PlantError: If there is no state or no input, only one of `g` and `outputs` is given,
            the step is not positive, a dead time is negative, x0 or u0 does not fit, or the inputs
            of a CasADi Function have other sizes; when called, if an equation returns the wrong
            number of values.
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
        delay: float | Sequence[float] = 0.0,
        x0: Numbers | None = None,
        u0: Numbers | None = None,
        max_step: float | None = None,
    ) -> None:
        if not states or not inputs:
            raise PlantError("a plant needs at least one state and one input")
        if (g is None) != (not outputs):
            raise PlantError("a plant needs both g and its outputs, or neither: then y = x")
        if max_step is not None and not 0 < max_step < np.inf:
            raise PlantError(f"max_step must be positive and finite, got {max_step}")
        self.name, self.time_unit, self.max_step = name, time_unit, max_step
        self.states, self.inputs = tuple(states), tuple(inputs)
        self.outputs = tuple(outputs) if g is not None else self.states
        self.disturbances = tuple(disturbances)
        self.input_delay = tuple(plant_numbers("delay", delay, len(self.inputs)).tolist())
        if min(self.input_delay) < 0:
            raise PlantError(f"delay must be 0 {time_unit} or more, got {self.input_delay}")
        self.x0 = None if x0 is None else plant_numbers("x0", x0, len(self.states))
        self.u0 = None if u0 is None else plant_numbers("u0", u0, len(self.inputs))
        # Once, here: to look for a world at every call would take longer than the equation.
        self._f, self._g = self._adapt(f), self._adapt(g)
        self._equations: Equations | None = None
        self._called_back: Equations | None = None

    def f(self, x: X, u: U, d: D) -> X:
        """Return the state derivative, per `time_unit`; NaN where it overflows."""
        try:
            values = np.asarray(self._f(x, u, d), dtype=float)
        # Python raises where numpy returns infinity or NaN, as in 1.0 / 0.0: both end the run, not the study.
        except ArithmeticError:
            return np.full(len(self.states), np.nan)
        whole = values.shape == (len(self.states),)
        return values if whole else np.asarray(self._values("f", self._f, x, u, d))  # raises

    @property
    def plain(self) -> tuple[Equation, Equation | None]:
        """Return f and g as they were given, whose values nobody has checked."""
        return self._f, self._g

    def g(self, x: X, u: U, d: D) -> Y:
        """Return the controlled outputs."""
        return np.asarray(self._values("g", self._g, x, u, d), dtype=float)

    def jacobians(self, x: X, u: U, d: D) -> Jacobians:
        """Return the derivatives of f and g at one point."""
        n_x = len(self.states)
        AB, CD = self._derivative("f", x, u, d), self._derivative("g", x, u, d)
        return Jacobians(AB[:, :n_x], AB[:, n_x:], CD[:, :n_x], CD[:, n_x:])

    def hold(self, x: X, u: U, d: D, times: Times) -> States:
        """Return the states at `times` after x, with u and d held; NaN once they blow up.

        What a Python f raises, as math.sqrt does outside of its domain, only rejects a step of the
        integrator. It is raised if the states are not finite in the end, except an ArithmeticError.
        """
        step = np.inf if self.max_step is None else self.max_step
        equations = self.callable_equations
        # A step that is too long may overflow; the integrator refuses it, and tries a shorter one.
        with np.errstate(all="ignore"):
            states = integrate(equations, x, u, d, times, step)
        if equations.callbacks is not None:
            equations.callbacks.check(states)
        elif np.isnan(states[:1]).any():
            self.f(x, u, d)  # raises if the number of values is wrong
        return states

    @property
    def equations(self) -> Equations | None:
        """Return the compiled equations, or None if f or g is plain Python."""
        if self._equations is None and "numba" in sys.modules:  # else nobody has compiled f
            from . import _compiled

            if _compiled.all_compiled(self._f, self._g):
                n_x, n_u = len(self.states), len(self.inputs)
                sizes = n_x, n_u, len(self.disturbances), len(self.outputs)
                self._equations = _compiled.equations_of(self._f, self._g, sizes)
        return self._equations

    @property
    def callable_equations(self) -> Equations:
        """Return the compiled equations, or f and g as compiled code calls them back."""
        found = self.equations or self._called_back
        if found is None:
            found = self._called_back = equations_of(self)
        return found

    def __getstate__(self) -> dict[str, Any]:
        """Leave out addresses: they mean nothing in another process."""
        return self.__dict__ | {"_equations": None, "_called_back": None}

    def _derivative(self, name: str, x: Any, u: Any, d: Any) -> Float[np.ndarray, "m n"]:
        """Return the derivative of f or g with respect to (x, u)."""
        equation, n_x = self._f if name == "f" else self._g, len(self.states)
        if isinstance(equation, ExactEquation):
            return equation.jacobian(x, u, d)
        # In plain Python: numba would compile f for complex numbers, or try to, at each point again.
        plain = getattr(equation, "py_func", equation)
        # Not by d: no controller moves a disturbance.
        point = np.concatenate([x, u])
        return derivative(lambda p: self._values(name, plain, p[:n_x], p[n_x:], d), point)

    def _adapt(self, equation: Any) -> Any:
        """Return a function of an optional world as an equation, and anything else unchanged."""
        world = None if isinstance(equation, ExactEquation) else world_of(equation)
        if world is None or not world.equations:
            return equation
        sizes = len(self.states), len(self.inputs), len(self.disturbances)
        return world.inside("prefcal_env").equation(equation, sizes)

    def _values(self, name: str, equation: Equation | None, x: Any, u: Any, d: Any) -> Any:
        """Return the result of an equation, f or g, as a float or complex array of the right shape."""
        if equation is None:
            return np.array(x)
        channels = self.states if name == "f" else self.outputs
        # Of any type: complex steps (see `derivative`) must pass.
        values = np.asarray(equation(x, u, d))
        if values.shape != (len(channels),):
            raise PlantError(
                f"{name} of plant {self.name!r} must return {len(channels)} values, "
                f"{[c.name for c in channels]}, got shape {values.shape}"
            )
        return values
