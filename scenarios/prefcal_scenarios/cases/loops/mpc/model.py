"""A plant of the family as the model that an MPC predicts with."""

import numpy as np
from jaxtyping import Float

from prefcal_env.experiments.experiment import Channel
from prefcal_env.plants.equations import Equations
from prefcal_env.plants.plant import Jacobians
from prefcal_scenarios.cases.loops._simulate import hold, rhs, slopes
from prefcal_scenarios.cases.loops.course import Course
from prefcal_scenarios.cases.loops.plants import parameters_of

X = Float[np.ndarray, " n_x"]
U = Float[np.ndarray, " n_u"]
D = Float[np.ndarray, " n_d"]


class Model:
    """A `prefcal_env` plant: the loop's plant, undisturbed, with its measured states as outputs.

    The disturbance stays at its value at the start, and the dead time is left out: what the
    controller does not know, its estimator finds out.

    Args:
        course: Loop and its sampling; it determines plant, measured states and limits.
    """

    def __init__(self, course: Course) -> None:
        at = course.at
        self.name, self.time_unit = "model", ""
        self.states = tuple(Channel(f"state {i}") for i in range(len(at.x)))
        self.inputs = tuple(
            Channel(f"input {i}", low=low, high=high) for i, (low, high) in enumerate(at.limits)
        )
        self.outputs = tuple(self.states[i] for i in course.measured)
        self.disturbances: tuple[Channel, ...] = ()
        self._course = course
        self._plant = at.plant.kind, parameters_of(at.plant)
        self._d, self._step = at.d, course.step
        self._C = np.eye(len(at.x))[course.measured]
        self._D = np.zeros((len(self.outputs), len(self.inputs)))

    @property
    def equations(self) -> Equations:
        """Return the compiled equations."""
        from prefcal_scenarios.cases.loops._equations import (
            equations_of,  # compiles them, the first time
        )

        return equations_of(self._course)

    def f(self, x: X, u: U, d: D) -> X:
        """Return the state derivative."""
        return np.asarray(rhs(*self._plant, _own(x), _own(u), self._d))

    def g(self, x: X, u: U, d: D) -> Float[np.ndarray, " n_y"]:
        """Return the measured states."""
        return np.asarray(self._C @ x)

    def jacobians(self, x: X, u: U, d: D) -> Jacobians:
        """Return the derivatives of f, by central differences, and of g."""
        A, B = slopes(*self._plant, _own(x), _own(u), self._d)
        return Jacobians(A, B, self._C, self._D)

    def hold(self, x: X, u: U, d: D, times: Float[np.ndarray, " K"]) -> Float[np.ndarray, "K n_x"]:
        """Return the states at `times`, with the inputs held."""
        return np.asarray(hold(*self._plant, _own(x), _own(u), self._d, times, self._step))


def _own(values: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Return a copy: a read-only array is another type, for which numba compiles again."""
    return np.array(values, dtype=float)
