"""Simulate PID loops on many plants with NumPy and SciPy alone: a second opinion on `prefcal verify`.

Nothing here imports prefcal: `verified.py` compares both. A plant is C (sI - A)^-1 B with dead time, its
samples are exact (matrix exponentials, also for fractions of a period), and the PID is written from its
textbook form, as the docstring of `prefcal_env.controllers.PID` states it. All plants of a loop advance
together, one row each.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm
from scipy.signal import tf2ss

_BAND, _AWAY = 0.05, 10.0  # of settling, and distance that is unsafe, as shares of the step
_NO_LAG = 1e-3  # share of the sampling time that counts as no lag: less would make exponentials stiff


@dataclass(frozen=True)
class TransferFunction:
    """A plant num/den (highest power first) with dead time before and behind it."""

    num: tuple[float, ...]
    den: tuple[float, ...]
    delay: float = 0.0
    output_delay: float = 0.0


@dataclass(frozen=True)
class StepAndLoad:
    """A step of the reference from rest at the start, then a load on the input; times as the plant's."""

    start: float
    target: float
    load: float
    phase: float  # duration of either part
    T_s: float
    low: float  # limits of the input
    high: float


@dataclass(frozen=True)
class PID:
    """An ISA PID with derivative on the measurement, and back-calculation."""

    K_p: float
    T_i: float
    T_d: float
    b: float
    N: float


NOMINAL = (1.0, 1.0, 1.0, 0.0, 0.0)
"""Factors of time constants, gain and dead time; lag of the actuator; bias of the sensor in steps."""


def drawn(runs: int, seed: int, shares: tuple[float, float, float], lag: float, bias: float) -> np.ndarray:
    """Return what varies, uniform: the factors within ± the shares, lag from 0, bias ±, shape (runs, 5)."""
    unit = np.random.default_rng(seed).uniform(-1, 1, (runs, 5))
    unit[:, 3] = (1 + unit[:, 3]) / 2
    return NOMINAL + unit * [*shares, lag, bias]


def failures(process: TransferFunction, experiment: StepAndLoad, pid: PID, factors: np.ndarray) -> np.ndarray:
    """Return which plants run away, or do not settle by the end of a part, shape (runs,)."""
    y, error = simulated(process, experiment, pid, factors)
    parted = _samples(experiment)
    outside = np.abs(error) > _BAND
    step = abs(experiment.target - experiment.start)
    away = (np.abs(y - experiment.start) > _AWAY * step) | ~np.isfinite(y)
    unsettled = [not (_settles(each[:parted]) and _settles(each[parted:])) for each in outside.T]
    return np.asarray(unsettled | away.any(axis=0))


def _settles(outside: np.ndarray) -> bool:
    """Return whether an error stays in the band, as long as on any earlier visit or a tenth of the time."""
    parts = np.split(outside, np.flatnonzero(np.diff(outside)) + 1)
    earlier = [len(part) - 1 for part in parts[1:-1] if not part[0]]
    enough = min(max(earlier, default=0), (len(outside) - 1) / 10)
    return bool(not outside[-1] and len(parts[-1]) - 1 >= enough)


def _samples(e: StepAndLoad, parts: int = 1) -> int:
    """Return the number of instants before the end of a part."""
    return int(np.ceil(parts * e.phase / e.T_s - 1e-6))


def simulated(
    process: TransferFunction, experiment: StepAndLoad, pid: PID, factors: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return outputs and errors in steps at each sampling instant, each of shape (K, runs)."""
    e, (speed, gain, later, lag, bias), runs = experiment, factors.T, len(factors)
    bias = bias * abs(e.target - e.start)
    A, B, C, _ = tf2ss(process.num, process.den)
    loads = B[:, 0] * (gain / speed)[:, None]
    plants, loads = _behind_lags(
        A[None] / speed[:, None, None], loads, C[0], np.maximum(lag, _NO_LAG * e.T_s)
    )
    u_late, w_late = (process.delay + process.output_delay) * later, process.output_delay * later
    propagate, *acting = _sampled(plants[0], plants[1], e.T_s, u_late)
    _, *loading = _sampled(plants[0], loads, e.T_s, w_late)
    x, u0 = _rest(*plants, e.start)
    count, loaded = _samples(e, 2) + 1, _samples(e)
    before = int(max(u_late.max(), w_late.max()) / e.T_s) + 2  # instants before the start, at rest
    u = np.tile(u0, (before + count, 1))
    w = np.zeros((before + count, runs))
    w[before + loaded :] = e.load
    law, ys = _Law(pid, e, u0, e.start + bias), np.empty((count, runs))
    with np.errstate(all="ignore"):  # what is unstable may overflow, and has failed then
        for k in range(count):
            ys[k] = x @ plants[2]
            u[before + k :] = law.move(ys[k] + bias)
            x = np.einsum("pij,pj->pi", propagate, x)
            x = x + _through(acting, u, before + k, u_late / e.T_s)
            x = x + _through(loading, w, before + k, w_late / e.T_s)
    return ys, (ys - e.target) / (e.target - e.start)


def _behind_lags(
    A: np.ndarray, B: np.ndarray, C: np.ndarray, lag: np.ndarray
) -> tuple[tuple[np.ndarray, np.ndarray, np.ndarray], np.ndarray]:
    """Return A, B and C of plants whose input passes a lag, and the B of a load, which does not."""
    runs, n = B.shape
    behind, entering = np.zeros((runs, n + 1, n + 1)), np.zeros((runs, n + 1))
    behind[:, :n, :n], behind[:, :n, n], behind[:, n, n] = A, B, -1 / lag
    entering[:, n] = 1 / lag
    return (behind, entering, np.append(C, 0.0)), np.column_stack([B, np.zeros(runs)])


def _sampled(A: np.ndarray, B: np.ndarray, T: float, delay: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return e^(A T), and what the previous and the current input add after a period T.

    The input of now reaches the plant when the fraction of the dead time has passed.
    """
    rest = np.mod(delay, T)
    whole, _ = _integrals(A, B, np.full(len(rest), T))
    _, held = _integrals(A, B, rest)
    onwards, latest = _integrals(A, B, T - rest)
    return whole, np.einsum("pij,pj->pi", onwards, held), latest


def _integrals(A: np.ndarray, B: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return e^(A t) and its integral from 0 to t times B, for each plant."""
    n = A.shape[1]
    M = np.zeros((len(A), n + 1, n + 1))
    M[:, :n, :n], M[:, :n, n] = A, B
    E = expm(M * t[:, None, None])
    return E[:, :n, :n], E[:, :n, n]


def _through(acting: list[np.ndarray], signal: np.ndarray, now: int, late: np.ndarray) -> np.ndarray:
    """Return what a delayed signal adds to the states; `late` is in periods."""
    old, new = acting
    columns, ago = np.arange(len(late)), np.floor(late).astype(int)
    return old * signal[now - ago - 1, columns][:, None] + new * signal[now - ago, columns][:, None]


def _rest(A: np.ndarray, B: np.ndarray, C: np.ndarray, y: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the states and inputs at which the plants rest with this output."""
    n = len(C)
    M = np.zeros((len(A), n + 1, n + 1))
    M[:, :n, :n], M[:, :n, n], M[:, n, :n] = A, B, C
    found = np.linalg.solve(M, np.append(np.zeros(n), y)[None, :, None].repeat(len(A), 0))[..., 0]
    return found[:, :n], found[:, n]


class _Law:
    """The PIDs of all plants: u = K_p (b r - y) + I + D within the limits, with back-calculation."""

    def __init__(self, pid: PID, e: StepAndLoad, u0: np.ndarray, seen: np.ndarray) -> None:
        self.pid, self.e, self.D = pid, e, np.zeros(len(u0))
        self.tracking = np.sqrt(pid.T_i * pid.T_d) if 25 * pid.T_d >= pid.T_i else pid.T_i
        # It had rested at the start: reference and output, as the sensor sees it, were the same.
        self.I = u0 - pid.K_p * (pid.b - 1) * seen
        self.y, self.lost = seen, np.zeros(len(u0))
        self.first = True

    def move(self, y: np.ndarray) -> np.ndarray:
        """Return the inputs of this instant."""
        p, T_s = self.pid, self.e.T_s
        if not self.first:
            self.I = self.I + p.K_p * T_s / p.T_i * (self.e.target - self.y)
            self.I = self.I - min(T_s / self.tracking, 1.0) * self.lost
        self.first = False
        self.D = (p.T_d * self.D - p.K_p * p.T_d * p.N * (y - self.y)) / (p.T_d + p.N * T_s)
        wanted = p.K_p * (p.b * self.e.target - y) + self.I + self.D
        given = np.clip(wanted, self.e.low, self.e.high)
        self.y, self.lost = y, wanted - given
        return np.asarray(given)
