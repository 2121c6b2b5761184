"""Find a steady state of a plant, near the middle of the range of its inputs."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import PlantError, ScenarioError
from prefcal_env.experiments.experiment import Channel
from prefcal_env.plants.plant import Plant
from prefcal_env.plants.systems.linear import motion

_STEADY = 1e-7
"""Largest movement in the time constant of the plant, relative to the size of the states."""
_DOUBLINGS = 60
_STEPS, _PRECISE = 10, 1e-12
"""Largest number of Newton steps, and the size of the last one, relative to the states."""


@dataclass(frozen=True, slots=True, eq=False)
class OperatingPoint:
    """A steady state: states (n_x,), inputs (n_u,) and measured disturbances (n_d,)."""

    x: Float[np.ndarray, " n_x"]
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
    u, d = _middles(plant.inputs), _middles(plant.disturbances)
    guesses = list(_guesses(plant))
    for find in (_already, settled, _root):
        for guess in guesses:
            x = find(plant, guess, u, d)
            if x is not None and _inside(plant, x):
                return OperatingPoint(x, u, d)
    for guess in guesses:
        found = _joint(plant, guess, u, d)
        if found is not None and _inside(plant, found.x):
            return found
    raise ScenarioError(
        f"no steady state of plant {plant.name!r} was found within the limits of its states and "
        "inputs: widen the limits, or give the plant an x0 near one"
    )


def settled(
    plant: Plant,
    x: Float[np.ndarray, " n_x"],
    u: Float[np.ndarray, " n_u"],
    d: Float[np.ndarray, " n_d"],
) -> Float[np.ndarray, " n_x"] | None:
    """Return the state to which the plant settles from x, shape (n_x,); None if it does not."""
    rates = _rates(plant, x, u, d)
    if rates is None:
        return None
    T = 1 / max(float(rates.max(initial=0.0)), 1e-9)
    now = x
    for _ in range(_DOUBLINGS):
        try:
            now = plant.hold(now, u, d, np.array([T]))[-1]
        except (ArithmeticError, ValueError, PlantError):
            return None
        if not np.isfinite(now).all() or _size(now) > 1e9 * (1 + _size(x)):
            return None
        if _already(plant, now, u, d) is not None:
            better = _polished(plant, now, u, d)
            near = better is not None and np.allclose(better, now, rtol=1e-3, atol=1e-6)
            return better if near else now
        T *= 1.5
    return None


def _size(x: Float[np.ndarray, " n_x"]) -> float:
    """Return the largest magnitude in x, shape (n_x,); 0 for a plant without states."""
    return float(np.abs(x).max(initial=0.0))


def _middles(channels: tuple[Channel, ...]) -> Float[np.ndarray, " n"]:
    def middle(c: Channel) -> float:
        if np.isfinite([c.low, c.high]).all():
            return (c.low + c.high) / 2
        return min(max(0.0, c.low), c.high)

    return np.array([middle(c) for c in channels], dtype=float)


def _guesses(plant: Plant) -> Iterator[Float[np.ndarray, " n_x"]]:
    start = getattr(plant, "x0", None)
    if start is not None and np.shape(start) == (len(plant.states),):
        yield np.array(start, dtype=float)
    yield _middles(plant.states)
    low, high = (np.array([getattr(c, e) for c in plant.states]) for e in ("low", "high"))
    for value in (0.0, 1.0):
        yield np.clip(np.full(len(low), value), low, high)


def _inside(plant: Plant, x: Float[np.ndarray, " n_x"]) -> bool:
    margin = 1e-9 * (1 + np.abs(x))
    return all(
        c.low - e <= v <= c.high + e for c, v, e in zip(plant.states, x, margin, strict=True)
    )


def _rates(
    plant: Plant,
    x: Float[np.ndarray, " n_x"],
    u: Float[np.ndarray, " n_u"],
    d: Float[np.ndarray, " n_d"],
) -> Float[np.ndarray, " n_x"] | None:
    """Return the magnitude of the eigenvalues at a point; None if f is not finite there."""
    try:
        A = motion(plant, x, u, d)[1]
    except (ArithmeticError, ValueError):
        return None
    return np.abs(np.linalg.eigvals(A)) if np.isfinite(A).all() else None


def _already(
    plant: Plant,
    x: Float[np.ndarray, " n_x"],
    u: Float[np.ndarray, " n_u"],
    d: Float[np.ndarray, " n_d"],
) -> Float[np.ndarray, " n_x"] | None:
    """Return x if the plant rests there: it hardly moves within its slowest time constant."""
    f, rates = motion(plant, x, u, d)[0], _rates(plant, x, u, d)
    if rates is None or not np.isfinite(f).all():
        return None
    moving = rates[rates > 1e-9 * max(float(rates.max(initial=0.0)), 1e-300)]
    slowest = float(moving.min()) if len(moving) else 1.0
    size = np.abs(x).max(initial=1.0)
    return x if np.abs(f).max(initial=0.0) <= _STEADY * slowest * size else None


def _polished(
    plant: Plant,
    x: Float[np.ndarray, " n_x"],
    u: Float[np.ndarray, " n_u"],
    d: Float[np.ndarray, " n_d"],
) -> Float[np.ndarray, " n_x"] | None:
    """Return the steady state beside x by Newton's method, which needs no scipy, or None."""
    now = x
    for _ in range(_STEPS):
        f, A = motion(plant, now, u, d)
        try:
            step = np.linalg.solve(A, f)
        except np.linalg.LinAlgError:  # an integrator
            break
        now = now - step
        if not _size(step) > _PRECISE * _size(now):
            return _already(plant, now, u, d) if np.isfinite(now).all() else None
    return _root(plant, x, u, d)


def _root(
    plant: Plant,
    x: Float[np.ndarray, " n_x"],
    u: Float[np.ndarray, " n_u"],
    d: Float[np.ndarray, " n_d"],
) -> Float[np.ndarray, " n_x"] | None:
    """Return a solution of f(x, u, d) = 0 for x near the given one, or None."""
    from scipy.optimize import root

    try:
        with np.errstate(all="ignore"):
            found = root(lambda v: motion(plant, v, u, d), x, jac=True)
            return _already(plant, np.asarray(found.x, dtype=float), u, d)
    except (ArithmeticError, ValueError):
        return None


def _joint(
    plant: Plant,
    x: Float[np.ndarray, " n_x"],
    u: Float[np.ndarray, " n_u"],
    d: Float[np.ndarray, " n_d"],
) -> OperatingPoint | None:
    """Return a solution of f(x, u, d) = 0 near x and u, within their limits, or None."""
    from scipy.optimize import least_squares

    n, channels = len(x), (*plant.states, *plant.inputs)
    start = np.concatenate([x, u])
    low, high = np.array([c.low for c in channels]), np.array([c.high for c in channels])
    start = np.clip(start, low, high)
    try:
        with np.errstate(all="ignore"):
            found = least_squares(
                lambda v: motion(plant, v[:n], v[n:], d)[0], start, bounds=(low, high),
                xtol=1e-14, ftol=1e-14, gtol=1e-14,
            )  # fmt: skip
    except (ArithmeticError, ValueError):
        return None
    point = OperatingPoint(found.x[:n], found.x[n:], d)
    return None if _already(plant, point.x, point.u, d) is None else point
