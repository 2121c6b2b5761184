"""The interface of a plant: eq. mathcalS with measured disturbances, and its exact Jacobians."""

from abc import ABCMeta
from typing import TYPE_CHECKING, Protocol

from prefcal_env.experiments.experiment import Channel

from .jacobians import D, States, Times, U, X, Y
from .jacobians import Jacobians as Jacobians

if TYPE_CHECKING:
    from prefcal_env.plants.systems.linear import LinearPlant

    _ProtocolType = ABCMeta
else:
    _ProtocolType = type(Protocol)


class _PlantType(_ProtocolType):
    """The type of `Plant`: what it defines belongs to `Plant` itself and not to each plant."""

    @property
    def of(cls) -> "type[LinearPlant]":
        """Class that makes a plant of a linear system: `Plant.of(system, ...)`."""
        from prefcal_env.plants.systems.linear import LinearPlant

        return LinearPlant


class Plant(Protocol, metaclass=_PlantType):
    """A plant ẋ = f(x, u, d), y = g(x, u, d) (eq. mathcalS) with measured disturbances d.

    Units are those of the channels; time is in `time_unit`. All functions are pure. To define
    your own plant, you only need f and g: see `FunctionPlant`. `Plant.of` is `LinearPlant`, which
    makes a plant of a linear system of python-control or SciPy.

    More attributes are optional: `input_delay` and `output_delay`, tuples with the dead time of
    each input and output, which environments apply; `entry_delay`, rows with that from each input
    to each output, and with it `entries(x, u, d)`, what each input, and last anything else, adds to
    the outputs; and `sample_time`, of whose multiples the sampling time of a controller must be
    one.
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

    def f(self, x: X, u: U, d: D) -> X:
        """Return the state derivative, per `time_unit`."""

    def g(self, x: X, u: U, d: D) -> Y:
        """Return the controlled outputs."""

    def jacobians(self, x: X, u: U, d: D) -> Jacobians:
        """Return the exact derivatives of f and g at one point."""

    def hold(self, x: X, u: U, d: D, times: Times) -> States:
        """Return the states at `times` (increasing, above 0) after x, with u and d held."""
