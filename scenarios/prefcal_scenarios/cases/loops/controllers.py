"""Controllers that people tune: from the values of the knobs to a compiled law or a controller."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_discrete_are

from prefcal_env.envs.task import Task
from prefcal_env.experiments.control import Controller
from prefcal_env.plants.systems.matrices import held

from . import _laws as laws
from .plant import CompiledPlant

Values = Mapping[str, float]


class Gains(NamedTuple):
    """A compiled law and its gains: one row for each PID or input, with columns as in `_laws`."""

    law: int
    rows: Float[np.ndarray, "r c"]


class Tunable(Protocol):
    """A kind of controller."""

    def make(self, values: Values, plant: CompiledPlant, task: Task, T_s: float) -> Gains | Controller:
        """Return the controller with these values of the knobs, by name, and sampling time.

        Raises:
            LinAlgError: If there is no controller for these values.
        """


_DEFAULTS: Values = {"T_i": np.inf, "T_d": 0.0, "T_f": 0.0, "b": 1.0, "stages": 0, "hysteresis": 0}


@dataclass(frozen=True, slots=True)
class TunedPID:
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

    def make(self, values: Values, plant: CompiledPlant, task: Task, T_s: float) -> Gains:
        """Return the law with these values of the knobs: a row for each PID, the outer one first.

        An output starts at its value in the loop at rest, and ends at the limits.
        """
        values, signs = {**self.fixed, **values}, self.signs or (1.0,) * len(self.suffixes)
        outputs = [(u0, c.low, c.high) for u0, c in zip(task.u0, plant.inputs, strict=True)]
        if self.inner is not None:
            outputs = [self.inner, *outputs]
        each = zip(self.suffixes, signs, outputs, strict=True)
        rows = np.array([_row(values, *one) for one in each])
        return Gains(laws.PID if self.inner is None else laws.CASCADE, rows)


@dataclass(frozen=True, slots=True)
class TunedLQR:
    """Linear quadratic regulator with integral action, for one input and all states measured.

    It minimizes Σ x'Qx + q z² + R u² for the linearized plant with a zero-order hold, where z is
    the integrated error of the first state. The knobs are the weights Q_1, Q_2, ... of the states,
    Q_z of the integral, R, and T_s.
    """

    fixed: Values = field(default_factory=dict)  # values that are not tuned

    def make(self, values: Values, plant: CompiledPlant, task: Task, T_s: float) -> Gains:
        """Return the row K, K_z, bias, low, high; K solves the discrete Riccati equation."""
        values, c = {**self.fixed, **values}, plant.inputs[0]
        J = plant.jacobians(task.x0, task.u0, task.disturbance(0.0))
        n = len(J.A)
        A, B = np.zeros((n + 1, n + 1)), np.zeros((n + 1, 1))  # of x and z, with ż = x_1
        A[:n, :n], A[n, 0], B[:n] = J.A, 1.0, J.B
        A_d, B_d = held(A, B, T_s)
        weights = [*(values.get(f"Q_{i}", 0.0) for i in range(1, n + 1)), values["Q_z"]]
        Q, R = np.diag(weights) * T_s, np.array([[values["R"] * T_s]])
        S = solve_discrete_are(A_d, B_d, Q, R)
        K = np.linalg.solve(R + B_d.T @ S @ B_d, B_d.T @ S @ A_d)
        return Gains(laws.FEEDBACK, np.hstack([K, [[task.u0[0], c.low, c.high]]]))


def _row(values: Values, suffix: str, sign: float, output: tuple[float, float, float]) -> list[float]:
    def value(name: str) -> float:
        plain = values.get(name, _DEFAULTS.get(name, np.nan))
        return float(values.get(f"{name}{suffix}", plain))

    T_i, T_t = value("T_i"), value("T_t")
    tracking = T_i if np.isnan(T_t) else T_t
    first = (sign * value("K"), T_i, value("T_d"), value("T_f"), value("b"), tracking)
    return [*first, *output, value("stages"), value("hysteresis")]
