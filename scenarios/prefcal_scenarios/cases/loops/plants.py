"""Parameters of the plants, one frozen dataclass for each kind."""

from dataclasses import dataclass, fields
from typing import ClassVar

import numpy as np
from jaxtyping import Float

from ._derivatives import BOOST, CART_POLE, LINEAR, QUADRUPLE, SERVO, STEERING, TANK
from ._simulate import slopes


@dataclass(frozen=True, slots=True)
class Linear:
    """Linear plant ẋ = A x + B u + E d; each matrix is a tuple of rows."""

    kind: ClassVar[int] = LINEAR
    A: tuple[tuple[float, ...], ...]
    B: tuple[tuple[float, ...], ...]
    E: tuple[tuple[float, ...], ...]


@dataclass(frozen=True, slots=True)
class Tank:
    """Tank that widens upwards, with a pump; x = (level [m], pump flow [m³/s]).

    Args:
        bottom: Cross-section at the bottom, m².
        widening: Increase of the cross-section with the level, m²/m.
        outlet: Cross-section of the outlet, m².
        pump_gain: Flow at full power, m³/s.
        pump_lag: Time constant of the pump, s.
    """

    kind: ClassVar[int] = TANK
    bottom: float = 0.05
    widening: float = 0.25
    outlet: float = 4e-4
    pump_gain: float = 3e-3
    pump_lag: float = 3.0


@dataclass(frozen=True, slots=True)
class QuadrupleTank:
    """Johansson's four tanks with two pumps; x = four levels [m], u = voltages [V].

    Args:
        area_1: Cross-section of tank 1, m².
        area_2: Cross-section of tank 2, m².
        area_3: Cross-section of tank 3, m².
        area_4: Cross-section of tank 4, m².
        outlet_1: Cross-section of the outlet of tank 1, m².
        outlet_2: Cross-section of the outlet of tank 2, m².
        outlet_3: Cross-section of the outlet of tank 3, m².
        outlet_4: Cross-section of the outlet of tank 4, m².
        pump_gain: Flow per voltage, m³/(s V).
        share_1: Share of pump 1's flow that goes to tank 1; the rest goes to tank 4.
        share_2: Share of pump 2's flow that goes to tank 2; the rest goes to tank 3.
    """

    kind: ClassVar[int] = QUADRUPLE
    area_1: float = 28e-4
    area_2: float = 32e-4
    area_3: float = 28e-4
    area_4: float = 32e-4
    outlet_1: float = 7.1e-6
    outlet_2: float = 5.7e-6
    outlet_3: float = 7.1e-6
    outlet_4: float = 5.7e-6
    pump_gain: float = 3.3e-6
    share_1: float = 0.70
    share_2: float = 0.60


@dataclass(frozen=True, slots=True)
class Servo:
    """Motor and load with friction and backlash, in SI units.

    x = (load angle [rad], motor speed [rad/s], load speed [rad/s], twist of the shaft [rad]).

    Args:
        motor: Inertia of the motor, kg m².
        load: Inertia of the load, kg m².
        viscous: Viscous friction of either, N m s/rad.
        coulomb: Coulomb friction of the load, N m.
        half_gap: Half of the backlash, rad.
        stiffness: Stiffness of the shaft, N m/rad.
        damping: Damping of the shaft, N m s/rad.
    """

    kind: ClassVar[int] = SERVO
    motor: float = 0.01
    load: float = 0.02
    viscous: float = 0.01
    coulomb: float = 0.05
    half_gap: float = 0.01
    stiffness: float = 20.0
    damping: float = 0.05


@dataclass(frozen=True, slots=True)
class CartPole:
    """Pole on a cart; x = (position [m], angle [rad], speed [m/s], angular speed [rad/s]).

    Args:
        cart: Mass of the cart, kg.
        pole: Mass at the end of the pole, kg.
        length: Length of the pole, m.
        friction: Viscous friction of the cart, N s/m.
    """

    kind: ClassVar[int] = CART_POLE
    cart: float = 1.0
    pole: float = 0.2
    length: float = 0.6
    friction: float = 0.3


@dataclass(frozen=True, slots=True)
class BoostConverter:
    """Averaged boost converter, time in ms; x = (output voltage [V], coil current [A]).

    Args:
        inductance: Inductance of the coil, mH.
        capacitance: Capacitance at the output, mF.
        load: Resistance of the load, Ω.
        supply: Supply voltage, V.
        resistance: Resistance of the coil, Ω.
    """

    kind: ClassVar[int] = BOOST
    inductance: float = 0.2
    capacitance: float = 0.47
    load: float = 12.0
    supply: float = 12.0
    resistance: float = 0.15


@dataclass(frozen=True, slots=True)
class Steering:
    """Kinematic bicycle; x = (lateral position [m], heading [rad], steering angle [rad]).

    Args:
        speed: Speed, m/s.
        wheelbase: Distance of the axles, m.
        lag: Time constant of the steering, s.
    """

    kind: ClassVar[int] = STEERING
    speed: float = 15.0
    wheelbase: float = 2.8
    lag: float = 0.15


Plant = Linear | Tank | QuadrupleTank | Servo | CartPole | BoostConverter | Steering


def parameters_of(plant: Plant) -> Float[np.ndarray, " n_p"]:
    """Return the fields of `plant`, matrices row by row, as its right-hand side reads them."""
    values = [getattr(plant, field.name) for field in fields(plant)]
    return np.concatenate([np.ravel(np.array(value, dtype=float)) for value in values])


def linearized(
    plant: Plant,
    x: Float[np.ndarray, " n_x"],
    u: Float[np.ndarray, " n_u"],
    d: Float[np.ndarray, " n_d"],
) -> tuple[Float[np.ndarray, "n_x n_x"], Float[np.ndarray, "n_x n_u"]]:
    """Return A and B of the plant around a point, by central differences."""
    A, B = slopes(plant.kind, parameters_of(plant), x.copy(), u.copy(), d)
    return np.asarray(A), np.asarray(B)
