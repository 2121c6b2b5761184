"""Find a steady state of a plant, near the middle of the range of its inputs."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares, root

from prefcal_env.errors import PlantError, ScenarioError
from prefcal_env.experiments.experiment import Channel
from prefcal_env.plants.plant import Plant
from prefcal_env.plants.systems.linear import motion

_STEADY = 1e-7
"""Largest movement in the time constant of the plant, relative to the size of the states."""
_DOUBLINGS = 60
_STEPS, _PRECISE = 10, 1e-12
"""Largest number of Newton steps, and the size of the last one, relative to the states."""


X = Float[np.ndarray, " n_x"]


@dataclass(frozen=True, slots=True, eq=False)
class OperatingPoint:
    """A steady state: states (n_x,), inputs (n_u,) and measured disturbances (n_d,)."""

    x: X
    u: Float[np.ndarray, " n_u"]
    d: Float[np.ndarray, " n_d"]


def operating_point(plant: Plant) -> OperatingPoint:
    """Return a steady state of `plant`, at the middle of its inputs' ranges if possible.

    If the plant has `x0`, the search starts there; otherwise in the middle of the states' limits,
    at 0 and at 1. A steady state to which the plant settles by itself comes first. If there is
    none for these inputs, as for a tank that integrates its flows, the inputs may move.

    Raises:
        ScenarioError: If there is no steady state within the limits.
    """
    held = Held(plant, _middles(plant.inputs), _middles(plant.disturbances))
    guesses = list(_guesses(plant))
    for find in (held.rest, held.settled, held.root):
        for guess in guesses:
            x = find(guess)
            if x is not None and _inside(plant, x):
                return OperatingPoint(x, held.u, held.d)
    for guess in guesses:
        found = _joint(held, guess)
        if found is not None and _inside(plant, found.x):
            return found
    raise ScenarioError(
        f"no steady state of plant {plant.name!r} was found within the limits of its states and "
        "inputs: widen the limits, or give the plant an x0 near one"
    )


@dataclass(frozen=True, slots=True, eq=False)
class Held:
    """A plant with inputs u and disturbances d held; its methods look for a state of rest."""

    plant: Plant
    u: Float[np.ndarray, " n_u"]
    d: Float[np.ndarray, " n_d"]

    def settled(self, x: X) -> X | None:
        """Return the state to which the plant settles from x, shape (n_x,); None if it does not."""
        rates = self._rates(x)
        if rates is None:
            return None
        T = 1 / max(float(rates.max(initial=0.0)), 1e-9)
        now = x
        for _ in range(_DOUBLINGS):
            try:
                now = self.plant.hold(now, self.u, self.d, np.array([T]))[-1]
            except (ArithmeticError, ValueError, PlantError):
                return None
            if not np.isfinite(now).all() or _size(now) > 1e9 * (1 + _size(x)):
                return None
            if self.rest(now) is not None:
                better = self._polished(now)
                near = better is not None and np.allclose(better, now, rtol=1e-3, atol=1e-6)
                return better if near else now
            T *= 1.5
        return None

    def rest(self, x: X) -> X | None:
        """Return x if the plant rests there: it hardly moves within its slowest time constant."""
        f, rates = self._motion(x)[0], self._rates(x)
        if rates is None or not np.isfinite(f).all():
            return None
        moving = rates[rates > 1e-9 * max(float(rates.max(initial=0.0)), 1e-300)]
        slowest = float(moving.min()) if len(moving) else 1.0
        size = np.abs(x).max(initial=1.0)
        return x if np.abs(f).max(initial=0.0) <= _STEADY * slowest * size else None

    def root(self, x: X) -> X | None:
        """Return a solution of f(x, u, d) = 0 for x near the given one, or None."""
        try:
            with np.errstate(all="ignore"):
                return self.rest(np.asarray(root(self._motion, x, jac=True).x, dtype=float))
        except (ArithmeticError, ValueError):
            return None

    def _polished(self, x: X) -> X | None:
        """Return the steady state beside x by Newton's method, which needs no scipy, or None."""
        now = x
        for _ in range(_STEPS):
            try:
                step = np.linalg.solve(*self._motion(now)[::-1])
            except np.linalg.LinAlgError:  # an integrator
                break
            now = now - step
            if not _size(step) > _PRECISE * _size(now):
                return self.rest(now) if np.isfinite(now).all() else None
        return self.root(x)

    def _motion(self, x: X) -> tuple[X, Float[np.ndarray, "n_x n_x"]]:
        return motion(self.plant, x, self.u, self.d)

    def _rates(self, x: X) -> X | None:
        """Return the magnitude of the eigenvalues at a point; None if f is not finite there."""
        try:
            A = self._motion(x)[1]
        except (ArithmeticError, ValueError):
            return None
        return np.abs(np.linalg.eigvals(A)) if np.isfinite(A).all() else None


def _joint(held: Held, x: X) -> OperatingPoint | None:
    """Return a solution of f(x, u, d) = 0 near x and u, within their limits, or None."""
    plant, d, n = held.plant, held.d, len(x)
    low, high = _limits((*plant.states, *plant.inputs))
    start = np.clip(np.concatenate([x, held.u]), low, high)
    try:
        with np.errstate(all="ignore"):
            found = least_squares(
                lambda v: motion(plant, v[:n], v[n:], d)[0],
                start,
                bounds=(low, high),
                xtol=1e-14,
                ftol=1e-14,
                gtol=1e-14,
            )
    except (ArithmeticError, ValueError):
        return None
    point = OperatingPoint(found.x[:n], found.x[n:], d)
    return None if Held(plant, point.u, d).rest(point.x) is None else point


def _size(x: X) -> float:
    """Return the largest magnitude in x, shape (n_x,); 0 for a plant without states."""
    return float(np.abs(x).max(initial=0.0))


def _limits(channels: tuple[Channel, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Return the lower and upper limits, each shape (n,)."""
    return np.array([c.low for c in channels]), np.array([c.high for c in channels])


def _middles(channels: tuple[Channel, ...]) -> Float[np.ndarray, " n"]:
    """Return the middle of each range; without one, what is in it and nearest to 0."""
    low, high = _limits(channels)
    whole = np.isfinite(low) & np.isfinite(high)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.where(whole, (low + high) / 2, np.clip(0.0, low, high)))


def _guesses(plant: Plant) -> Iterator[X]:
    start = getattr(plant, "x0", None)
    if start is not None and np.shape(start) == (len(plant.states),):
        yield np.array(start, dtype=float)
    yield _middles(plant.states)
    for value in (0.0, 1.0):
        yield np.clip(np.full(len(plant.states), value), *_limits(plant.states))


def _inside(plant: Plant, x: X) -> bool:
    (low, high), margin = _limits(plant.states), 1e-9 * (1 + np.abs(x))
    return bool(np.all((low - margin <= x) & (x <= high + margin)))
