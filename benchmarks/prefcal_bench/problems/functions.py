"""Latent test functions that a synthetic calibrator can minimize.

Each function is defined on its usual box. Optima without a formula were computed to 1e-9 or better
by descent from the published minimizer.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from jaxtyping import Float

from prefcal_env.knobs import Knob, KnobSpace

Latent = Callable[[Float[np.ndarray, " n"]], float]


@dataclass(frozen=True, slots=True)
class TestFunction:
    """Function of a physical θ, shape (n,), whose global minimum is known."""

    __test__ = False  # despite the name, not a test for pytest to collect

    name: str  # name in the benchmark
    f: Latent  # latent function, dimensionless
    space: KnobSpace  # domain of the function
    optimum: float  # smallest value in the domain

    def __call__(self, theta: Float[np.ndarray, " n"]) -> float:
        """Return the value at physical `theta`, shape (n,)."""
        return float(self.f(np.asarray(theta, dtype=float)))

    def gap(self, theta: Float[np.ndarray, " n"]) -> float:
        """Return the difference between the value at `theta` and the optimum."""
        return self(theta) - self.optimum

    def prefer(self, a: Float[np.ndarray, " n"], b: Float[np.ndarray, " n"]) -> int:
        """Return the preference of the latent function, eq. pref_fun-f: -1 if `a` is lower."""
        return int(np.sign(self(a) - self(b)))


def box(*bounds: tuple[float, float]) -> KnobSpace:
    """Return a space of linear knobs x1, x2, ...

    The knobs have no step, since a calibrator that compares function values notices any
    difference.
    """
    knobs = [Knob(f"x{k}", low, high, step=0) for k, (low, high) in enumerate(bounds, start=1)]
    return KnobSpace(knobs)


def camel(x: Float[np.ndarray, " 2"]) -> float:
    """Return the six-hump camel function: two global and four local minima."""
    a, b = x
    return float((4 - 2.1 * a**2 + a**4 / 3) * a**2 + a * b + (4 * b**2 - 4) * b**2)


_HARTMAN_ALPHA = np.array([1.0, 1.2, 3.0, 3.2])
_HARTMAN3_A = np.array([[3, 10, 30], [0.1, 10, 35], [3, 10, 30], [0.1, 10, 35]])
_HARTMAN3_P = 1e-4 * np.array([[3689, 1170, 2673], [4699, 4387, 7470], [1091, 8732, 5547], [381, 5743, 8828]])
_HARTMAN6_A = np.array(
    [
        [10, 3, 17, 3.5, 1.7, 8],
        [0.05, 10, 17, 0.1, 8, 14],
        [3, 3.5, 1.7, 10, 17, 8],
        [17, 8, 0.05, 10, 0.1, 14],
    ]
)
_HARTMAN6_P = 1e-4 * np.array(
    [
        [1312, 1696, 5569, 124, 8283, 5886],
        [2329, 4135, 8307, 3736, 1004, 9991],
        [2348, 1451, 3522, 2883, 3047, 6650],
        [4047, 8828, 8732, 5743, 1091, 381],
    ]
)


def hartman3(x: Float[np.ndarray, " 3"]) -> float:
    """Return the 3-d Hartman function: four Gaussian wells."""
    return float(-_HARTMAN_ALPHA @ np.exp(-np.sum(_HARTMAN3_A * (x - _HARTMAN3_P) ** 2, axis=1)))


def hartman6(x: Float[np.ndarray, " 6"]) -> float:
    """Return the 6-d Hartman function: four Gaussian wells, six local minima."""
    return float(-_HARTMAN_ALPHA @ np.exp(-np.sum(_HARTMAN6_A * (x - _HARTMAN6_P) ** 2, axis=1)))


def branin(x: Float[np.ndarray, " 2"]) -> float:
    """Return the Branin function: three global minima."""
    a, b = x
    bowl = b - 5.1 / (4 * np.pi**2) * a**2 + 5 / np.pi * a - 6
    return float(bowl**2 + 10 * (1 - 1 / (8 * np.pi)) * np.cos(a) + 10)


def rosenbrock(x: Float[np.ndarray, " n"]) -> float:
    """Return the Rosenbrock function: a curved valley."""
    return float(np.sum(100 * (x[1:] - x[:-1] ** 2) ** 2 + (1 - x[:-1]) ** 2))


def ackley(x: Float[np.ndarray, " n"]) -> float:
    """Return the Ackley function: a funnel covered by a lattice of local minima."""
    funnel = 20 * np.exp(-0.2 * np.sqrt(np.mean(x**2)))
    return float(20 + np.e - funnel - np.exp(np.mean(np.cos(2 * np.pi * x))))


def adjiman(x: Float[np.ndarray, " 2"]) -> float:
    """Return the Adjiman function: smooth, with its minimum on the edge of the box."""
    a, b = x
    return float(np.cos(a) * np.sin(b) - a / (b**2 + 1))


def levy(x: Float[np.ndarray, " n"]) -> float:
    """Return the Levy function: waves on a bowl."""
    w = 1 + (x - 1) / 4
    middle = (w[:-1] - 1) ** 2 * (1 + 10 * np.sin(np.pi * w[:-1] + 1) ** 2)
    last = (w[-1] - 1) ** 2 * (1 + np.sin(2 * np.pi * w[-1]) ** 2)
    return float(np.sin(np.pi * w[0]) ** 2 + np.sum(middle) + last)


def styblinski_tang(x: Float[np.ndarray, " n"]) -> float:
    """Return the Styblinski-Tang function: a minimum per corner, one global; mean over knobs."""
    return float(0.5 * np.mean(x**4 - 16 * x**2 + 5 * x))


def terraces(x: Float[np.ndarray, " 3"]) -> float:
    """Return a bowl of flat terraces, on which comparisons do not show the way down.

    The second knob is an integer. The lowest terrace, with value 0, is around (0.3, 25, -1) and
    covers about 0.3 % of the box.
    """
    offset = (x - np.array([0.3, 25.0, -1.0])) / np.array([0.15, 10.0, 1.2])
    return float(np.floor(2 * offset @ offset) / 2)


def _make() -> Mapping[str, TestFunction]:
    mixed = KnobSpace(
        [Knob("period", 0.1, 1.0), Knob("horizon", 5, 60, integer=True), Knob("weight", -5.0, 3.0)]
    )
    functions = (
        TestFunction("camel", camel, box((-2, 2), (-1, 1)), -1.0316284534898774),
        TestFunction("hartman3", hartman3, box(*[(0, 1)] * 3), -3.862779787332663),
        TestFunction("hartman6", hartman6, box(*[(0, 1)] * 6), -3.3223680114155147),
        TestFunction("branin", branin, box((-5, 10), (0, 15)), 0.39788735772973816),
        TestFunction("adjiman", adjiman, box((-1, 2), (-1, 1)), -2.021806783359787),
        TestFunction("rosenbrock2", rosenbrock, box(*[(-2, 2)] * 2), 0.0),
        TestFunction("rosenbrock4", rosenbrock, box(*[(-2, 2)] * 4), 0.0),
        TestFunction("rosenbrock8", rosenbrock, box(*[(-2, 2)] * 8), 0.0),
        TestFunction("ackley2", ackley, box(*[(-3.7, 6.3)] * 2), 0.0),
        TestFunction("ackley5", ackley, box(*[(-3.7, 6.3)] * 5), 0.0),
        TestFunction("levy4", levy, box(*[(-10, 10)] * 4), 0.0),
        TestFunction("levy8", levy, box(*[(-10, 10)] * 8), 0.0),
        TestFunction("styblinski3", styblinski_tang, box(*[(-5, 5)] * 3), -39.16616570377142),
        TestFunction("terraces3", terraces, mixed, 0.0),
    )
    return MappingProxyType({function.name: function for function in functions})


FUNCTIONS = _make()  # test functions by name
