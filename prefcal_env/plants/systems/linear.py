"""A linear plant, continuous or discrete, with dead time."""

from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property
from math import isfinite
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env import arrays
from prefcal_env.errors import PlantError
from prefcal_env.experiments.experiment import Channel
from prefcal_env.plants.jacobians import D, Jacobians, States, Times, U, X, Y

from .matrices import LinearSystem, system_of

Named = str | Channel | Sequence[str | Channel]
"""One name or channel, or one for each signal."""
Numbers = float | Sequence[float] | np.ndarray
Delay = Numbers | Sequence[Sequence[float]]
"""One dead time, one for each input, or a row for each output with one for each input."""

_MOST_KEPT = 4096
_DIGITS = 13
"""Significant digits of a duration. Rounding is part of the result, so that no result depends on
what was computed before; it moves an instant by less than a trillionth."""


class LinearPlant:
    """A `Plant` made of a linear system, continuous or discrete, with any number of signals.

    Between two instants its states follow from a matrix exponential, so they are exact. A discrete
    plant keeps its states until its next sample. Dead time of any length is exact, too, but not
    part of x: environments (`PlantEnv`, `LTILoop`) delay the inputs by `input_delay`, the outputs
    by `output_delay`, and what each input adds to each output (`entries`) by `entry_delay`. A
    controller that uses the plant as its model, such as `LinearMPC`, sees it without dead time.

    All values are deviations from the operating point, unless the model says otherwise.

    Args:
        system: StateSpace or TransferFunction of python-control or scipy.signal (`lti`,
            `dlti`), arrays (A, B, C, D) or (A, B, C, D, dt), polynomials (num, den), or a list
            of rows of these. Improper transfer functions are refused.
        states: Names or `Channel`s of the states, in their order.
        inputs: Names or `Channel`s of the inputs; limits of a `Channel` are those of the
            actuator. Without them, the names that python-control knows, else u or u1, u2, ...
        outputs: Names or `Channel`s of the outputs, likewise.
        disturbances: Names or `Channel`s of measured disturbances: the last inputs of `system`
            are these instead of inputs.
        delay: Dead time between input and plant, in `time_unit`: one number, one for each
            input, or a matrix of shape (n_y, n_u) with that from each input to each output. If
            the plant is discrete, multiples of its sample time. A matrix gives each input
            states of its own.
        output_delay: Dead time between plant and output, likewise.
        x0: State at the start of experiments, shape (n_x,) or one number; by default 0. Where a
            matrix of dead times copies states, one for each copy.
        u0: Input before the start of experiments, shape (n_u,) or one number; by default 0.
        name: Name of the plant, as shown to people.
        time_unit: Unit of time of `system`.

    Raises:
        PlantError: If `system` is no such system or is improper, or an argument does not fit.
    """

    def __init__(
        self,
        system: Any,
        *,
        states: Named | None = None,
        inputs: Named | None = None,
        outputs: Named | None = None,
        disturbances: Named = (),
        delay: Delay = 0.0,
        output_delay: Numbers = 0.0,
        x0: Numbers | None = None,
        u0: Numbers | None = None,
        name: str = "plant",
        time_unit: str = "s",
    ) -> None:
        made = system_of(system)
        n_all, n_y = made.sizes[1:]
        n_d = len(_listed(disturbances))
        if n_all <= n_d or n_y == 0:
            raise PlantError(f"a plant needs an input and an output, got D of shape {(n_y, n_all)}")
        shared, entries = _shared(delay, n_y, n_all - n_d)
        before = len(made.A)
        made = made.separated() if entries.any() else made
        n_x, names = len(made.A), made.inputs or None
        self.system, self.name, self.time_unit = made, name, time_unit
        self.has_named_states = states is not None or bool(made.states)
        self.states = _channels("states", states, made.states or None, n_x, "x")
        split = (names[: n_all - n_d], names[n_all - n_d :]) if names else (None, None)
        self.inputs = _channels("inputs", inputs, split[0], n_all - n_d, "u")
        self.outputs = _channels("outputs", outputs, made.outputs or None, n_y, "y")
        self.disturbances = _channels("disturbances", disturbances, split[1], n_d, "d")
        self.x0 = _start(0.0 if x0 is None else x0, before, n_x)
        self.u0 = numbers("u0", 0.0 if u0 is None else u0, n_all - n_d)
        self.input_delay = self._delays("delay", shared, len(self.inputs))
        self.output_delay = self._delays("output_delay", output_delay, n_y)
        late = self._delays("delay", entries.ravel(), entries.size)
        self.entry_delay = tuple(map(tuple, np.reshape(late, entries.shape).tolist()))
        self._kept: dict[float, np.ndarray] = {}
        self._direct = bool(made.D.any())

    @property
    def sample_time(self) -> float:
        """Sample time of a discrete plant, in `time_unit`; 0 if the plant is continuous."""
        return self.system.dt

    def f(self, x: X, u: U, d: D) -> X:
        """Return the state derivative, per `time_unit`.

        Raises:
            PlantError: If the plant is discrete and no continuous one has the same samples.
        """
        A, B = self._rates
        return np.asarray(A @ x + B @ np.concatenate([u, d]))

    def g(self, x: X, u: U, d: D) -> Y:
        """Return the outputs, without dead time."""
        y = self.system.C @ x
        return np.asarray(y + self.system.D @ np.concatenate([u, d]) if self._direct else y)

    def entries(self, x: X, u: U, d: D) -> Float[np.ndarray, "n_y n"]:
        """Return what each input adds to the outputs, and last what no input does, n = n_u + 1."""
        n_u, C, D = len(self.inputs), self.system.C, self.system.D
        found = np.zeros((len(self.outputs), n_u + 1))
        found[:, :n_u] = C @ (x[:, None] * self._owned) + D[:, :n_u] * u
        found[:, n_u] = self.g(x, u, d) - found[:, :n_u].sum(axis=1)
        return found

    def jacobians(self, x: X, u: U, d: D) -> Jacobians:
        """Return A, B, C and D. Raises PlantError as `f` does."""
        A, B = self._rates
        n_u = len(self.inputs)
        return Jacobians(A, B[:, :n_u].copy(), self.system.C, self.system.D[:, :n_u].copy())

    def hold(self, x: X, u: U, d: D, times: Times) -> States:
        """Return the states at `times` after x, with u and d held; NaN once they overflow."""
        start, n_x = np.concatenate([x, u, d]), len(self.states)
        states = np.empty((len(times), n_x))
        with np.errstate(all="ignore"):
            for k, t in enumerate(np.asarray(times).tolist()):
                states[k] = self._propagator(t) @ start
            whole = isfinite(states.sum())  # if not, the sum alone may have overflowed
        if not whole:
            states[~np.isfinite(states).all(axis=1)] = np.nan
        return states

    def scaled(
        self, rates: Float[np.ndarray, " n_x"], gains: Float[np.ndarray, " n_u"], later: float
    ) -> "LinearPlant":
        """Return the same plant with faster states (1 if it is discrete), larger gains and later inputs."""
        made, system, rows = copy(self), self.system, rates[:, None]
        acting = np.append(gains, np.ones(len(self.disturbances)))
        made.system = replace(system, A=system.A * rows, B=system.B * rows * acting, D=system.D * acting)
        made.input_delay = tuple(later * each for each in self.input_delay)
        made._kept = {}
        made.__dict__.pop("_rates", None)
        return made

    def __getstate__(self) -> dict[str, Any]:
        """Leave out what is quickly computed again."""
        return self.__dict__ | {"_kept": {}}

    def _propagator(self, t: float) -> Float[np.ndarray, "n_x n"]:
        """Return the matrix that maps (x, u, d) to the state after `t`."""
        dt = self.system.dt
        key = float(np.floor(t / dt + 1e-6)) if dt else float(f"{t:.{_DIGITS}g}")
        found = self._kept.get(key)
        if found is None:
            if len(self._kept) >= _MOST_KEPT:
                self._kept.clear()
            found = self._kept[key] = np.hstack(self.system.held(key * dt if dt else key))
        return found

    @cached_property
    def _owned(self) -> Float[np.ndarray, "n_x n_u"]:
        """1 for the states that an input drives, else 0."""
        return self.system.owned[:, : len(self.inputs)].astype(float)

    @cached_property
    def _rates(self) -> tuple[Float[np.ndarray, "n_x n_x"], Float[np.ndarray, "n_x n_u"]]:
        """A and B of ẋ, for a discrete plant those of the continuous one with the same samples."""
        if not self.system.dt:
            return self.system.A, self.system.B
        from scipy.linalg import logm

        n_x, n_u, _ = self.system.sizes
        values = np.linalg.eigvals(self.system.A)
        if n_x and np.any((np.abs(values.imag) < 1e-12) & (values.real < 1e-12)):
            raise PlantError(
                f"discrete plant {self.name!r} has a pole at 0 or on the negative axis, so it has "
                "no ẋ = f(x, u): use a controller that needs no continuous model"
            )
        once = np.block([[self.system.A, self.system.B], [np.zeros((n_u, n_x)), np.eye(n_u)]])
        rates = np.real(logm(once)) / self.system.dt
        return rates[:n_x, :n_x], rates[:n_x, n_x:]

    def _delays(self, what: str, value: Numbers, n: int) -> tuple[float, ...]:
        found = numbers(what, value, n)
        if np.any(found < 0):
            raise PlantError(f"{what} must be 0 {self.time_unit} or more, got {found.tolist()}")
        dt = self.system.dt
        if dt and np.any(np.abs(found / dt - np.round(found / dt)) > 1e-6):
            raise PlantError(
                f"{what} of a discrete plant must be a multiple of its sample time {dt:g} "
                f"{self.time_unit}, got {found.tolist()}"
            )
        return tuple(found.tolist())


def local_system(plant: Any, x: X, u: U, d: D) -> LinearSystem:
    """Return the linear system from inputs to outputs that a plant is near a point, no dead time.

    It is discrete if the plant is a discrete `LinearPlant`, so that poles at 0 and on the negative
    axis, which no continuous system has, are kept.

    Raises:
        PlantError: If a derivative is not finite.
    """
    if isinstance(plant, LinearPlant):
        return plant.system.part(range(len(plant.outputs)), range(len(plant.inputs)))
    J = plant.jacobians(x, u, d)
    return LinearSystem(J.A, J.B, J.C, J.D)


def motion(plant: Any, x: X, u: U, d: D) -> tuple[X, Float[np.ndarray, "n_x n_x"]]:
    """Return how fast the states change, per unit of time, and the derivative of that by x.

    For a discrete `LinearPlant` this is the change over a sample, by its sample time.
    """
    if isinstance(plant, LinearPlant) and plant.sample_time:
        dt, A = plant.sample_time, plant.system.A
        after = A @ x + plant.system.B @ np.concatenate([u, d])
        return np.asarray(after - x) / dt, np.asarray(A - np.eye(len(A))) / dt
    return np.asarray(plant.f(x, u, d)), np.asarray(plant.jacobians(x, u, d).A)


def _shared(delay: Any, n_y: int, n_u: int) -> tuple[Any, Float[np.ndarray, "rows n_u"]]:
    """Return the dead time of the inputs, and what is left for each entry, without rows if 0."""
    none = np.zeros((0, n_u))
    if np.ndim(delay) != 2:
        return delay, none
    if np.shape(delay) != (n_y, n_u):
        raise PlantError(
            f"a matrix of dead times must have a row for each of {n_y} outputs and a column for "
            f"each of {n_u} inputs, got shape {np.shape(delay)}"
        )
    matrix = numbers("delay", np.ravel(delay), n_y * n_u).reshape(n_y, n_u)
    shared = matrix.min(axis=0)
    return shared, (matrix - shared if (matrix > shared).any() else none)


def _listed(named: Named | None) -> list[str | Channel]:
    if named is None:
        return []
    return [named] if isinstance(named, str | Channel) else list(named)


def _channels(
    what: str, given: Named | None, names: Sequence[str] | None, n: int, symbol: str
) -> tuple[Channel, ...]:
    """Return one channel for each of `n` signals, by what is given, their names, or numbers."""
    found = _listed(given) or list(names or ())
    if not found:
        found = [symbol] if n == 1 else [f"{symbol}{i + 1}" for i in range(n)]
    if len(found) != n:
        raise PlantError(f"{what}: expected {n} names or channels, got {len(found)}: {found}")
    strangers = [f for f in found if not isinstance(f, str | Channel)]
    if strangers:
        raise PlantError(f"{what} must be names or Channels, got {strangers[0]!r}")
    channels = tuple(f if isinstance(f, Channel) else Channel(f) for f in found)
    twice = {c.name for c in channels if [o.name for o in channels].count(c.name) > 1}
    if twice:
        raise PlantError(f"{what} must have different names, got {sorted(twice)} more than once")
    return tuple(replace(c) for c in channels)


def _start(x0: Numbers, before: int, n: int) -> X:
    """Return the start, shape (n,), of a system that had `before` states until it was copied.

    Raises:
        PlantError: If a number would start each copy, which together would start elsewhere.
    """
    if n > before and np.ndim(x0) == 0 and x0 != 0:
        raise PlantError(
            f"x0 must be 0 or {n} numbers, got {x0!r:.80}: the matrix of dead times gives each "
            f"input its own copy of the {before} states"
        )
    return numbers("x0", x0, n)


def numbers(what: str, value: Any, n: int) -> Float[np.ndarray, " n"]:
    """Return a number or `n` of them, shape (n,). Raises PlantError if they are anything else."""
    array = arrays.numbers(value, what, PlantError)
    if array.ndim == 0:
        array = np.full(n, float(array))
    if array.shape != (n,) or not np.isfinite(array).all():
        raise PlantError(f"{what} must be a finite number or {n} of them, got {value!r:.80}")
    return array
