"""What a plant is: eq. mathcalS with measured disturbances, and its exact Jacobians."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Float

from prefcal_env.experiments.experiment import Channel


@dataclass(frozen=True, slots=True)
class Jacobians:
    """Derivatives of f and g: A = ∂f/∂x, B = ∂f/∂u, C = ∂g/∂x, D = ∂g/∂u."""

    A: Float[np.ndarray, "n_x n_x"]
    B: Float[np.ndarray, "n_x n_u"]
    C: Float[np.ndarray, "n_y n_x"]
    D: Float[np.ndarray, "n_y n_u"]


class Plant(Protocol):
    """ẋ = f(x, u, d), y = g(x, u, d) (eq. mathcalS), d measured disturbances.

    Units are those of the channels, time is in `time_unit`. The functions are pure. A user's
    plant needs to write f and g alone: see `prefcal_env.plants.FunctionPlant`.
    """

    @property
    def name(self) -> str:
        """How people call it."""

    @property
    def time_unit(self) -> str:
        """Unit of time, "h" or "s" say."""

    @property
    def states(self) -> tuple[Channel, ...]:
        """The n_x states."""

    @property
    def inputs(self) -> tuple[Channel, ...]:
        """The n_u inputs, with the limits of the actuators."""

    @property
    def outputs(self) -> tuple[Channel, ...]:
        """The n_y controlled outputs."""

    @property
    def disturbances(self) -> tuple[Channel, ...]:
        """The n_d measured disturbances; may be empty."""

    def f(
        self,
        x: Float[np.ndarray, " n_x"],
        u: Float[np.ndarray, " n_u"],
        d: Float[np.ndarray, " n_d"],
    ) -> Float[np.ndarray, " n_x"]:
        """State derivative, per `time_unit`."""

    def g(
        self,
        x: Float[np.ndarray, " n_x"],
        u: Float[np.ndarray, " n_u"],
        d: Float[np.ndarray, " n_d"],
    ) -> Float[np.ndarray, " n_y"]:
        """Controlled outputs."""

    def jacobians(
        self,
        x: Float[np.ndarray, " n_x"],
        u: Float[np.ndarray, " n_u"],
        d: Float[np.ndarray, " n_d"],
    ) -> Jacobians:
        """Exact derivatives of f and g at one point."""

    def hold(
        self,
        x: Float[np.ndarray, " n_x"],
        u: Float[np.ndarray, " n_u"],
        d: Float[np.ndarray, " n_d"],
        times: Float[np.ndarray, " K"],
    ) -> Float[np.ndarray, "K n_x"]:
        """States at `times` (increasing, above 0) after x, with u and d held from time 0 on."""
