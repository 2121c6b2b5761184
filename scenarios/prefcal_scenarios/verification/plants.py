"""What varies of a plant: its parameters, dead time and the ranges of its inputs."""

from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.envs.dead_time import delays_of
from prefcal_env.experiments.experiment import Channel
from prefcal_env.plants.disturbed import Disturbed
from prefcal_env.plants.jacobians import D, Jacobians, States, Times, U, X, Y
from prefcal_env.plants.plant import Plant
from prefcal_env.plants.systems import LinearPlant
from prefcal_scenarios.cases.loops.plant import CompiledPlant
from prefcal_scenarios.cases.loops.right_hand_sides import Linear

from .factor import NOT_NEGATIVE, USUAL, Factor, Values

CHANGE, SIZE, NARROWER = USUAL["parameter"], USUAL["dead time"], USUAL["actuator"]
"""Relative changes: of parameters; of dead time, loads and references; of the ranges of inputs."""
LEAST = 0.01
"""Smallest share of its nominal value that what cannot be 0 can have."""
SPEED, DELAY = "all time constants", "dead time"
_NOT_PARAMETERS = ("max_step", "dead_time")


def factors_of(plant: Plant) -> Iterator[Factor]:
    """Yield what varies of a plant: parameters, dead time, and the ranges of its inputs.

    Parameters are the numbers of one that is a dataclass, as `CSTR`. Of matrices they are the time
    constant of each state and the gain of each input, of other equations all time constants together.
    So are those of states without names: a row of a transfer function's matrices is no parameter.
    """
    own = plant.plant if isinstance(plant, Disturbed) else plant
    matrices, numbers = _matrices(own), dict(_numbers(own))
    if matrices is not None:
        for state, a, b in zip(own.states, *matrices, strict=False):
            # A row such as ẋ = v says what a state is: it has no parameter.
            if b.any() or not np.isin(np.abs(a), (0.0, 1.0)).all():
                yield _parameter(_constant(state))
    elif numbers:
        yield from (_parameter(_words(n), value) for n, value in numbers.items())
    elif own.states and not getattr(own, "sample_time", 0.0):
        yield _parameter(SPEED)
    if matrices is not None or not numbers:
        yield from (_parameter(_gain(c)) for c in own.inputs)
    if late := max(delays_of(own)[0]):
        yield Factor.around(DELAY, "dead time", SIZE, late, own.time_unit, NOT_NEGATIVE)
    for c in plant.inputs:
        if np.isfinite(c.high - c.low):
            yield Factor(_range(c), "actuator", 1.0, 1 - NARROWER, 1.0, possible=(LEAST, 1.0))


def _parameter(name: str, value: float = 1.0) -> Factor:
    """Return a parameter of a plant, which is above 0 and stays so."""
    return Factor.around(name, "parameter", CHANGE, value, possible=(LEAST * value, np.inf))


def varied_plant(plant: Plant, values: Values) -> Plant:
    """Return a plant with other parameters, dead time and ranges of its inputs."""
    inputs = tuple(_narrowed(c, values.get(_range(c), 1.0)) for c in plant.inputs)
    if isinstance(plant, Disturbed):
        return plant.around(_changed(plant.plant, values), inputs)
    made = _changed(plant, values)
    return replace(made, inputs=inputs) if isinstance(made, CompiledPlant) else Disturbed(made, inputs=inputs)


def _changed(plant: Plant, values: Values) -> Plant:
    """Return a plant with other parameters, time constants, gains and dead time."""
    gains = np.array([values.get(_gain(c), 1.0) for c in plant.inputs])
    rates = np.array([1 / values.get(_constant(c), 1.0) for c in plant.states])
    speed, delays = 1 / values.get(SPEED, 1.0), delays_of(plant)[0]
    later = values[DELAY] / max(delays) if DELAY in values else 1.0
    if isinstance(plant, CompiledPlant):
        if isinstance(plant.parameters, Linear):
            A, B, E = (np.array(M, dtype=float) * rates[:, None] for M in plant.parameters)
            made = Linear(*(tuple(map(tuple, M.tolist())) for M in (A, B * gains, E)))
            plant = replace(plant, parameters=made)
        named: CompiledPlant = _with_numbers(plant, values)
        return replace(named, dead_time=later * plant.dead_time)
    if isinstance(plant, LinearPlant):
        return plant.scaled(speed * rates, gains, later)
    if dict(_numbers(plant)):
        plant = _with_numbers(plant, values)
    if (gains == 1).all() and speed == later == 1:
        return plant
    return Scaled(plant, speed, gains, tuple(later * each for each in delays))


@dataclass(frozen=True, eq=False)
class Scaled:
    """A plant that is slower or faster by one factor, and whose inputs act more or less, or later.

    Args:
        plant: Plant.
        speed: Factor of all rates.
        gains: Factor of each input, shape (n_u,).
        input_delay: Dead time of each input.
    """

    plant: Plant
    speed: float
    gains: Float[np.ndarray, " n_u"]
    input_delay: tuple[float, ...]

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or name == "plant":
            raise AttributeError(name)
        return getattr(self.plant, name)

    def f(self, x: X, u: U, d: D) -> X:
        """Return the state derivative."""
        return self.speed * self.plant.f(x, self.gains * u, d)

    def g(self, x: X, u: U, d: D) -> Y:
        """Return the outputs."""
        return self.plant.g(x, self.gains * u, d)

    def jacobians(self, x: X, u: U, d: D) -> Jacobians:
        """Return the derivatives."""
        J = self.plant.jacobians(x, self.gains * u, d)
        return Jacobians(self.speed * J.A, self.speed * J.B * self.gains, J.C, J.D * self.gains)

    def hold(self, x: X, u: U, d: D, times: Times) -> States:
        """Return the states at `times`."""
        return self.plant.hold(x, self.gains * u, d, np.asarray(times) * self.speed)


def _matrices(plant: Plant) -> tuple[np.ndarray, np.ndarray] | None:
    """Return A and B of a plant whose states have names; a discrete one has no time constants."""
    if isinstance(plant, LinearPlant) and plant.has_named_states:
        rows = 0 if plant.sample_time else len(plant.states)
        return plant.system.A[:rows], plant.system.B[:rows]
    if isinstance(plant, CompiledPlant) and isinstance(plant.parameters, Linear):
        A, B, E = (np.array(M, dtype=float) for M in plant.parameters)
        return A, np.column_stack([B, E])
    return None


def _narrowed(c: Channel, share: float) -> Channel:
    """Return an input that has only a share of its range, around its middle."""
    if share == 1.0:
        return c
    middle, half = (c.high + c.low) / 2, share * (c.high - c.low) / 2
    return replace(c, low=middle - half, high=middle + half)


def _range(c: Channel) -> str:
    return f"range of {c.name}"


def _constant(state: Channel) -> str:
    return f"time constant of {state.name}"


def _gain(c: Channel) -> str:
    return f"gain of {c.name}"


def _words(name: str) -> str:
    return name.replace("_", " ")


def _parts(value: Any) -> dict[str, Any]:
    """Return the fields of a dataclass or named tuple that may be parameters; none of anything else."""
    names = [f.name for f in fields(value)] if is_dataclass(value) else getattr(value, "_fields", ())
    return {name: getattr(value, name) for name in names if name not in _NOT_PARAMETERS}


def _numbers(value: Any) -> Iterator[tuple[str, float]]:
    """Yield the positive numbers of a dataclass or named tuple, also of those in it, by name."""
    for name, each in _parts(value).items():
        if isinstance(each, float) and 0 < each < np.inf:
            yield name, each
        else:
            yield from _numbers(each)


def _with_numbers(value: Any, values: Values) -> Any:
    """Return a dataclass or named tuple with other numbers."""
    changes: dict[str, Any] = {}
    for name, each in _parts(value).items():
        if isinstance(each, float) and _words(name) in values:
            changes[name] = values[_words(name)]
        elif _parts(each):
            changes[name] = _with_numbers(each, values)
    made: Any = value._replace(**changes) if hasattr(value, "_replace") else replace(value, **changes)
    return made
