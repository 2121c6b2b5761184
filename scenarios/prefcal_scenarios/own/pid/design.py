"""Choose step, times and ranges of the knobs for the PIDs of a plant."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import permutations
from math import floor, log10

import numpy as np
from jaxtyping import Float

from prefcal_env.controllers.rules import Process, Tuning, robust, simc, ziegler_nichols
from prefcal_env.controllers.sampled import Sampled, sampled
from prefcal_env.errors import ScenarioError
from prefcal_env.experiments.experiment import Channel
from prefcal_env.plants.plant import Jacobians, Plant

from .operating_point import OperatingPoint, settled
from .process import process_of
from .response import responses

_SHARE = 0.2
"""Share of the input's range that a default step needs at rest."""
_SAMPLES = 5
"""Samples in the effective dead time or the shortest time constant that matters."""
_MOST = 1200
"""Largest number of samples in an experiment."""


@dataclass(frozen=True, slots=True, eq=False)
class Single:
    """One PID loop: which output and input, its process, its target and tunings of it.

    Args:
        output: Index of the output.
        input: Index of the input.
        channel: Channel of the input, with finite limits.
        start: Output at the start.
        target: Reference after the step.
        load: Load disturbance at the input.
        center: Tuning in the middle of the ranges.
        known: Tunings by rules of the field, by name.
        phase: Time that a step or a load takes with the tuning in the middle.
    """

    output: int
    input: int
    channel: Channel
    start: float
    target: float
    load: float
    center: Tuning
    known: Mapping[str, Tuning]
    phase: float


@dataclass(frozen=True, slots=True, eq=False)
class Design:
    """Everything that was chosen for a plant: operating point, sampling time and loops."""

    point: OperatingPoint
    J: Jacobians
    delay: Float[np.ndarray, "n_y n_u"]
    T_s: float
    loops: tuple[Single, ...]

    @property
    def phase(self) -> float:
        """Duration of each phase: one step for each loop, then the loads."""
        return max(loop.phase for loop in self.loops)


def pairs_of(plant: Plant, J: Jacobians, outputs: tuple[int, ...]) -> tuple[tuple[int, int], ...]:
    """Return (output, input) of each loop, paired by the relative gain array near rest.

    Of all pairings with positive relative gains, the one whose gains are closest to 1.

    Source: Bristol (1966), On a new measure of interaction for multivariable process control,
    IEEE Trans. Automatic Control 11.

    Raises:
        ScenarioError: If there are more outputs than inputs.
    """
    n_u = len(plant.inputs)
    if len(outputs) == n_u == 1:
        return ((outputs[0], 0),)
    if len(outputs) > n_u:
        names = [plant.outputs[i].name for i in outputs]
        raise ScenarioError(
            f"{n_u} inputs cannot control {len(names)} outputs, {names}, each with a PID of its "
            f"own: name at most {n_u} of them, for example --reference {names[0]}=1"
        )
    G = _near_rest(J)[list(outputs)]
    best, closest = None, np.inf
    for chosen in permutations(range(n_u), len(outputs)):
        square = G[:, chosen]
        if np.linalg.matrix_rank(square) < len(outputs):
            continue
        gains = np.diag(square * np.linalg.inv(square).T).real
        distance = float(np.abs(gains - 1).sum()) + 1e3 * int((gains <= 0).sum())
        if distance < closest:
            best, closest = chosen, distance
    if best is None:
        names = [plant.outputs[i].name for i in outputs]
        raise ScenarioError(
            f"the inputs of plant {plant.name!r} cannot move its outputs {names} independently "
            "near the operating point: name one output to control"
        )
    return tuple(zip(outputs, best, strict=True))


def _near_rest(J: Jacobians) -> np.ndarray:
    """Return G(jω) at a frequency far below all poles that are not integrators."""
    rates = np.abs(np.linalg.eigvals(J.A)) if len(J.A) else np.zeros(0)
    moving = rates[rates > 1e-6 * rates.max(initial=0.0)]
    s = 1e-3j * (float(moving.min()) if len(moving) else 1.0)
    return np.asarray(J.C @ np.linalg.solve(s * np.eye(len(J.A)) - J.A, J.B) + J.D)


def part(J: Jacobians, output: int, input_: int) -> Jacobians:
    """Return the matrices from one input to one output."""
    return Jacobians(J.A, J.B[:, [input_]], J.C[[output]], J.D[[output]][:, [input_]])


def scale_of(process: Process) -> float:
    """Return the time that limits control: dead time and small lags, or a share of large ones."""
    lags = [np.inf] * process.integrators + list(process.lags)
    small = process.delay + sum(process.inverse) + sum(lags[3:]) + (lags[2] / 2 if lags[2:] else 0)
    shares = [small] + [s * T for s, T in zip((0.03, 0.1), lags[:2], strict=False) if T < np.inf]
    if len(lags) == 1 and lags[0] < np.inf:
        shares.append(0.1 * lags[0])
    return max((s for s in shares if s < np.inf), default=0.0)


def nice(value: float, *, up: bool = False) -> float:
    """Return `value` rounded down (or up) to 1, 2 or 5 times a power of ten."""
    power = 10.0 ** floor(log10(value))
    steps = [m * power for m in (1, 2, 5, 10)]
    if up:
        return float(f"{next(s for s in steps if s >= value * (1 - 1e-9)):.1g}")
    return float(f"{[s for s in steps if s <= value * (1 + 1e-9)][-1]:.1g}")
