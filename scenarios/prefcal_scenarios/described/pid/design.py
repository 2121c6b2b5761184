"""Choose operating point, steps, sampling time and duration for a plant to control."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import permutations
from math import floor, log10

import numpy as np
from jaxtyping import Float

from prefcal_env.controllers.pid_law import Tuning
from prefcal_env.controllers.rules import ProcessModel
from prefcal_env.envs.dead_time import dead_times
from prefcal_env.errors import PlantError, ScenarioError
from prefcal_env.experiments.experiment import Channel
from prefcal_env.plants.jacobians import D, U, X
from prefcal_env.plants.plant import Plant
from prefcal_env.plants.systems import LinearSystem
from prefcal_env.plants.systems.linear import local_system
from prefcal_env.wording import did_you_mean

from .operating_point import Held, OperatingPoint, operating_point
from .process import integrators_of, process_of

SAMPLES = 5
"""Samples in the effective dead time or the shortest time constant that matters."""
_SHARE = 0.2
"""Share of the input's range that a default step needs at rest."""
_PATIENCE = 2.2
"""Duration of a phase, in the time that the tuning in the middle takes to settle."""
_MOST = 1200
"""Largest number of samples in an experiment."""
_SETTLED = 0.02
"""Band of a step of 1 in which the tuning in the middle counts as settled."""


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
        tunings: Tunings of its PID by name: "robust", in the middle of the ranges, and rules.
    """

    output: int
    input: int
    channel: Channel
    start: float
    target: float
    process: ProcessModel
    load: float = 0.0
    phase: float = 0.0
    tunings: Mapping[str, Tuning] = field(default_factory=dict)

    @property
    def step(self) -> float:
        """Change of the reference."""
        return self.target - self.start

    def settling(self, time: float, peak: float) -> "Single":
        """Return the loop with phase and load for a tuning that settles in `time`.

        The load moves the output by about a third of the step, within the actuator.

        Args:
            time: Time until step and load have settled.
            peak: Peak of the output after a load of 1.
        """
        span = 0.15 * (self.channel.high - self.channel.low)
        load = nice(min(span, 0.35 * abs(self.step) / peak) if peak > 0 else span)
        return replace(self, load=load, phase=_PATIENCE * time)


@dataclass(frozen=True, slots=True, eq=False)
class Design:
    """What was chosen for a plant: operating point, sampling time and loops.

    `middle` is the tuning in the middle of the ranges, if it is not one of each loop.
    """

    point: OperatingPoint
    J: LinearSystem
    delay: Float[np.ndarray, "n_y n_u"]
    T_s: float
    loops: tuple[Single, ...]
    middle: Float[np.ndarray, " n"] = field(default_factory=lambda: np.zeros(0))

    @property
    def phase(self) -> float:
        """Duration of each phase: one step for each loop, then the loads."""
        return max(loop.phase for loop in self.loops)

    def around(self, plant: Plant, x: X, u: U, d: D) -> "Design":
        """Return the same choices for another plant, linearized where it starts."""
        J, delay = local_system(plant, x, u, d), dead_times(plant)
        return replace(self, point=OperatingPoint(x, u, d), J=J, delay=delay)

    def suffix(self, loop: int) -> str:
        """Return the end of the names of knobs and KPIs of a loop: none if there is only one."""
        return "" if len(self.loops) == 1 else f"_{loop + 1}"


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
    pairs = pairs_of(plant, J, _chosen(plant, reference))
    processes = [process_of(J.part([i], [j]), float(delay[i, j])) for i, j in pairs]
    T_s = _sampling_time(plant, processes)
    for _ in range(3):
        loops = tuple(
            _single(plant, point, T_s, i, j, process, reference or {})
            for (i, j), process in zip(pairs, processes, strict=True)
        )
        found = tuned(plant, Design(point, J, delay, T_s, loops))
        if horizon is not None:
            share = horizon / (len(loops) + 1)
            return replace(found, loops=tuple(replace(loop, phase=share) for loop in found.loops))
        samples = found.phase * (len(loops) + 1) / T_s
        if samples <= _MOST:
            break
        T_s = _allowed(plant, T_s * samples / (0.6 * _MOST))
    return found


def settling(
    M: Float[np.ndarray, "n n"], drive: Float[np.ndarray, "n 2"], rows: Float[np.ndarray, "2 n"], T_s: float
) -> tuple[float, float, float]:
    """Return the time until step and load have settled, the load's peak and the largest input.

    Args:
        M: Closed loop, x⁺ = M x.
        drive: What a unit step of the reference and a unit load add to x in each sample.
        rows: Output and input as functions of x.
        T_s: Sampling time.

    Raises:
        FloatingPointError: If the loop does not settle.
    """
    count = 200
    while count <= 25_600:
        x, found = np.zeros(drive.shape), np.zeros((count, 2, 2))
        for k in range(count):
            found[k] = rows @ x
            x = M @ x + drive
        step, load = found[:, 0].T
        if not np.isfinite(step).all():
            break
        peak = float(np.abs(load).max())
        late = np.flatnonzero((np.abs(step - 1) > _SETTLED) | (np.abs(load) > 5 * _SETTLED * peak))
        last = int(late[-1]) if len(late) else 0
        if last < 0.7 * count:
            return (last + 1) * T_s, peak, float(np.abs(found[:, 1, 0]).max())
        count *= 2
    raise FloatingPointError("the loop does not settle")


def pairs_of(plant: Plant, J: LinearSystem, outputs: tuple[int, ...]) -> tuple[tuple[int, int], ...]:
    """Return (output, input) of each loop, paired by the relative gain array near rest.

    Of all pairings with positive relative gains, the one whose gains are closest to 1.

    Source: Bristol (1966), On a new measure of interaction for multivariable process control,
    IEEE Trans. Automatic Control 11.

    Raises:
        ScenarioError: If there are more outputs than inputs.
    """
    n_u, names = len(plant.inputs), [plant.outputs[i].name for i in outputs]
    if len(outputs) == n_u == 1:
        return ((outputs[0], 0),)
    if len(outputs) > n_u:
        raise ScenarioError(
            f"{n_u} inputs cannot control {len(names)} outputs, {names}, each with a PID of its "
            f"own: name at most {n_u} of them, for example --reference {names[0]}=1"
        )
    # Near rest: far below all poles that are not integrators.
    rates = J.rates[np.argsort(np.abs(J.rates))]
    moving = np.abs(rates[integrators_of(rates, J.dt) :])
    G = J.at(1e-3j * (float(moving[0]) if len(moving) else 1 / (J.dt or 1.0)))[list(outputs)]
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
        raise ScenarioError(
            f"the inputs of plant {plant.name!r} cannot move its outputs {names} independently "
            "near the operating point: name one output to control"
        )
    return tuple(zip(outputs, best, strict=True))


def nice(value: float, *, up: bool = False) -> float:
    """Return `value` rounded down (or up) to 1, 2 or 5 times a power of ten."""
    power = 10.0 ** floor(log10(value))
    steps = [m * power for m in (1, 2, 5, 10)]
    if up:
        return float(f"{next(s for s in steps if s >= value * (1 - 1e-9)):.1g}")
    return float(f"{[s for s in steps if s <= value * (1 + 1e-9)][-1]:.1g}")


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
    every = tuple(range(len(names))) if len(names) <= len(plant.inputs) else (0,)
    return aimed or every


def _sampling_time(plant: Plant, processes: list[ProcessModel]) -> float:
    scales = [scale for scale in map(_scale, processes) if scale > 0]
    dt = float(getattr(plant, "sample_time", 0.0))
    # Nothing limits a plant that only integrates: its unit of time is as good as any other.
    return _allowed(plant, (min(scales) if scales else max(1.0, 10 * dt)) / SAMPLES)


def _allowed(plant: Plant, T_s: float) -> float:
    """Return a round sampling time near `T_s`, a multiple of the plant's own if it has one."""
    dt = float(getattr(plant, "sample_time", 0.0))
    return max(round(T_s / dt), 1) * dt if dt else nice(T_s * 1.3)


def _scale(process: ProcessModel) -> float:
    """Return the time that limits control: dead time and small lags, or a share of large ones."""
    lags = [np.inf] * process.integrators + list(process.lags)
    small = process.delay + sum(process.inverse) + sum(lags[3:]) + (lags[2] / 2 if lags[2:] else 0)
    shares = [small] + [s * T for s, T in zip((0.03, 0.1), lags[:2], strict=False) if np.inf > T]
    if len(lags) == 1 and lags[0] < np.inf:
        shares.append(0.1 * lags[0])
    return max((s for s in shares if s < np.inf), default=0.0)


def _single(
    plant: Plant,
    point: OperatingPoint,
    T_s: float,
    i: int,
    j: int,
    process: ProcessModel,
    reference: Mapping[str, float],
) -> Single:
    """Return the loop from input j to output i: its target, and limits of its input.

    The target is given, or what a fifth of the input's range achieves; without limits, the input
    gets ten times what the step needs.
    """
    y, u = plant.outputs[i], plant.inputs[j]
    start = float(plant.g(point.x, point.u, point.d)[i])
    target = reference.get(y.name, y.target)
    if target is None or abs(target - start) <= 1e-6 * max(abs(target), abs(start), 1e-300):
        if y.name in reference:
            raise ScenarioError(
                f"the reference of {y.name!r}, {target:g} {y.unit}, is where the experiment "
                "starts: give another one, so that there is a step"
            )
        target = _target(y, start, _default_step(plant, point, i, j, process, start))
    slow = max(process.lags, default=0.0) or process.delay or 10 * T_s
    gain = process.gain
    need = abs((target - start) / gain) / slow**process.integrators if gain else 1.0
    reach, rest = nice(10 * max(need, 1e-12), up=True), float(point.u[j])
    low = u.low if np.isfinite(u.low) else min(rest, u.high) - reach
    high = u.high if np.isfinite(u.high) else max(rest, u.low) + reach
    channel = replace(u, low=float(low), high=float(high))
    return Single(i, j, channel, start, float(target), process)


def _target(y: Channel, start: float, size: float) -> float:
    """Return a round reference about `size` away from the start, where there is room for it."""
    above, below = y.high - start, y.low - start
    sign = 1.0 if size <= 0.8 * above or above >= -below else -1.0
    step = nice(min(size, 0.5 * max(above, -below)))
    rounded = round(start + sign * step, 1 - floor(log10(step)))
    return rounded if abs(rounded - start) > step / 2 else start + sign * step


def _default_step(
    plant: Plant, point: OperatingPoint, i: int, j: int, process: ProcessModel, start: float
) -> float:
    output, channel = plant.outputs[i], plant.inputs[j]
    span = channel.high - channel.low
    if not np.isfinite(span):
        return 0.1 * abs(start) if abs(start) > 1e-6 else 1.0
    least = abs(process.gain) * _SHARE / 2 * span
    if process.integrators:
        if np.isfinite(output.high - output.low):
            return _SHARE * (output.high - output.low)
        slow = max(process.lags, default=0.0) or process.delay or 1.0
        return max(least * slow**process.integrators, 1e-12)
    if not process.unstable:
        u = point.u.copy()
        u[j] = min(u[j] + _SHARE * span, channel.high - 0.1 * span)
        x = Held(plant, u, point.d).settled(point.x)
        moved = 0.0 if x is None else abs(float(plant.g(x, u, point.d)[i]) - start)
        if moved > 1e-9 * (1 + abs(start)):
            return moved
    return max(least, 1e-12)
