"""The interface of a plant: eq. mathcalS with measured disturbances, and its exact Jacobians."""

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
    """A plant ẋ = f(x, u, d), y = g(x, u, d) (eq. mathcalS) with measured disturbances d.

    Units are those of the channels; time is in `time_unit`. All functions are pure. To define
    your own plant, you only need f and g: see `prefcal_env.plants.FunctionPlant`.
    """

    @property
    def name(self) -> str:
        """Name of the plant, as shown to people."""

    @property
    def time_unit(self) -> str:
        """Unit of time, such as "h" or "s"."""

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
        """Return the state derivative, per `time_unit`."""

    def g(
        self,
        x: Float[np.ndarray, " n_x"],
        u: Float[np.ndarray, " n_u"],
        d: Float[np.ndarray, " n_d"],
    ) -> Float[np.ndarray, " n_y"]:
        """Return the controlled outputs."""

    def jacobians(
        self,
        x: Float[np.ndarray, " n_x"],
        u: Float[np.ndarray, " n_u"],
        d: Float[np.ndarray, " n_d"],
    ) -> Jacobians:
        """Return the exact derivatives of f and g at one point."""

    def hold(
        self,
        x: Float[np.ndarray, " n_x"],
        u: Float[np.ndarray, " n_u"],
        d: Float[np.ndarray, " n_d"],
        times: Float[np.ndarray, " K"],
    ) -> Float[np.ndarray, "K n_x"]:
        """Return the states at `times` (increasing, above 0) after x, with u and d held."""
