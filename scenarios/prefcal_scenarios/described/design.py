"""Choose operating point, steps, sampling time and duration for a plant to control."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import permutations, product
from math import floor, log10

import numpy as np
import scipy  # its parts load when they are used: not all plants need optimize
from jaxtyping import Complex, Float
from scipy.linalg import eigvals

from prefcal_env.controllers.margins import minimal
from prefcal_env.controllers.pid import ProcessModel, Tuning
from prefcal_env.envs.plant_env import dead_times
from prefcal_env.envs.task import acts_at
from prefcal_env.envs.varied_loop import rest
from prefcal_env.errors import PlantError, ScenarioError
from prefcal_env.experiments.experiment import Channel
from prefcal_env.plants.jacobians import D, U, X
from prefcal_env.plants.plant import Plant
from prefcal_env.plants.systems import LinearPlant, LinearSystem, local_system, motion, rates_of
from prefcal_env.wording import did_you_mean

# --- Find a steady state of a plant, near the middle of the range of its inputs.

_STEADY = 1e-7  # largest movement in the time constant of the plant, relative to the size of the states
_UNBALANCED = 1e-6  # share of what the inputs can do that may remain where something integrates
_INTEGRATING = 1e-9  # rate below which something integrates, relative to the fastest one
_DOUBLINGS = 60
_STEPS, _PRECISE = 10, 1e-12
"""Largest number of Newton steps, and the size of the last one, relative to the states."""


@dataclass(frozen=True, slots=True, eq=False)
class OperatingPoint:
    """A steady state: states (n_x,), inputs (n_u,) and measured disturbances (n_d,)."""

    x: X
    u: Float[np.ndarray, " n_u"]
    d: Float[np.ndarray, " n_d"]


def operating_point(plant: Plant) -> OperatingPoint:
    """Return a steady state of `plant`, at the middle of its inputs' ranges if possible.

    A plant that says at which inputs it rests is left there. If the plant has `x0`, the search starts
    there; otherwise in the middle of the states' limits, at 0 and at 1. A steady state to which the plant
    settles by itself comes first. If there is none for these inputs, as for a tank that integrates its
    flows, the inputs may move.

    Raises:
        ScenarioError: If there is no steady state within the limits.
    """
    known = plant.rest if isinstance(plant, LinearPlant) else None
    held = Held(plant, known[0] if known else _middles(plant.inputs), _middles(plant.disturbances))
    guesses = list(_guesses(plant))
    for find in (held.rest, held.settled, held.root):
        for guess in guesses:
            x = find(guess)
            if x is not None and _inside(plant, x):
                return OperatingPoint(held.centered(x), held.u, held.d)
    for guess in guesses:
        found = _joint(held, guess)
        if found is not None and _inside(plant, found.x):
            return replace(found, x=Held(plant, found.u, found.d).centered(found.x))
    raise ScenarioError(
        f"no steady state of plant {plant.name!r} was found within the limits of its states and "
        "inputs: widen the limits, or give the plant an x0 near one"
    )


@dataclass(frozen=True, slots=True, eq=False)
class Held:
    """A plant with inputs u and disturbances d held; its methods look for a state of rest."""

    plant: Plant
    u: Float[np.ndarray, " n_u"]
    d: Float[np.ndarray, " n_d"]

    def settled(self, x: X) -> X | None:
        """Return the state to which the plant settles from x, shape (n_x,); None if it does not."""
        rates = self._rates(x)
        if rates is None:
            return None
        T = 1 / max(float(rates.max(initial=0.0)), 1e-9)
        now = x
        for _ in range(_DOUBLINGS):
            try:
                now = self.plant.hold(now, self.u, self.d, np.array([T]))[-1]
            except (ArithmeticError, ValueError, PlantError):
                return None
            if not np.isfinite(now).all() or _size(now) > 1e9 * (1 + _size(x)):
                return None
            if self.rest(now) is not None:
                better = self._polish(now)
                near = better is not None and np.allclose(better, now, rtol=1e-3, atol=1e-6)
                return better if near else now
            T *= 1.5
        return None

    def rest(self, x: X) -> X | None:
        """Return x if the plant rests there: it hardly moves within its slowest time constant.

        What integrates has none: its inputs must cancel.
        """
        f, rates = self._motion(x)[0], self._rates(x)
        if rates is None or not np.isfinite(f).all():
            return None
        moving = rates[rates > _INTEGRATING * max(float(rates.max(initial=0.0)), 1e-300)]
        slowest = float(moving.min()) if len(moving) else 1.0
        size = np.abs(x).max(initial=1.0)
        small = np.abs(f).max(initial=0.0) <= _STEADY * slowest * size
        return x if small and (len(moving) == len(rates) or self._balance(x, f)) else None

    def _balance(self, x: X, f: X) -> bool:
        """Return whether all that integrates, the directions w with wᵀ A = 0, stays where it is."""
        J = local_system(self.plant, x, self.u, self.d)
        A, B = self._motion(x)[1], J.B / (J.dt or 1.0)
        left, sizes, _ = np.linalg.svd(A)
        w = left[:, sizes <= _INTEGRATING * max(float(sizes.max(initial=0.0)), 1e-300)].T
        spans = np.array([c.high - c.low for c in self.plant.inputs])
        acting = np.abs(B) @ np.where(np.isfinite(spans), spans, np.maximum(np.abs(self.u), 1.0))
        rounded = np.abs(A) @ np.abs(x)
        return bool(np.all(np.abs(w @ f) <= np.abs(w) @ (_UNBALANCED * acting + 1e-12 * rounded)))

    def centered(self, x: X) -> X:
        """Return a state of rest x, moved along what integrates to the middle of the outputs' limits.

        x stays if the outputs are within them.
        """
        y, (low, high) = self.plant.g(x, self.u, self.d), _limits(self.plant.outputs)
        out = np.isfinite(low) & np.isfinite(high) & ~((low < y) & (y < high))
        if not out.any():
            return x
        _, sizes, right = np.linalg.svd(self._motion(x)[1])
        V = right[sizes <= _INTEGRATING * max(float(sizes.max(initial=0.0)), 1e-300)].T
        C = local_system(self.plant, x, self.u, self.d).C
        moved = x + V @ np.linalg.lstsq(C[out] @ V, ((low + high) / 2 - y)[out], rcond=1e-9)[0]
        return x if self.rest(moved) is None or not _inside(self.plant, moved) else moved

    def root(self, x: X) -> X | None:
        """Return a solution of f(x, u, d) = 0 for x near the given one, or None."""
        try:
            with np.errstate(all="ignore"):
                return self.rest(np.asarray(scipy.optimize.root(self._motion, x, jac=True).x, dtype=float))
        except (ArithmeticError, ValueError):
            return None

    def _polish(self, x: X) -> X | None:
        """Return the steady state beside x by Newton's method, which needs no scipy, or None."""
        now = x
        for _ in range(_STEPS):
            try:
                step = np.linalg.solve(*self._motion(now)[::-1])
            except np.linalg.LinAlgError:  # an integrator
                break
            now = now - step
            if not _size(step) > _PRECISE * _size(now):
                return self.rest(now) if np.isfinite(now).all() else None
        return self.root(x)

    def _motion(self, x: X) -> tuple[X, Float[np.ndarray, "n_x n_x"]]:
        return motion(self.plant, x, self.u, self.d)

    def _rates(self, x: X) -> X | None:
        """Return the magnitude of the eigenvalues at a point; None if f is not finite there."""
        try:
            A = self._motion(x)[1]
        except (ArithmeticError, ValueError):
            return None
        return np.abs(np.linalg.eigvals(A)) if np.isfinite(A).all() else None


def _joint(held: Held, x: X) -> OperatingPoint | None:
    """Return a solution of f(x, u, d) = 0 near x and u, within their limits, or None."""
    plant, d, n = held.plant, held.d, len(x)
    low, high = _limits((*plant.states, *plant.inputs))
    start = np.clip(np.concatenate([x, held.u]), low, high)
    try:
        with np.errstate(all="ignore"):
            found = scipy.optimize.least_squares(
                lambda v: motion(plant, v[:n], v[n:], d)[0],
                start,
                bounds=(low, high),
                xtol=1e-14,
                ftol=1e-14,
                gtol=1e-14,
            )
    except (ArithmeticError, ValueError):
        return None
    u, ends = found.x[n:], np.array([low[n:], high[n:]])
    near = np.abs(u - ends) <= _UNBALANCED * (ends[1] - ends[0])  # the search stays within the limits
    at_limits = np.where(near[0], ends[0], np.where(near[1], ends[1], u))
    points = product((at_limits, u), (start[:n], found.x[:n]))
    return next((OperatingPoint(x, u, d) for u, x in points if Held(plant, u, d).rest(x) is not None), None)


def _size(x: X) -> float:
    """Return the largest magnitude in x, shape (n_x,); 0 for a plant without states."""
    return float(np.abs(x).max(initial=0.0))


def _limits(channels: tuple[Channel, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Return the lower and upper limits, each shape (n,)."""
    return np.array([c.low for c in channels]), np.array([c.high for c in channels])


def _middles(channels: tuple[Channel, ...]) -> Float[np.ndarray, " n"]:
    """Return the middle of each range; without one, what is in it and nearest to 0."""
    low, high = _limits(channels)
    whole = np.isfinite(low) & np.isfinite(high)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.where(whole, (low + high) / 2, np.clip(0.0, low, high)))


def _guesses(plant: Plant) -> Iterator[X]:
    start = getattr(plant, "x0", None)
    if start is not None and np.shape(start) == (len(plant.states),):
        yield np.array(start, dtype=float)
    yield _middles(plant.states)
    for value in (0.0, 1.0):
        yield np.clip(np.full(len(plant.states), value), *_limits(plant.states))


def _inside(plant: Plant, x: X) -> bool:
    (low, high), margin = _limits(plant.states), 1e-9 * (1 + np.abs(x))
    return bool(np.all((low - margin <= x) & (x <= high + margin)))


# --- What limits the control of a linear process: its gain, lags, dead time and unstable parts.

_INTEGRATES = 1e-6  # A pole this small relative to the largest one integrates
_ROUNDING = 1e-12  # rounding spreads k equal poles over a circle whose radius is the k-th root of about this
_AT_ZERO = 1e-3  # magnitude below which a discrete pole counts as one at 0


def process_of(J: LinearSystem, delay: float = 0.0) -> ProcessModel:
    """Return the process from one input to one output, by its linearization.

    The rules are for continuous processes: poles and zeros of a discrete one count as those with
    the same decay, and the samples in which its impulse response is still 0 as dead time.
    """
    M = minimal(J)
    waiting = _waiting(M)
    poles = M.rates[np.argsort(M.rates.real)][waiting:]
    poles = poles[np.argsort(np.abs(poles))]
    integrators = integrators_of(poles, M.dt)
    others = poles[integrators:]
    swinging = others[np.abs(others.imag) > 1e-6 * np.abs(others)]
    zeros = _zeros(M)
    return ProcessModel(
        gain=_gain(M, poles, integrators),
        integrators=integrators,
        lags=tuple(sorted((1 / np.abs(others)).tolist(), reverse=True)),
        inverse=tuple((1 / np.abs(zeros[zeros.real > 0])).tolist()),
        leads=tuple((1 / np.abs(zeros[(zeros.real < 0) & (zeros != 0)])).tolist()),
        delay=delay + waiting * M.dt,
        unstable=bool((others.real > 0).any()),
        damping=float((-swinging.real / np.abs(swinging)).min(initial=1.0)),
    )


def integrators_of(rates: Complex[np.ndarray, " n"], dt: float) -> int:
    """Return how many poles, the smallest rate first, integrate; `dt` is 0 for a continuous system."""
    sizes = np.abs(rates)
    relative = int(np.count_nonzero(sizes <= _INTEGRATES * sizes.max(initial=0.0)))
    if not dt:
        return relative
    for k in range(len(rates), relative, -1):
        # Equal poles are spread around their true place; slow lags lie on one side of it.
        radius = _ROUNDING ** (1 / k)
        aside = abs(complex(rates[:k].mean())) * dt
        if sizes[k - 1] * dt <= radius and aside <= max(0.01 * radius, _ROUNDING):
            return k
    return relative


def _waiting(M: LinearSystem) -> int:
    """Return the samples of dead time in a discrete system: its pure delays, poles at 0."""
    if not M.dt or M.D.any():
        return 0
    x, size = M.B[:, 0], float(np.abs(M.B).max(initial=0.0) * np.abs(M.C).max(initial=0.0))
    for samples in range(len(M.A)):
        if abs(float(M.C[0] @ x)) > 1e-9 * size:
            return min(samples, _at_zero(M))  # lags also make a response start late
        x = M.A @ x
    return 0


def _at_zero(M: LinearSystem) -> int:
    """Return how many poles of a discrete system are at 0."""
    sizes = np.sort(np.abs(np.linalg.eigvals(M.A)))
    radii = np.maximum(_AT_ZERO, _ROUNDING ** (1 / np.arange(1, len(sizes) + 1)))
    return int(np.flatnonzero(sizes <= radii).max(initial=-1)) + 1


def _gain(M: LinearSystem, poles: Complex[np.ndarray, " k"], integrators: int) -> float:
    """Return the limit of s^n G(s) for s to 0, by its value at a very small s."""
    if not len(M.A):
        return float(M.D[0, 0])
    sizes = np.abs(poles)
    s = 1e-4 * (sizes.max(initial=0.0) or 1.0) * (1e-2 if not integrators else 1.0)
    if integrators < len(poles) or M.dt:
        slowest = sizes[integrators] if integrators < len(poles) else 1 / M.dt
        # Nearer to 0 than rounding has put an integrator, the response is that of a lag.
        rounded = 30 * sizes[:integrators].max(initial=0.0)
        s = min(max(1e-3 * slowest, rounded), 0.1 * slowest)
    return float((M.at(1j * s)[0, 0] * (1j * s) ** integrators).real)


def _zeros(M: LinearSystem) -> Complex[np.ndarray, " k"]:
    """Return the finite zeros, as rates: generalized eigenvalues of the system matrix."""
    n = len(M.A)
    if not n:
        return np.zeros(0, dtype=complex)
    pencil = np.block([[M.A, M.B], [M.C, M.D]])
    mass = np.zeros_like(pencil)
    mass[:n, :n] = np.eye(n)
    alpha, beta = eigvals(pencil, mass, homogeneous_eigvals=True)
    finite = np.abs(beta) > 1e-9 * (np.abs(alpha) + np.abs(beta))
    zeros = np.asarray(alpha[finite] / beta[finite], dtype=complex)
    if M.dt:
        zeros = zeros[zeros.real > 0]  # the others come from sampling
    rates = rates_of(zeros, M.dt)
    fastest = float(np.abs(M.rates).max())
    return np.asarray(rates[np.abs(rates) < 1e3 * max(fastest, 1e-300)])


# --- Choose operating point, steps, sampling time and duration for a plant to control.

SAMPLES = 5
"""Samples in the effective dead time or the shortest time constant that matters."""
_HIDDEN = 3.0  # ratio of a lag and a zero below which they about cancel
_SHARE = 0.2  # share of the input's range that a default step needs at rest
_PATIENCE = 2.2  # duration of a phase, in the time that the tuning in the middle takes to settle
_MOST = 1200  # largest number of samples in an experiment
_LEGS = 10  # steady states on the way from the start to the references
_SETTLED = 0.02  # band of a step of 1 in which the tuning in the middle counts as settled


@dataclass(frozen=True, slots=True, eq=False)
class Single:
    """One loop: which output and input, its process, its target and its load."""

    output: int  # index of the output
    input: int  # index of the input
    channel: Channel  # channel of the input, with finite limits
    rest: float  # input at the start
    start: float  # output at the start
    target: float  # reference after the step
    process: ProcessModel  # what limits its control
    load: float = 0.0  # load disturbance at the input
    phase: float = 0.0  # time that a step or a load takes with the tuning in the middle
    # tunings of its PID by name: "MIGO", in the middle of the ranges, and rules
    tunings: Mapping[str, Tuning] = field(default_factory=dict)

    @property
    def step(self) -> float:
        """Change of the reference."""
        return self.target - self.start

    def settling(self, time: float, peak: float) -> "Single":
        """Return the loop with phase and load for a tuning that settles in `time`.

        The load moves the output, whose peak after a load of 1 is `peak`, by about a third of the
        step, within the actuator, which can act against it.
        """
        span = 0.15 * (self.channel.high - self.channel.low)
        load = nice(min(span, 0.35 * abs(self.step) / peak) if peak > 0 else span)
        return replace(self, load=-load if self.way > 0 else load, phase=_PATIENCE * time)

    @property
    def way(self) -> int:
        """1 or -1 if the input rests at a limit, from which it can only rise or fall; else 0."""
        return way_of(self.rest, self.channel)


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
    lag: float = 0.0  # time constant of the actuators, in the plant's unit of time

    @property
    def phase(self) -> float:
        """Duration of each phase: one step for each loop, then the loads."""
        return max(loop.phase for loop in self.loops)

    def acts(self, k: int, samples: Float[np.ndarray, " N"] | None = None) -> float:
        """Return when step k acts, or after the last one the loads: at the first sample from k phases on.

        Without the samples of a run, they are those of one whose periods have one length.
        """
        if samples is None:
            samples = np.arange(0.0, (len(self.loops) + 1) * self.phase, self.T_s)
        return acts_at(k * self.phase, samples)

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

    `tuned` adds what follows from tuning the controller: loads and phases.

    Raises:
        ScenarioError: If there is no steady state, an output does not exist, a reference equals the
            start or is out of reach of the inputs, or `tuned` finds no controller.
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
        _check_reached(plant, J, point, loops)  # last: what no controller controls is said better by `tuned`
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
    for lead in process.leads:
        # A slow mode that a zero nearly hides does not slow down control.
        hidden = min(lags, key=lambda lag: abs(np.log(lag / lead)), default=np.inf)
        if len(lags) > 1 and hidden < _HIDDEN * lead and lead < _HIDDEN * hidden:
            lags.remove(hidden)
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
        way = way_of(float(point.u[j]), u) * float(np.sign(process.gain))
        target = _target(y, start, _default_step(plant, point, i, j, process, start), way)
    slow = max(process.lags, default=0.0) or process.delay or 10 * T_s
    gain = process.gain
    need = abs((target - start) / gain) / slow**process.integrators if gain else 1.0
    reach, rest = nice(10 * max(need, 1e-12), up=True), float(point.u[j])
    low = u.low if np.isfinite(u.low) else min(rest, u.high) - reach
    high = u.high if np.isfinite(u.high) else max(rest, u.low) + reach
    channel = replace(u, low=float(low), high=float(high))
    return Single(i, j, channel, rest, start, float(target), process)


def _held_at(plant: Plant, J: LinearSystem, point: OperatingPoint, loops: Sequence[Single]) -> U | None:
    """Return inputs that hold the outputs of loops at their targets; None if none do."""
    chosen, steps = [k.output for k in loops], np.array([k.target - k.start for k in loops])
    if isinstance(plant, LinearPlant):
        rows = np.block([[J.A - (np.eye(len(J.A)) if J.dt else 0.0), J.B], [J.C[chosen], J.D[chosen]]])
        wanted = np.concatenate([np.zeros(len(J.A)), steps])
        moved = np.linalg.lstsq(rows, wanted, rcond=1e-12)[0]
        holds = np.abs(rows @ moved - wanted).max() <= 1e-6 * np.abs(steps).max()
        return point.u + moved[len(J.A) :] if holds else None
    found: tuple[X, U] | None = (point.x, point.u)
    for share in np.linspace(0, 1, _LEGS + 1)[1:]:  # from afar, Newton's method may miss a steady state
        aims = [k.start + share * (k.target - k.start) for k in loops]
        found = found and rest(plant, *found, point.d, chosen, aims)
    return None if found is None else found[1]


def _check_reached(plant: Plant, J: LinearSystem, point: OperatingPoint, loops: Sequence[Single]) -> None:
    """Refuse references beyond limits of outputs, or at which no input within its limits holds the plant."""
    outputs = [(plant.outputs[k.output], k.target) for k in loops]
    aims = ", ".join(f"{y.name} = {target:g} {y.unit}".rstrip() for y, target in outputs)
    for y, target in outputs:
        if not y.low < target < y.high:
            limits = f"{y.low:g} to {y.high:g} {y.unit}".rstrip()
            raise ScenarioError(f"the reference {aims} must be inside the limits of {y.name!r}, {limits}")
    found = _held_at(plant, J, point, loops)
    if found is None:
        raise ScenarioError(
            f"{aims} is out of reach: plant {plant.name!r} has no steady state there, from which inputs "
            "hold it: choose another reference"
        )
    for u, value in zip(plant.inputs, found, strict=True):
        room = 1e-6 * max(abs(u.low), abs(u.high)) if np.isfinite([u.low, u.high]).all() else 0.0
        if not u.low - room <= value <= u.high + room:
            needed = f"{u.name} = {value:.4g} {u.unit}".rstrip()
            raise ScenarioError(
                f"{aims} is out of reach: plant {plant.name!r} rests there with {needed}, outside its limits "
                f"{u.low:g} to {u.high:g}: choose another reference, or widen the limits"
            )


def way_of(rest: float, u: Channel) -> int:
    """Return 1 or -1 if an input rests at a limit, from which it can only rise or fall; else 0."""
    room = 1e-6 * (u.high - u.low)
    return int(rest - u.low <= room) - int(u.high - rest <= room) if np.isfinite(room) else 0


def _target(y: Channel, start: float, size: float, way: float) -> float:
    """Return a round reference about `size` away from the start, where there is room for it.

    It is above if `way` is 1, and below if it is -1, if there is room at all.
    """
    above, below = y.high - start, y.low - start
    sign = 1.0 if size <= 0.8 * above or above >= -below else -1.0
    if way and (above if way > 0 else -below) > 0:
        sign, size = way, min(size, 0.8 * (above if way > 0 else -below))
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
