"""A plant of the loops: parameters with a compiled right-hand side, as a plant of `prefcal_env`."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numba
import numpy as np
from jaxtyping import Float

from prefcal_env.experiments.experiment import Channel
from prefcal_env.jit import inner
from prefcal_env.plants.equations import Equations, compiled
from prefcal_env.plants.jacobians import D, Jacobians, States, Times, U, X, Y

from ._simulate import hold, rhs, slopes
from .right_hand_sides import Parameters, derivative, packed

carray: Any = numba.carray  # type: ignore[attr-defined]
_HEAD = 6
"""Numbers before the indices of the measured states in the parameters of the C functions."""


@dataclass(frozen=True)
class CompiledPlant:
    """A `prefcal_env` plant that is simulated by compiled Runge-Kutta steps of fixed length.

    Its outputs are the measured states; their limits are not those of the states, within which an
    experiment is safe. An MPC that uses the plant as its model leaves the dead time out.
    """

    parameters: Parameters  # kind of plant and its parameters
    states: tuple[Channel, ...]  # states, with the limits of safe operation
    inputs: tuple[Channel, ...]  # inputs, with the limits at which they saturate
    max_step: float  # step of the simulation, in `time_unit`
    measured: tuple[int, ...] = (0,)  # indices of the measured states
    dead_time: float = 0.0  # dead time of the inputs, in `time_unit`
    time_unit: str = "s"  # unit of time
    disturbances: tuple[Channel, ...] = (Channel("disturbance"),)  # what acts beside the inputs

    @property
    def name(self) -> str:
        """Name of the kind of plant."""
        return type(self.parameters).__name__

    @cached_property
    def outputs(self) -> tuple[Channel, ...]:
        """The measured states."""
        return tuple(Channel(self.states[i].name, self.states[i].unit) for i in self.measured)

    @property
    def input_delay(self) -> tuple[float, ...]:
        """Dead time of each input, in `time_unit`."""
        return (self.dead_time,) * len(self.inputs)

    @property
    def equations(self) -> Equations:
        """Return the compiled equations, which are compiled the first time."""
        kind, parameters = self.packed
        channels = self.states, self.inputs, self.disturbances, self.measured
        head = np.array([kind, *map(len, channels), len(parameters)], dtype=float)
        return replace(compile_equations(), parameters=np.concatenate([head, self.measured, parameters]))

    def f(self, x: X, u: U, d: D) -> X:
        """Return the state derivative."""
        return np.asarray(rhs(*self.packed, *_copies(x, u, d)))

    def g(self, x: X, u: U, d: D) -> Y:
        """Return the measured states."""
        return np.asarray(self._C @ x)

    def jacobians(self, x: X, u: U, d: D) -> Jacobians:
        """Return the derivatives of f, by central differences, and of g."""
        A, B = slopes(*self.packed, *_copies(x, u, d))
        return Jacobians(A, B, self._C, np.zeros((len(self.measured), len(self.inputs))))

    def hold(self, x: X, u: U, d: D, times: Times) -> States:
        """Return the states at `times`, with the inputs held."""
        return np.asarray(hold(*self.packed, *_copies(x, u, d), times, self.max_step))

    @cached_property
    def packed(self) -> tuple[int, Float[np.ndarray, " n_p"]]:
        """Number of the kind of plant, and its parameters, shape (n_p,)."""
        return packed(self.parameters)

    @cached_property
    def _C(self) -> Float[np.ndarray, "n_y n_x"]:
        return np.eye(len(self.states))[list(self.measured)]


def compile_equations() -> Equations:
    """Compile the equations that all plants share, and return them without parameters."""
    return compiled(_f, _g, _jacobians, np.zeros(0))


def _copies(x: X, u: U, d: D) -> tuple[X, U, D]:
    """Return writable copies: numba compiles again for read-only arrays, another type."""
    return np.array(x, dtype=float), np.array(u, dtype=float), np.array(d, dtype=float)


@inner()
def _parts(p):  # type: ignore[no-untyped-def]
    """Return the kind, the numbers of x, u and d, the measured states and the parameters."""
    n_y, n_p = int(p[4]), int(p[5])
    numbers = carray(p, (_HEAD + n_y + n_p,))
    return int(p[0]), (int(p[1]), int(p[2]), int(p[3])), numbers[_HEAD : _HEAD + n_y], numbers[_HEAD + n_y :]


def _f(x, u, d, p, out):  # type: ignore[no-untyped-def]
    """Write ẋ."""
    kind, (n_x, n_u, n_d), _, own = _parts(p)
    derivative(kind, own, carray(x, (n_x,)), carray(u, (n_u,)), carray(d, (n_d,)), carray(out, (n_x,)))


def _g(x, u, d, p, out):  # type: ignore[no-untyped-def]
    """Write the measured states."""
    _, _, measured, _ = _parts(p)
    for i in range(len(measured)):
        out[i] = x[int(measured[i])]


def _jacobians(x, u, d, p, out):  # type: ignore[no-untyped-def]
    """Write A and B, by central differences, C and D = 0."""
    kind, (n_x, n_u, n_d), measured, own = _parts(p)
    A, B = slopes(kind, own, carray(x, (n_x,)).copy(), carray(u, (n_u,)).copy(), carray(d, (n_d,)))
    n_A, n_B, n_y = n_x * n_x, n_x * n_u, len(measured)
    for i in range(n_x):
        for j in range(n_x):
            out[i * n_x + j] = A[i, j]
        for j in range(n_u):
            out[n_A + i * n_u + j] = B[i, j]
    for i in range(n_A + n_B, n_A + n_B + n_y * (n_x + n_u)):
        out[i] = 0.0
    for i in range(n_y):
        out[n_A + n_B + i * n_x + int(measured[i])] = 1.0
