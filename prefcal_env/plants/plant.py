"""The interface of a plant: eq. mathcalS with measured disturbances, and its exact Jacobians."""

from abc import ABCMeta
from typing import TYPE_CHECKING, Any, Protocol

from prefcal_env.experiments.experiment import Channel

from .jacobians import D, States, Times, U, X, Y
from .jacobians import Jacobians as Jacobians

if TYPE_CHECKING:
    from prefcal_env.plants.systems.linear import Delay, LinearPlant, Named, Numbers

    _ProtocolType = ABCMeta
else:
    _ProtocolType = type(Protocol)


class _PlantType(_ProtocolType):
    """The type of `Plant`: what it defines belongs to `Plant` itself and not to each plant."""

    def of(
        cls,
        system: Any,
        *,
        states: "Named | None" = None,
        inputs: "Named | None" = None,
        outputs: "Named | None" = None,
        disturbances: "Named" = (),
        delay: "Delay" = 0.0,
        output_delay: "Numbers" = 0.0,
        x0: "Numbers | None" = None,
        u0: "Numbers | None" = None,
        name: str = "plant",
        time_unit: str = "s",
    ) -> "LinearPlant":
        """Make a plant of a linear system, continuous or discrete, with any number of signals.

        All values are deviations from the operating point, unless the model says otherwise. Between
        instants the states are exact, and so is dead time of any length: it is added by the
        environment (`PlantEnv`, `LTILoop`). A controller that uses the plant as its model, such as
        `LinearMPC`, sees it without dead time.

        Args:
            system: StateSpace or TransferFunction of python-control or scipy.signal (`lti`,
                `dlti`), arrays (A, B, C, D) or (A, B, C, D, dt), polynomials (num, den), or a list
                of rows of these. Improper transfer functions are refused.
            states: Names or `Channel`s of the states, in their order.
            inputs: Names or `Channel`s of the inputs; limits of a `Channel` are those of the
                actuator. Without them, the names that python-control knows, else u or u1, u2, ...
            outputs: Names or `Channel`s of the outputs, likewise.
            disturbances: Names or `Channel`s of measured disturbances: the last inputs of `system`
                are these instead of inputs.
            delay: Dead time between input and plant, in `time_unit`: one number, one for each
                input, or a matrix of shape (n_y, n_u) with that from each input to each output. If
                the plant is discrete, multiples of its sample time. A matrix gives each input
                states of its own.
            output_delay: Dead time between plant and output, likewise.
            x0: State at the start of experiments, shape (n_x,) or one number; by default 0. Where a
                matrix of dead times copies states, one for each copy.
            u0: Input before the start of experiments, shape (n_u,) or one number; by default 0.
            name: Name of the plant, as shown to people.
            time_unit: Unit of time of `system`.

        Raises:
            PlantError: If `system` is no such system or is improper, or an argument does not fit.
        """
        from prefcal_env.plants.systems.linear import LinearPlant

        return LinearPlant(
            system,
            states=states,
            inputs=inputs,
            outputs=outputs,
            disturbances=disturbances,
            delay=delay,
            output_delay=output_delay,
            x0=x0,
            u0=u0,
            name=name,
            time_unit=time_unit,
        )


class Plant(Protocol, metaclass=_PlantType):
    """A plant ẋ = f(x, u, d), y = g(x, u, d) (eq. mathcalS) with measured disturbances d.

    Units are those of the channels; time is in `time_unit`. All functions are pure. To define
    your own plant, you only need f and g: see `FunctionPlant`. `Plant.of` makes a plant of a
    linear system of python-control or SciPy.

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
