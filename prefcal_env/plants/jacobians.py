"""The arrays that a plant takes and returns, and derivatives of equations given as code."""

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Complex, Float

X = Float[np.ndarray, " n_x"]
U = Float[np.ndarray, " n_u"]
D = Float[np.ndarray, " n_d"]
Y = Float[np.ndarray, " n_y"]
Times = Float[np.ndarray, " K"]
States = Float[np.ndarray, "K n_x"]


@dataclass(frozen=True, slots=True)
class Jacobians:
    """Derivatives of f and g: A = ∂f/∂x, B = ∂f/∂u, C = ∂g/∂x, D = ∂g/∂u."""

    A: Float[np.ndarray, "n_x n_x"]
    B: Float[np.ndarray, "n_x n_u"]
    C: Float[np.ndarray, "n_y n_x"]
    D: Float[np.ndarray, "n_y n_u"]


class ExactEquation:
    """An equation of a plant that knows its exact derivatives: a function of another library."""

    def __call__(self, x: Any, u: Any, d: Any) -> Float[np.ndarray, " m"]:
        """Return the values at one point, shape (m,)."""
        raise NotImplementedError

    def jacobian(self, x: Any, u: Any, d: Any) -> Float[np.ndarray, "m n"]:
        """Return the derivatives with respect to (x, u), shape (m, n_x + n_u)."""
        raise NotImplementedError


Vector = Float[np.ndarray, " n"] | Complex[np.ndarray, " n"]


def derivative(function: Callable[[Vector], Any], point: Float[np.ndarray, " n"]) -> Float[np.ndarray, "m n"]:
    """Return the Jacobian of `function`, from (n,) to (m,), at `point`, shape (m, n).

    The complex step Im f(p + ih)/h has no cancellation and is exact to rounding for analytic
    functions. For others (abs, max, float()) it fails, sometimes silently. If it raises or does
    not agree with central differences, those are returned instead (extrapolated to order 4, with
    an error of about 1e-12 of the scale of the function).
    """
    rough = _differences(function, point)
    exact = _complex_step(function, point)
    if exact is None:
        return rough
    scale = np.abs(rough).max(axis=1, keepdims=True)
    believed = np.all(np.abs(exact - rough) <= 1e-4 * scale + 1e-12)
    return exact if believed else rough


def _complex_step(
    function: Callable[[Vector], Any], point: Float[np.ndarray, " n"]
) -> Float[np.ndarray, "m n"] | None:
    columns, tiny = [], 1e-30  # its square is negligible
    for i in range(len(point)):
        p = point.astype(complex)
        p[i] += 1j * tiny
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error", np.exceptions.ComplexWarning)
                value = np.asarray(function(p))
        except Exception:  # compiled functions have errors of their own
            return None
        columns.append(np.imag(value) / tiny)
    return np.array(columns, dtype=float).T


def _differences(
    function: Callable[[Vector], Any], point: Float[np.ndarray, " n"]
) -> Float[np.ndarray, "m n"]:
    def central(i: int, h: float) -> Float[np.ndarray, " m"]:
        ends = [point.copy(), point.copy()]
        ends[0][i] += h
        ends[1][i] -= h
        ahead, behind = (np.asarray(function(p), dtype=float) for p in ends)
        # Divide by the distance of the rounded points, not of the intended ones.
        return np.asarray((ahead - behind) / (ends[0][i] - ends[1][i]))

    columns = []
    for i in range(len(point)):
        h = 1e-3 * max(abs(point[i]), 1.0)  # the optimum: (machine precision)^(1/5)
        columns.append((4 * central(i, h / 2) - central(i, h)) / 3)  # the h² terms cancel
    return np.array(columns, dtype=float).T
