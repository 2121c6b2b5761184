"""Cars that differ from the kinematic bicycle that the MPC uses as its model.

They take the inputs of `Bicycle`, and their first three states are its (x_f, y_f, θ). They add what
the bicycle neglects: the speed v [m/s] lags behind its reference, and tires slip.
"""

from dataclasses import astuple, dataclass, fields
from functools import lru_cache, partial
from math import atan, atan2, cos, sin, tan

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import PlantError
from prefcal_env.experiments.experiment import Channel

from .bicycle import Bicycle
from .equations import Equations
from .function_plant import FunctionPlant

_SPEED = Channel("speed", "m/s", symbol="v")
_POSE = Bicycle.states


@dataclass(frozen=True, slots=True)
class SlipParams:
    """Parameters of `slip_bicycle`. Raises PlantError if one is not positive and finite."""

    length: float = 4.5  # m, distance between the axles
    lag: float = 0.6  # s, time constant of the speed

    def __post_init__(self) -> None:
        _check_positive(self)


@dataclass(frozen=True, slots=True)
class DynamicParams:
    """Parameters of `dynamic_bicycle`, a medium-sized car. Raises PlantError as `SlipParams`."""

    front: float = 2.25  # m, from the center of mass to the front axle, where x_f and y_f are
    rear: float = 2.25  # m, to the rear axle
    mass: float = 1500.0  # kg
    inertia: float = 2500.0  # kg m², about the vertical axis
    front_stiffness: float = 80e3  # N/rad, lateral, both tires together
    rear_stiffness: float = 80e3  # N/rad
    lag: float = 0.3  # s, time constant of the speed

    def __post_init__(self) -> None:
        _check_positive(self)


def slip_bicycle(params: SlipParams | None = None) -> FunctionPlant:
    """Return the bicycle of highway-env: v is the speed of the body's center, which slips by β.

    x = (x_f, y_f, θ, v). β = atan(tan(δ_s)/2), θ̇ = v sin(β)/(L/2), the center moves along θ + β;
    v follows its reference with the lag of highway-env's speed controller. The paths are those of
    the kinematic bicycle, driven faster: the front wheel at v cos(β)/cos(δ_s).
    """
    params = params or SlipParams()
    return FunctionPlant(
        partial(_slip, params), _front_end,
        states=(*_POSE, _SPEED), inputs=Bicycle.inputs, outputs=_POSE,
        name="slip bicycle", compiled=partial(_compiled, "slip", params),
    )  # fmt: skip


def dynamic_bicycle(params: DynamicParams | None = None) -> FunctionPlant:
    """Return a single-track model with linear tires.

    x = (x_f, y_f, θ, v, v_y, r): v and v_y [m/s] are the velocity of the center of mass along and
    across the body, r [rad/s] is the yaw rate. Lateral tire forces are proportional to slip angles.
    """
    params = params or DynamicParams()
    return FunctionPlant(
        partial(_dynamic, params), _front_end,
        states=(
            *_POSE, _SPEED, Channel("lateral speed", "m/s", symbol="v_y"),
            Channel("yaw rate", "rad/s", symbol="r"),
        ),
        inputs=Bicycle.inputs, outputs=_POSE, name="dynamic bicycle",
        compiled=partial(_compiled, "dynamic", params),
    )  # fmt: skip


@lru_cache(maxsize=64)
def _compiled(name: str, params: SlipParams | DynamicParams) -> Equations:
    from . import _car_kernels  # loads the compiler

    return Equations(getattr(_car_kernels, name).address, 0, 0, np.array(astuple(params)))


def _slip(
    p: SlipParams, x: Float[np.ndarray, " 4"], u: Float[np.ndarray, " 2"], d: object
) -> list[float]:
    (_, _, yaw, v), (v_ref, steering) = x.tolist(), u.tolist()
    slip = atan(tan(steering) / 2)
    rate = v * sin(slip) / (p.length / 2)
    swing = rate * p.length / 2  # of the front end about the center, to the left
    return [
        v * cos(yaw + slip) - swing * sin(yaw),
        v * sin(yaw + slip) + swing * cos(yaw),
        rate,
        (v_ref - v) / p.lag,
    ]


def _dynamic(
    p: DynamicParams, x: Float[np.ndarray, " 6"], u: Float[np.ndarray, " 2"], d: object
) -> list[float]:
    (_, _, yaw, v, v_y, rate), (v_ref, steering) = x.tolist(), u.tolist()
    front_force = -p.front_stiffness * (atan2(v_y + p.front * rate, v) - steering)
    rear_force = -p.rear_stiffness * atan2(v_y - p.rear * rate, v)
    lateral = front_force * cos(steering)
    front_speed = v_y + p.front * rate
    return [
        v * cos(yaw) - front_speed * sin(yaw),
        v * sin(yaw) + front_speed * cos(yaw),
        rate,
        (v_ref - v) / p.lag,
        (lateral + rear_force) / p.mass - v * rate,
        (p.front * lateral - p.rear * rear_force) / p.inertia,
    ]


def _front_end(x: Float[np.ndarray, " n"], u: object, d: object) -> Float[np.ndarray, " 3"]:
    return np.asarray(x[:3])


def _check_positive(params: SlipParams | DynamicParams) -> None:
    for field in fields(params):
        value = getattr(params, field.name)
        if not 0 < value < np.inf:
            raise PlantError(f"{field.name} must be positive and finite, got {value}")
