"""Stability margins of a sampled loop, broken at the plant's input, for any controller."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import islice
from operator import itemgetter
from typing import Any

import numpy as np
import scipy
from jaxtyping import Complex, Float
from scipy.linalg import block_diag

from prefcal_env.envs.closed_loop import ClosedLoop
from prefcal_env.envs.plant_env import PlantEnv, dead_times, delays_of
from prefcal_env.envs.task import Task
from prefcal_env.envs.varied_loop import at_target
from prefcal_env.errors import SettingsError
from prefcal_env.experiments.experiment import Controller, Experiment, Measurement
from prefcal_env.experiments.kpis import KPI
from prefcal_env.plants.plant import Plant
from prefcal_env.plants.systems import LinearSystem, local_system

# --- A linear plant as a digital controller sees it: sampled, with dead time and held inputs.


def sampled(J: LinearSystem, T_s: float, delay: Float[np.ndarray, "n_y n_u"] | None = None) -> LinearSystem:
    """Return x⁺ = A x + B u, y = C x of a linear plant, exact also for fractions of T_s.

    u is held for T_s, and x holds delayed inputs, too. With a direct feedthrough D, an output is
    measured before the next input acts.

    Source: Åström, Wittenmark (1997), Computer-Controlled Systems, section 2.3 (sampling a
    continuous-time state-space system), with dead time.

    Args:
        J: Matrices of the plant.
        T_s: Sampling time; if the plant is discrete, a multiple of its sample time.
        delay: Dead time from each input to each output, in the unit of T_s; None for none.
    """
    delays = np.zeros(J.D.shape) if delay is None else delay
    if (delays == delays[0]).all():
        return _sampled(J, T_s, delays[0])
    # Each output has states of its own, which its dead times reach.
    each = [_sampled(J.part([i], range(J.D.shape[1])), T_s, row) for i, row in enumerate(delays)]
    A, C = (block_diag(*(getattr(s, name) for s in each)) for name in "AC")
    return LinearSystem(A, np.vstack([s.B for s in each]), C, np.zeros(J.D.shape), T_s)


def _sampled(J: LinearSystem, T_s: float, delay: Float[np.ndarray, " n_u"]) -> LinearSystem:
    """Return the sampled model with a dead time for each input: a number of samples and a rest."""
    n, n_u, n_y = J.sizes
    parts = [divmod(float(d), T_s) for d in delay]
    lengths = [int(samples) + 1 for samples, _ in parts]  # inputs of the past, newest first
    size = n + sum(lengths)
    A, B, C = np.zeros((size, size)), np.zeros((size, n_u)), np.zeros((n_y, size))
    (A[:n, :n], acting), C[:, :n] = J.held(T_s), J.C
    start = n
    for i, ((_, rest), length) in enumerate(zip(parts, lengths, strict=True)):
        end, now = start + length, acting[:, i]
        # The rest of a dead time: in each period first the older input acts, then the newer one.
        if rest > 1e-9 * T_s:
            Phi, Gamma = J.held(T_s - rest)
            A[:n, end - 1], now = Phi @ J.held(rest)[1][:, i], Gamma[:, i]
        if length > 1:
            A[:n, end - 2] = now
        else:
            B[:n, i] = now
        B[start, i] = 1.0
        A[start + 1 : end, start : end - 1] = np.eye(length - 1)
        # A direct feedthrough shows the input that acts now, which is the oldest one in memory.
        C[:, end - 1] = J.D[:, i]
        start = end
    return LinearSystem(A, B, C, np.zeros((n_y, n_u)), T_s)


def minimal(J: LinearSystem) -> LinearSystem:
    """Return the controllable and observable part of a linear plant (Kalman decomposition)."""
    A, B, C = _reachable(J.A, J.B, J.C)
    At, Ct, Bt = _reachable(A.T, C.T, B.T)
    return LinearSystem(At.T, Bt.T, Ct.T, J.D, J.dt)


def _reachable(
    A: Float[np.ndarray, "n n"], B: Float[np.ndarray, "n n_u"], C: Float[np.ndarray, "n_y n"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the part of (A, B, C) that the inputs reach, in an orthonormal basis."""
    scale = max(float(np.abs(A).max(initial=0.0)), 1e-300)
    basis = np.zeros((len(A), 0))
    new = B / max(float(np.abs(B).max(initial=0.0)), 1e-300)
    for _ in range(len(A)):
        for column in new.T:
            for _again in range(2):  # twice is enough against rounding
                column = column - basis @ (basis.T @ column)
            norm = float(np.linalg.norm(column))
            if norm > 1e-9 and basis.shape[1] < len(A):
                basis = np.column_stack([basis, column / norm])
        new = A @ basis / scale
    return basis.T @ A @ basis, basis.T @ B, C @ basis


Response = Callable[[Float[np.ndarray, " m"]], Complex[np.ndarray, "m n n"]]
"""Function of angular frequencies that returns the sensitivity (1 + L)^-1 at the plant's input."""

UNCONSTRAINED = "the sampled loop while no limit acts, linearized at the operating point"
"""What margins hold for."""
_SMALL = 1e-4  # size of the impulse, as a share of the input's range: far from limits, and above rounding
_LOOKS = tuple(64 * 2**k for k in range(9))
"""Numbers of samples after which to look whether a response has died out. After the last one, a
slow loop counts as stable if the response still shrinks; its slowest part is continued, see `_tail`."""
_ROUNDING = 1e-7  # share of an impulse that rounding can leave for good, where gains are large
_NOTHING = 1e-6  # loop gain below which its phase is rounding: no gain that matters brings it to -1
_STEADY = 100.0  # steady loop gain above which there may be integral action: it is infinite but for rounding


Point = tuple[float, complex]  # an angular frequency, and the loop gain there


@dataclass(frozen=True, slots=True, eq=False)
class OpenLoop:
    """Frequency response of a loop that is opened at one input at a time, with the others closed."""

    omega: Float[np.ndarray, " m"]  # angular frequencies, per unit of time; of a sampled loop up to Nyquist's
    L: Complex[np.ndarray, "m n"]  # loop gain at each input; a loop at -1 is at the end of its margins
    points: Mapping[str, Point]  # where the gain, gain reduction and phase margins are, if they are finite


@dataclass(frozen=True, slots=True)
class Margins:
    """How far a loop is from instability, at the plant's input.

    Gain, phase and delay margin are the smallest ones of one input at a time, with the other loops
    closed. The disk margin lets gain and phase of all inputs change together. An unstable loop has
    none: 1, 0 and 0.

    Source: Seiler, Packard, Gahinet (2020), An introduction to disk margins, IEEE Control Systems
    Magazine 40, for the symmetric (balanced) disk margin: α = 1 / sup μ(S - 1/2).

    Args:
        gain: Factor by which the loop gain may grow; infinite for any.
        gain_reduction: Factor to which it may fall; 0 for any.
        phase: Phase that may be lost at any frequency, degrees; 180 for any.
        delay: Additional dead time, in the plant's unit of time; infinite for any.
        M_s: Maximum sensitivity, max σ(S).
        disk: Disk margin α, 0 to 2 and more.
        loop: Response that they were read from; None for an unstable loop.
        place: Where the plant was linearized, in words; "" if it is the same everywhere, or not said.
        target: Margins where the task ends, of a plant that is not linear and can rest there.
    """

    gain: float
    gain_reduction: float
    phase: float
    delay: float
    M_s: float
    disk: float
    loop: OpenLoop | None = field(default=None, repr=False, compare=False)
    place: str = field(default="", repr=False, compare=False)
    target: "Margins | None" = field(default=None, repr=False, compare=False)


UNSTABLE = Margins(1.0, 1.0, 0.0, 0.0, np.inf, 0.0)  # margins of a loop that is not stable


def margins(plant: Plant, task: Task, make: Callable[[], Controller], *, settle: int = 200) -> Margins:
    """Return the margins of the loop of `plant` and the controller that `make` returns.

    The controller runs as it is, on the plant linearized where the task starts, with its dead time.
    An impulse at the plant's input, too small to reach a limit, shows the sensitivity there; its
    mean over both signs is exact to the second order. So this holds for any law, with its sampling,
    filters and estimator. Of an MPC it is its law while no limit acts at this point.

    The delay margin takes the delay as a loss of phase ω τ, as for a continuous signal.

    Args:
        plant: Plant.
        task: Task that starts at a steady state, within the limits of the plant's inputs.
        make: Function that returns a new controller; it is called twice for each input.
        settle: Samples before the impulse, in which an estimator finds its steady gain.

    Raises:
        SettingsError: If an input is at one of its limits, or the controller answers large deviations
            but no small ones (a dead band), so that there is no linear law.
        PlantError: If a derivative of the plant is not finite.
    """
    start = _Start.of(plant, task)
    records = [start.record(make, j, settle) for j in range(len(start.u))]
    known = [record for record in records if record is not None]
    if len(known) < len(records):
        return UNSTABLE
    length = max(map(len, known))
    S = np.stack([np.pad(record, ((0, length - len(record)), (0, 0))) for record in known], axis=2)
    T_s, ratio = make().T_s, _tail(S)

    def response(omega: Float[np.ndarray, " m"]) -> Complex[np.ndarray, "m n n"]:
        back = np.exp(-1j * omega * T_s)[:, None, None]
        rest = S[-1] * back ** (length - 1) * ratio * back / (1 - ratio * back)
        if len(omega) * length < 100_000:
            died = np.tensordot(np.exp(-1j * np.outer(omega * T_s, np.arange(length))), S, 1)
        else:
            values = np.polynomial.polynomial.polyval(np.exp(-1j * omega * T_s), S)
            died = np.moveaxis(np.asarray(values), -1, 0)
        return np.asarray(died + rest)

    # From a tenth of what so many samples, or the slowest part, can tell to Nyquist's frequency.
    slowest = min([2 * np.pi / length, *(0.1 * (1 - ratio[ratio > 0]))])
    return margins_of(response, np.geomspace(0.1 * slowest / T_s, np.pi / T_s, 1500))


def margins_at_target(plant: Plant, target: Task | None, make: Callable[[], Controller]) -> Margins | None:
    """Return the margins at a task of `at_target`; None without one, or if there are none."""
    try:
        return None if target is None else margins(plant, target, make)
    except Exception:  # what people's own plants and controllers raise away from their start
        return None


def _tail(S: Float[np.ndarray, "N n n"]) -> Float[np.ndarray, " n"]:
    """Return by what factor each input's response shrinks from sample to sample after the last look.

    What is left of a slow integral by then is little, but it lasts: without it the loop would seem to
    have no integral action, and the phase at a low crossing is wrong. 0 for a response that has died
    out, or whose rest is not a single exponential.
    """
    span = _LOOKS[-1] // 4
    if len(S) < _LOOKS[-1]:
        return np.zeros(S.shape[2])
    before, last = S[-1 - span], S[-1]
    share = (before * last).sum(axis=0) / np.maximum((before**2).sum(axis=0), 1e-300)
    alike = np.abs(last - share * before).max(axis=0) <= 1e-3 * np.abs(last).max(axis=0)
    return np.where(alike & (share > 0) & (share < 1), np.clip(share, 0, 1) ** (1 / span), 0.0)


def margins_of(sensitivity: Response, omega: Float[np.ndarray, " m"]) -> Margins:
    """Return the margins of a stable loop with this sensitivity (1 + L)^-1 at the plant's input.

    Crossings and peaks are found between neighbors of `omega`, increasing frequencies of which the last
    one is Nyquist's for a sampled loop, and then to rounding.
    """
    S = sensitivity(omega)
    n = S.shape[-1]
    loops = [_loop(S[:, i, i]) for i in range(n)]
    # Each with the point where it is; those that no point limits have none.
    gains: list[tuple[float, Point | None]] = [(np.inf, None), (0.0, None)]
    phases: list[tuple[float, Point | None]] = [(np.pi, None)]
    delays = [np.inf]
    for i, L in enumerate(loops):
        at = partial(_loop_at, sensitivity, i)
        gains += [(-1 / value, (crossing, value)) for crossing, value in _phase_crossings(at, omega, L)]
        for crossing in _crossings(at, lambda L: np.abs(L) - 1, omega, L):
            value = at(crossing)
            lag = float(np.angle(-value)) % (2 * np.pi)  # phase lag until the loop is at -1
            phases.append((min(lag, 2 * np.pi - lag), (crossing, value)))
            delays.append(lag / crossing)
    first = itemgetter(0)
    found = {
        "gain": min((each for each in gains if each[0] >= 1), key=first),
        "gain reduction": max((each for each in gains if each[0] < 1), key=first),
        "phase": min(phases, key=first),
    }
    points = {name: point for name, (_, point) in found.items() if point is not None}
    return Margins(
        gain=found["gain"][0],
        gain_reduction=found["gain reduction"][0],
        phase=float(np.rad2deg(found["phase"][0])),
        delay=min(delays),
        M_s=_peak(lambda w: np.linalg.svd(sensitivity(w), compute_uv=False)[:, 0], omega),
        disk=1 / _peak(lambda w: _mu(sensitivity(w) - np.eye(n) / 2), omega),
        loop=OpenLoop(omega, np.column_stack(loops), points),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Start:
    """A plant where a task starts, linearized: from deviations of inputs to those of states and outputs."""

    plant: Plant
    J: LinearSystem
    delay: Float[np.ndarray, "n n_u"]
    x: Float[np.ndarray, " n_x"]
    u: Float[np.ndarray, " n_u"]
    d: Float[np.ndarray, " n_d"]
    y: Float[np.ndarray, " n_y"]
    y_ref: Float[np.ndarray, " n_y"]

    @classmethod
    def of(cls, plant: Plant, task: Task) -> "_Start":
        """Return the plant at the start of a task. Raises as `margins` does."""
        x, u, d = task.x0, task.u0, task.disturbance(0.0)
        for channel, value in zip(plant.inputs, u, strict=True):
            room = _SMALL * (channel.high - channel.low)
            if np.isfinite(room) and not channel.low + room < value < channel.high - room:
                raise SettingsError(
                    f"input {channel.name!r} rests at {value:g} {channel.unit}, a limit: there the "
                    "loop has no linear law and so no margins; choose another operating point"
                )
        J, n = local_system(plant, x, u, d).behind(task.lag), len(x)
        # A controller may see the states, but not how far a lag has come.
        C, D = np.vstack([np.eye(n, len(J.A)), J.C]), np.vstack([np.zeros((n, len(u))), J.D])
        late = np.broadcast_to(np.asarray(task.measurement_delay, dtype=float), len(plant.outputs))
        delay = np.vstack([np.tile(delays_of(plant)[0], (n, 1)), dead_times(plant) + late[:, None]])
        y = np.asarray(plant.g(x, u, d), dtype=float)
        # The reference is where the plant rests, or the step of the task would be in the response.
        y_ref = np.where(np.isnan(task.reference(0.0)), np.nan, y)
        return cls(plant, LinearSystem(J.A, J.B, C, D, J.dt), delay, x, u, d, y, y_ref)

    def record(
        self, make: Callable[[], Controller], j: int, settle: int
    ) -> Float[np.ndarray, "N n_u"] | None:
        """Return how the plant's inputs respond to a unit impulse at input j; None if they grow."""
        channel = self.plant.inputs[j]
        span = channel.high - channel.low
        size = _SMALL * (span if np.isfinite(span) else max(1.0, abs(self.u[j])))
        impulse = size * np.eye(len(self.u))[j]
        model = sampled(self.J, make().T_s, self.delay)
        # A new controller for each sign: the memory of the first run would be in the second.
        both = [self._inputs(model, make(), sign * impulse, settle) for sign in (1, -1)]
        at_rest, _ = ([*islice(run, settle)] for run in both)
        if _swings(at_rest, size):
            return None
        rows, ups = list[np.ndarray](), list[np.ndarray]()
        for up, down in zip(*both, strict=True):
            ups.append(up)
            # Half the difference of both signs: what is even in the size, such as a curvature, cancels.
            rows.append((up - down) / (2 * size))
            if not np.abs(rows[-1]).max() < 1e5:
                return None  # it grows without limit
            if len(rows) in _LOOKS:
                quarters = np.array_split(np.abs(rows).max(axis=1), 4)
                first, _, before, late = (float(part.max()) for part in quarters)
                # Died out: what is left could not be told from rounding.
                died, last = late <= 1e-9 * max(before, first), len(rows) == _LOOKS[-1]
                if (died or last) and _swings(ups, size):
                    return None
                if died:
                    break
                if last and late > _ROUNDING * first and not late < 0.9999 * before:
                    return None
        if not np.any(rows[1:]):
            self._check_answers(model, make(), j, 1e3 * impulse)
        return np.array(rows)

    def _check_answers(
        self, model: LinearSystem, controller: Controller, j: int, load: Float[np.ndarray, " n_u"]
    ) -> None:
        """Raise SettingsError if a controller answers a lasting load, though no small impulse."""
        rows = islice(self._inputs(model, controller, load, 0, lasting=True), _LOOKS[5])
        if any(np.any(row != load) for row in rows):
            raise SettingsError(
                "the controller answers no small deviations, but large ones, as with a dead band (input "
                f"{self.plant.inputs[j].name!r}): it is not linear where it starts, so it has no margins; "
                "leave the dead band out to see those of the law outside it"
            )

    def _inputs(
        self,
        model: LinearSystem,
        controller: Controller,
        impulse: np.ndarray,
        settle: int,
        *,
        lasting: bool = False,
    ) -> Iterator[np.ndarray]:
        """Yield the deviations of the plant's inputs, (n_u,); an impulse comes after `settle`, or lasts."""
        n, z, du, T_s = len(self.x), np.zeros(len(model.A)), np.zeros(len(self.u)), model.dt
        for k in range(settle + _LOOKS[-1]):
            with np.errstate(over="ignore", invalid="ignore"):  # an unstable loop grows without limit
                seen = model.C @ z
            x, y = self.x + seen[:n], self.y + seen[n:]
            move = controller.move(Measurement(k * T_s, x, self.u + du, self.d, self.y_ref, y))
            du = (move.u if move.solved else self.u + du) - self.u
            acting = du + impulse if k == settle or (lasting and k > settle) else du
            yield acting
            with np.errstate(over="ignore", invalid="ignore"):
                z = model.A @ z + model.B @ acting


def _swings(rows: Sequence[Float[np.ndarray, " n_u"]], size: float) -> bool:
    """Return whether inputs move by more than `size`, and hardly less later than before.

    An unstable loop that has reached its limits, perhaps from rounding alone, shows no impulse any more: both
    signs lead to the same cycle.
    """
    if len(rows) < _LOOKS[0]:
        return False
    *_, before, late = np.array_split(np.abs(np.diff(rows, axis=0)).max(axis=1), 4)
    return bool(late.max() > size and late.max() >= 0.9 * before.max())


def _loop_at(sensitivity: Response, i: int, frequency: float) -> complex:
    """Return the loop gain at an input and a frequency."""
    return complex(_loop(sensitivity(np.array([frequency]))[:, i, i])[0])


def _loop(S: np.ndarray) -> np.ndarray:
    """Return L = 1 / S - 1; where S is 0, as with an integrator at rest, a large one."""
    return np.asarray(1 / np.where(np.abs(S) < 1e-12, 1e-12, S) - 1)


def _phase_crossings(
    at: Callable[[float], complex], omega: np.ndarray, L: np.ndarray
) -> Iterator[tuple[float, float]]:
    """Yield where a loop gain is real and negative, and its value there.

    At rest and at Nyquist's frequency it is always real.
    """
    negative = ((L.real[:-1] < 0) | (L.real[1:] < 0)) & (np.abs(L[1:]) > _NOTHING)
    for crossing in _crossings(at, np.imag, omega, L, negative):
        value = at(crossing)
        if value.real < 0 and abs(value.imag) <= 1e-6 * abs(value):
            yield crossing, value.real
    with np.errstate(all="ignore"):
        rest = at(0.0)
    # Steady feedback that holds an unstable plant may not fall to 1: a pole would drift off without a swing.
    if -_STEADY < rest.real < -_NOTHING and abs(rest.imag) <= 1e-9 * abs(rest.real):
        yield 0.0, rest.real
    if L.real[-1] < -_NOTHING and abs(L.imag[-1]) <= 1e-9 * abs(L.real[-1]):
        yield float(omega[-1]), float(L.real[-1])


def _crossings(
    at: Callable[[float], complex],
    part: Callable[[Any], Any],
    omega: np.ndarray,
    L: np.ndarray,
    where: np.ndarray | bool = True,
) -> Iterator[float]:
    """Yield where a part of a loop gain, which is L at `omega`, changes its sign, to rounding."""

    def f(frequency: float) -> float:
        return float(part(at(frequency)))

    for k in np.flatnonzero(np.diff(np.signbit(part(L))) & where):
        low, high = float(omega[k]), float(omega[k + 1])
        ends = f(low), f(high)
        if np.signbit(ends[0]) != np.signbit(ends[1]):
            yield float(scipy.optimize.brentq(f, low, high, xtol=1e-15, rtol=1e-14))
        else:  # rounding has moved the change beyond an end
            yield low if abs(ends[0]) < abs(ends[1]) else high


def _peak(size: Callable[[np.ndarray], np.ndarray], omega: np.ndarray) -> float:
    """Return the largest value of a positive function of frequency, refined around its peaks."""
    values = size(omega)
    best = float(values.max())
    inside = np.flatnonzero((values[1:-1] >= values[:-2]) & (values[1:-1] >= values[2:])) + 1
    for k in inside[values[inside] >= 0.8 * best]:
        ends = (omega[k - 1], omega[k + 1])
        found = scipy.optimize.minimize_scalar(
            lambda w: -float(size(np.array([w]))[0]), bounds=ends, method="bounded", options={"xatol": 1e-12}
        )
        best = max(best, -float(found.fun))
    return best


def peak_of_sampled(size: Callable[[Float[np.ndarray, " m"]], Float[np.ndarray, " m"]], T_s: float) -> float:
    """Return the largest value of a function of angular frequency up to Nyquist's, to about 0.01 %.

    It is `_peak` for what is asked of every experiment: two grids, the second around the largest value.
    """
    omega = np.geomspace(1e-4, 0.999, 300) * np.pi / T_s
    values = size(omega)
    k = int(np.argmax(values))
    near = np.geomspace(omega[max(k - 1, 0)], omega[min(k + 1, len(omega) - 1)], 41)
    return float(max(values[k], size(near).max()))


def _mu(M: Complex[np.ndarray, "m n n"]) -> Float[np.ndarray, " m"]:
    """Return min σ(D M D^-1) over diagonal D: μ for independent complex changes of each input.

    It is found by balancing rows and columns (Osborne), which minimizes the Frobenius norm. That is
    exact for one and two inputs (there σ1² + σ2² is that norm, and σ1 σ2 does not depend on D); for
    more it is an upper bound, so that the disk margin is not overstated.

    Source: Osborne (1960), On pre-conditioning of matrices, Journal of the ACM 7.
    """
    n, balanced = M.shape[-1], np.abs(M) ** 2
    scale = np.ones(M.shape[:2])
    for _ in range(30 if n > 1 else 0):
        for i in range(n):
            others = np.arange(n) != i
            row = balanced[:, i, others].sum(axis=1) + 1e-300
            column = balanced[:, others, i].sum(axis=1) + 1e-300
            factor = (column / row) ** 0.25
            scale[:, i] *= factor
            balanced[:, i, :] *= factor[:, None] ** 2
            balanced[:, :, i] /= factor[:, None] ** 2
    scaled = scale[:, :, None] * M / scale[:, None, :]
    return np.asarray(np.linalg.svd(scaled, compute_uv=False)[:, 0])


_KPIS = (
    ("M_s", "maximum sensitivity M_s", "", 0.01, "How much the loop amplifies a disturbance at most."),
    ("gain_margin", "gain margin", "dB", 0.01, "Smallest change of the gain, up or down, that is too much."),
    ("phase_margin", "phase margin", "°", 0.1, "Phase that the loop may lose before it is unstable."),
    ("delay_margin", "delay margin", "{time}", None, "Dead time that may be added."),
    ("disk_margin", "disk margin", "", 0.001, "Joint change of gain and phase, of all inputs at once."),
)
"""Name, title, unit, resolution and meaning of the margins."""


def margin_kpis(time_unit: str) -> tuple[KPI, ...]:
    """Return the KPIs that `MarginKPIs` computes; `at_least`, of M_s `at_most`, makes one a limit."""
    return tuple(
        KPI(
            name,
            title,
            unit.format(time=time_unit),
            better="lower" if name == "M_s" else "higher",
            about=f"{about} Of {UNCONSTRAINED}.",
            resolution=step,
            margin=True,
        )
        for name, title, unit, step, about in _KPIS
    )


@dataclass(frozen=True, slots=True)
class MarginKPIs:
    """Function of an experiment that returns its KPIs and those margins of its θ that it does not have.

    Those of a plant that is not linear are the smaller ones of start and target.
    What is infinite has a large finite value, since KPIs that are better when higher are: 60 dB,
    180° and ten thousand sampling periods.

    Args:
        loop: Closed loop of the experiments; its environment is a `PlantEnv`.
        names: Names of the margins that are asked for: an experiment that has these is returned as it is.
    """

    loop: ClosedLoop
    names: frozenset[str] = frozenset(name for name, *_ in _KPIS)

    def __call__(self, experiment: Experiment) -> dict[str, float]:
        """Return the KPIs by name; an unstable loop has margins of 0, and an infinite M_s.

        Raises:
            SettingsError: If the environment does not say its plant and task, or as `margins` does.
        """
        own = dict(experiment.kpis)
        if self.names <= own.keys():
            return own
        env, make = self.loop.env, partial(self.loop.controller, experiment.theta)
        if not isinstance(env, PlantEnv):
            raise SettingsError(f"margins need a PlantEnv, whose plant can be linearized, got {env!r:.60}")
        start = margins(env.plant, env.task, make)
        target = margins_at_target(env.plant, at_target(env.plant, env.task), make)
        places = [m for m in (start, target) if m is not None]
        gain = min(min(m.gain, 1 / m.gain_reduction if m.gain_reduction else np.inf) for m in places)
        others = {
            "gain_margin": min(float(20 * np.log10(gain)), 60.0),
            "phase_margin": min(m.phase for m in places),
            "delay_margin": min(1e4 * make().T_s, *(m.delay for m in places)),
            "disk_margin": min(m.disk for m in places),
        }
        return {"M_s": max(m.M_s for m in places), **own, **others} | own

    def around(self, env: PlantEnv) -> "MarginKPIs":
        """Return the same margins in a varied environment, of the controller itself: what sticks has none."""
        return replace(self, loop=ClosedLoop(env, self.loop.controller))
