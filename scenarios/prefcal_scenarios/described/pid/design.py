"""Choose operating point, steps, sampling time and duration for a plant to control."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import permutations
from math import floor, log10

import numpy as np
from jaxtyping import Float

from prefcal_env.controllers.pid_law import Tuning
from prefcal_env.controllers.rules import Process
from prefcal_env.envs.dead_time import dead_times
from prefcal_env.errors import PlantError, ScenarioError
from prefcal_env.experiments.experiment import Channel
from prefcal_env.plants.plant import Plant
from prefcal_env.plants.systems import LinearSystem
from prefcal_env.plants.systems.linear import local_system
from prefcal_env.wording import did_you_mean

from .operating_point import OperatingPoint, operating_point, settled
from .process import integrators_of, process_of

_SHARE = 0.2
"""Share of the input's range that a default step needs at rest."""
SAMPLES = 5
"""Samples in the effective dead time or the shortest time constant that matters."""
PATIENCE = 2.2
"""Duration of a phase, in the time that the tuning in the middle takes to settle."""
_MOST = 1200
"""Largest number of samples in an experiment."""


@dataclass(frozen=True, slots=True, eq=False)
class Tuned:
    """Tunings of one PID.

    Args:
        center: Tuning in the middle of the ranges.
        known: Tunings by rules of the field, by name.
    """

    center: Tuning
    known: Mapping[str, Tuning]


@dataclass(frozen=True, slots=True, eq=False)
class Single:
    """One loop: which output and input, its process, its target and its load.

    Args:
        output: Index of the output.
        input: Index of the input.
        channel: Channel of the input, with finite limits.
        start: Output at the start.
        target: Reference after the step.
        process: What limits its control.
        load: Load disturbance at the input.
        phase: Time that a step or a load takes with the tuning in the middle.
    """

    output: int
    input: int
    channel: Channel
    start: float
    target: float
    process: Process
    load: float = 0.0
    phase: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Design:
    """What was chosen for a plant: operating point, sampling time, loops and tunings of PIDs."""

    point: OperatingPoint
    J: LinearSystem
    delay: Float[np.ndarray, "n_y n_u"]
    T_s: float
    loops: tuple[Single, ...]
    tunings: tuple[Tuned, ...] = ()

    @property
    def phase(self) -> float:
        """Duration of each phase: one step for each loop, then the loads."""
        return max(loop.phase for loop in self.loops)


def pairs_of(
    plant: Plant, J: LinearSystem, outputs: tuple[int, ...]
) -> tuple[tuple[int, int], ...]:
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


def _near_rest(J: LinearSystem) -> np.ndarray:
    """Return G(jω) at a frequency far below all poles that are not integrators."""
    rates = J.rates[np.argsort(np.abs(J.rates))]
    moving = np.abs(rates[integrators_of(rates, J.dt) :])
    return J.at(1e-3j * (float(moving[0]) if len(moving) else 1 / (J.dt or 1.0)))


def scale_of(process: Process) -> float:
    """Return the time that limits control: dead time and small lags, or a share of large ones."""
    lags = [np.inf] * process.integrators + list(process.lags)
    small = process.delay + sum(process.inverse) + sum(lags[3:]) + (lags[2] / 2 if lags[2:] else 0)
    shares = [small] + [s * T for s, T in zip((0.03, 0.1), lags[:2], strict=False) if np.inf > T]
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


def design(
    plant: Plant,
    tuned: Callable[[Plant, Design], Design],
    reference: Mapping[str, float] | None = None,
    horizon: float | None = None,
) -> Design:
    """Return what was chosen for `plant`; `reference` and `horizon` are used as they are.

    Args:
        plant: Plant.
        tuned: Function that adds what follows from tuning the controller: loads and phases.
        reference: Reference by output.
        horizon: Duration of an experiment.

    Raises:
        ScenarioError: If there is no steady state, an output does not exist, a reference equals the
            start, or `tuned` finds no controller.
    """
    point = operating_point(plant)
    try:
        J = local_system(plant, point.x, point.u, point.d)
    except PlantError as error:
        raise ScenarioError(
            f"plant {plant.name!r} has no derivative at its steady state {point.x}: {error}"
        ) from error
    delay = dead_times(plant)
    outputs = _chosen(plant, reference)
    pairs = pairs_of(plant, J, outputs)
    processes = [process_of(J.part([i], [j]), float(delay[i, j])) for i, j in pairs]
    T_s = _sampling_time(plant, processes)
    for _ in range(3):
        loops = tuple(
            _single(plant, point, T_s, pair, process, reference or {})
            for pair, process in zip(pairs, processes, strict=True)
        )
        found = tuned(plant, Design(point, J, delay, T_s, loops))
        if horizon is not None:
            share = horizon / (len(loops) + 1)
            return replace(found, loops=tuple(replace(loop, phase=share) for loop in loops))
        samples = found.phase * (len(loops) + 1) / T_s
        if samples <= _MOST:
            break
        T_s = _allowed(plant, T_s * samples / (0.6 * _MOST))
    return found


def _chosen(plant: Plant, reference: Mapping[str, float] | None) -> tuple[int, ...]:
    """Return the outputs to control: those with a reference, or a target, or all."""
    names = [c.name for c in plant.outputs]
    for name in reference or ():
        if name not in names:
            raise ScenarioError(
                f"no output of plant {plant.name!r} is called {name!r}."
                f"{did_you_mean(name, names)} Expected one of {names}"
            )
    if reference:
        return tuple(names.index(name) for name in reference)
    aimed = tuple(i for i, c in enumerate(plant.outputs) if c.target is not None)
    if aimed:
        return aimed
    return tuple(range(len(names))) if len(names) <= len(plant.inputs) else (0,)


def _sampling_time(plant: Plant, processes: list[Process]) -> float:
    scales = [scale for scale in map(scale_of, processes) if scale > 0]
    dt = float(getattr(plant, "sample_time", 0.0))
    # Nothing limits a plant that only integrates: its unit of time is as good as any other.
    return _allowed(plant, (min(scales) if scales else max(1.0, 10 * dt)) / SAMPLES)


def _allowed(plant: Plant, T_s: float) -> float:
    """Return a round sampling time near `T_s`, a multiple of the plant's own if it has one."""
    dt = float(getattr(plant, "sample_time", 0.0))
    return max(round(T_s / dt), 1) * dt if dt else nice(T_s * 1.3)


def _single(
    plant: Plant, point: OperatingPoint, T_s: float, pair: tuple[int, int], process: Process,
    reference: Mapping[str, float],
) -> Single:  # fmt: skip
    """Return the loop of one pair of an output and an input."""
    i, j = pair
    start = float(plant.g(point.x, point.u, point.d)[i])
    target = _target(plant, point, pair, process, start, reference)
    channel = _limited(plant.inputs[j], float(point.u[j]), target - start, process, T_s)
    return Single(i, j, channel, start, target, process)


def _target(
    plant: Plant, point: OperatingPoint, pair: tuple[int, int], process: Process, start: float,
    reference: Mapping[str, float],
) -> float:  # fmt: skip
    """Return the reference after the step: given, or at a fifth of the input's range."""
    i, _ = pair
    channel = plant.outputs[i]
    given = reference.get(channel.name, channel.target)
    if given is not None and abs(given - start) > 1e-6 * max(abs(given), abs(start), 1e-300):
        return float(given)
    if channel.name in reference:
        raise ScenarioError(
            f"the reference of {channel.name!r}, {given:g} {channel.unit}, is where the experiment "
            "starts: give another one, so that there is a step"
        )
    size = _default_step(plant, point, pair, process, start)
    room = min(channel.high - start, np.inf), start - channel.low
    sign = 1.0 if size <= 0.8 * room[0] or room[0] >= room[1] else -1.0
    size = min(size, 0.5 * max(room))
    step = nice(size)
    digits = 1 - floor(log10(step))
    rounded = round(start + sign * step, digits)
    return rounded if abs(rounded - start) > step / 2 else start + sign * step


def _default_step(
    plant: Plant, point: OperatingPoint, pair: tuple[int, int], process: Process, start: float
) -> float:
    i, j = pair
    output, channel = plant.outputs[i], plant.inputs[j]
    span = channel.high - channel.low
    if not np.isfinite(span):
        return 0.1 * abs(start) if abs(start) > 1e-6 else 1.0
    if process.integrators:
        if np.isfinite(output.high - output.low):
            return _SHARE * (output.high - output.low)
        slow = max(process.lags, default=0.0) or process.delay or 1.0
        return max(abs(process.gain) * _SHARE / 2 * span * slow**process.integrators, 1e-12)
    if not process.unstable:
        u = point.u.copy()
        u[j] = min(u[j] + _SHARE * span, channel.high - 0.1 * span)
        x = settled(plant, point.x, u, point.d)
        moved = 0.0 if x is None else abs(float(plant.g(x, u, point.d)[i]) - start)
        if moved > 1e-9 * (1 + abs(start)):
            return moved
    return max(abs(process.gain) * _SHARE / 2 * span, 1e-12)


def _limited(channel: Channel, u0: float, step: float, process: Process, T_s: float) -> Channel:
    """Return the channel with finite limits: without any, ten times what the step needs."""
    slow = max(process.lags, default=0.0) or process.delay or 10 * T_s
    need = abs(step / process.gain) / slow**process.integrators if process.gain else 1.0
    reach = nice(10 * max(need, 1e-12), up=True)
    low = channel.low if np.isfinite(channel.low) else min(u0, channel.high) - reach
    high = channel.high if np.isfinite(channel.high) else max(u0, channel.low) + reach
    return replace(channel, low=float(low), high=float(high))


def load_of(channel: Channel, peak: float, step: float) -> float:
    """Return a load that moves the output by about a third of the step, within the actuator."""
    span = 0.15 * (channel.high - channel.low)
    return nice(min(span, 0.35 * step / peak) if peak > 0 else span)
