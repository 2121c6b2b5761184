"""Known functions of θ for the tests of agents, and which of two θ they prefer."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from prefcal_env.knobs import Knob, KnobSpace


@dataclass(frozen=True)
class Latent:
    """A function of θ, of shape (n,), with its box and its smallest value."""

    f: Callable
    space: KnobSpace
    optimum: float

    def __call__(self, theta):
        return float(self.f(np.asarray(theta, dtype=float)))

    def gap(self, theta):
        return self(theta) - self.optimum

    def prefer(self, a, b):
        return int(np.sign(self(a) - self(b)))


def camel(x):
    a, b = x
    return (4 - 2.1 * a**2 + a**4 / 3) * a**2 + a * b + (4 * b**2 - 4) * b**2


_WIDTHS = np.array([[3, 10, 30], [0.1, 10, 35], [3, 10, 30], [0.1, 10, 35]])
_CENTERS = 1e-4 * np.array([[3689, 1170, 2673], [4699, 4387, 7470], [1091, 8732, 5547], [381, 5743, 8828]])


def hartman3(x):
    return -np.array([1.0, 1.2, 3.0, 3.2]) @ np.exp(-np.sum(_WIDTHS * (x - _CENTERS) ** 2, axis=1))


def branin(x):
    a, b = x
    bowl = b - 5.1 / (4 * np.pi**2) * a**2 + 5 / np.pi * a - 6
    return bowl**2 + 10 * (1 - 1 / (8 * np.pi)) * np.cos(a) + 10


CAMEL = Latent(camel, KnobSpace([Knob("x1", -2, 2, step=0), Knob("x2", -1, 1, step=0)]), -1.0316284534898774)
BRANIN = Latent(
    branin, KnobSpace([Knob("x1", -5, 10, step=0), Knob("x2", 0, 15, step=0)]), 0.39788735772973816
)
HARTMAN3 = Latent(hartman3, KnobSpace([Knob(f"x{k}", 0, 1, step=0) for k in (1, 2, 3)]), -3.862779787332663)
