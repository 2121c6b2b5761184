"""Controllers that people tune: from the values of the knobs to the gains of a compiled law."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from jaxtyping import Float
from scipy.linalg import expm, solve_discrete_are

from . import _laws as laws
from ._simulate import slopes
from .course import Course, Trace, by_law
from .plants import packed

Values = Mapping[str, float]


class Tunable(Protocol):
    """A kind of controller."""

    def drive(self, values: Values, course: Course) -> Trace:
        """Return what the controller does with these values of the knobs, by name.

        Raises:
            LinAlgError: If there is no controller for these values.
        """


_DEFAULTS: Values = {"T_i": np.inf, "T_d": 0.0, "T_f": 0.0, "b": 1.0, "stages": 0, "hysteresis": 0}


@dataclass(frozen=True, slots=True)
class PID:
    """One PID for each input: u = K (b r - y_f) + integral - K T_d dy_f/dt, limited; or a cascade.

    The knobs are K, T_i, T_d, T_f (filter of the measurement), b (set-point weight), T_t (of the
    anti-windup; T_i by default), stages (of the input; 0 for continuous) and hysteresis (share of
    a stage). Times are in the loop's unit.

    In a cascade of two PIDs, the outer one sets the reference of the inner one. As in most cascades
    of practice, the outer integrator stops at the range of that reference and knows nothing of the
    limits of the inner loop's input: while that is saturated, the outer one winds up as far as its
    range allows. Slow anti-windup and a fast outer loop show that, for people to judge.
    """

    # Suffix of the knobs of each PID, such as "_1" in K_1. A value without a suffix applies
    # to every PID
    suffixes: tuple[str, ...] = ("",)
    fixed: Values = field(default_factory=dict)  # values that are not tuned
    # Sign of the gain of each PID; -1 if a larger input lowers the output
    signs: tuple[float, ...] = ()
    # Reference of the inner PID of a cascade at the start, and its lowest and highest value;
    # None if there is no cascade
    inner: tuple[float, float, float] | None = None

    def drive(self, values: Values, course: Course) -> Trace:
        """Return what the controller does with these values of the knobs."""
        law = laws.PID if self.inner is None else laws.CASCADE
        return by_law(law, self.gains(values, course), course)

    def gains(self, values: Values, course: Course) -> Float[np.ndarray, "r c"]:
        """Return one row for each PID, the outer one first, in the order of the columns in `_laws`.

        An output starts at its value in the loop at rest, and ends at the limits.
        """
        values, signs = {**self.fixed, **values}, self.signs or (1.0,) * len(self.suffixes)
        outputs = [(u0, *limits) for u0, limits in zip(course.u0, course.limits, strict=True)]
        if self.inner is not None:
            outputs = [self.inner, *outputs]
        each = zip(self.suffixes, signs, outputs, strict=True)
        return np.array([_row(values, *one) for one in each])


@dataclass(frozen=True, slots=True)
class LQR:
    """Linear quadratic regulator with integral action, for one input and all states measured.

    It minimizes Σ x'Qx + q z² + R u² for the linearized plant with a zero-order hold, where z is
    the integrated error of the first state. The knobs are the weights Q_1, Q_2, ... of the states,
    Q_z of the integral, R, and T_s.
    """

    fixed: Values = field(default_factory=dict)  # values that are not tuned

    def drive(self, values: Values, course: Course) -> Trace:
        """Return what the controller does with these values of the knobs."""
        return by_law(laws.FEEDBACK, self.gains(values, course), course)

    def gains(self, values: Values, course: Course) -> Float[np.ndarray, "r c"]:
        """Return the row K, K_z, bias, low, high; K solves the discrete Riccati equation."""
        values, T_s, u0 = {**self.fixed, **values}, course.T_s, course.u0
        A, B = slopes(*packed(course.plant), course.x0.copy(), u0.copy(), course.disturbance[0])
        n = len(A)
        M = np.zeros((n + 2, n + 2))  # x, z and u, with ż = x_1 and u̇ = 0
        M[:n, :n], M[:n, n + 1 :], M[n, 0] = A, B, 1.0
        held = expm(M * T_s)
        A_d, B_d = held[: n + 1, : n + 1], held[: n + 1, n + 1 :]
        weights = [*(values.get(f"Q_{i}", 0.0) for i in range(1, n + 1)), values["Q_z"]]
        Q, R = np.diag(weights) * T_s, np.array([[values["R"] * T_s]])
        S = solve_discrete_are(A_d, B_d, Q, R)
        K = np.linalg.solve(R + B_d.T @ S @ B_d, B_d.T @ S @ A_d)
        return np.hstack([K, [[u0[0], *course.limits[0]]]])


def _row(values: Values, suffix: str, sign: float, output: tuple[float, float, float]) -> list[float]:
    def value(name: str) -> float:
        plain = values.get(name, _DEFAULTS.get(name, np.nan))
        return float(values.get(f"{name}{suffix}", plain))

    T_i, T_t = value("T_i"), value("T_t")
    tracking = T_i if np.isnan(T_t) else T_t
    first = (sign * value("K"), T_i, value("T_d"), value("T_f"), value("b"), tracking)
    return [*first, *output, value("stages"), value("hysteresis")]
