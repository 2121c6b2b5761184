"""Tunings of a PID for a linear plant: by rules of the field, and by its robustness."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from prefcal_env.plants.systems import LinearSystem

from .pid_law import LinearPIDs, PIDLaw, Tuning


@dataclass(frozen=True, slots=True)
class ProcessModel:
    """What the rules need to know of a process of one input and one output.

    Args:
        gain: Lim s^n G(s) for s to 0, n the number of integrators.
        integrators: Number of integrators.
        lags: Time constants 1/|p| of the other poles, decreasing.
        inverse: Time constants 1/z of the zeros in the right half plane.
        delay: Dead time, with half of the sampling time.
        unstable: Whether a pole is in the right half plane.
        damping: Smallest damping of a pair of poles; 1 if there is none.
    """

    gain: float
    integrators: int
    lags: tuple[float, ...]
    inverse: tuple[float, ...]
    delay: float
    unstable: bool = False
    damping: float = 1.0


def simc(process: ProcessModel, *, derivative: bool = True) -> Tuning | None:
    """Return Skogestad's tuning with τ_c = θ; None where the rule does not apply.

    Source: Skogestad (2003), Simple analytic rules for model reduction and PID controller tuning,
    J. Process Control 13(4), 291-309: half rule, settings, and series to standard form.
    Deviation: zeros in the left half plane are left out.

    Args:
        process: Process model; not unstable, with a damping of at least 0.5.
        derivative: Whether the controller has a derivative part.
    """
    if process.unstable or process.integrators > 2 or process.damping < 0.5 or not process.gain:
        return None
    lags = [np.inf] * process.integrators + list(process.lags) + [0.0] * 4
    kept = 2 if derivative else 1
    theta = process.delay + sum(process.inverse) + lags[kept] / 2 + sum(lags[kept + 1 :])
    if not 0 < theta < np.inf:
        return None
    tau = [*lags[: kept - 1], lags[kept - 1] + lags[kept] / 2]
    if process.integrators == 2:
        K, T_i, T_d = 1 / (process.gain * 16 * theta**2), 8 * theta, 8 * theta
    else:
        rate = 1 / process.gain if process.integrators else tau[0] / process.gain
        K, T_i = rate / (2 * theta), min(tau[0], 8 * theta)
        T_d = tau[1] if derivative else 0.0
    if not T_i > 0:
        return None
    factor = 1 + T_d / T_i
    return Tuning(K * factor, T_i * factor, T_d / factor)


def ziegler_nichols(plant: LinearSystem, omega: Float[np.ndarray, " m"], sign: float) -> Tuning | None:
    """Return the tuning by the ultimate gain K_u and period T_u; None if there is none.

    K_p = 0.6 K_u, T_i = T_u / 2, T_d = T_u / 8.

    Source: Ziegler, Nichols (1942), Optimum settings for automatic controllers, Trans. ASME 64,
    759-768.

    Args:
        plant: LinearSystem plant of one input and one output, stable or integrating.
        omega: Increasing angular frequencies to search, shape (m,).
        sign: Sign of the controller's gain.
    """
    G = sign * plant.at(1j * omega)[:, 0, 0]
    crossing = np.flatnonzero((G.imag[:-1] < 0) & (G.imag[1:] >= 0) & (G.real[1:] < 0))
    if not len(crossing):
        return None
    k = int(crossing[0])
    share = -G.imag[k] / (G.imag[k + 1] - G.imag[k])
    size = abs(G.real[k] + share * (G.real[k + 1] - G.real[k]))
    T_u = 2 * np.pi / (omega[k] + share * (omega[k + 1] - omega[k]))
    return Tuning(sign * 0.6 / size, T_u / 2, T_u / 8)


ROBUST = (1.6, 2.0, 2.5, 3.5, np.inf)
"""Largest sensitivities, from the recommended range to what difficult plants allow."""

_INTEGRAL_TIMES = (0.18, 0.35, 0.7, 1.4, 2.8, 5.6, 11.0, 22.0)
"""Integral times to try, times the crossover frequency; plants that are all dead time need the
short ones."""
_DERIVATIVE_TIMES = (0.05, 0.15, 0.4, 1.0, 2.0)
"""Derivative times to try, likewise."""


def robust(
    plant: LinearSystem,
    omega: Float[np.ndarray, " m"],
    crossover: Float[np.ndarray, " k"],
    *,
    largest: float = np.inf,
    N: float = 10.0,
) -> tuple[Tuning, float] | None:
    """Return a robust tuning and its crossover frequency; None if no PID stabilizes the plant.

    It maximizes the integral gain K_p / T_i at a sensitivity of at most 1.6 (more only if
    necessary), over both signs and a grid of crossover frequencies and times.

    Source: Åström, Hägglund (2006), Advanced PID Control (MIGO).
    Deviation: on a grid, for the sampled loop, so any linear plant will do.

    Args:
        plant: LinearSystem plant of one input and one output.
        omega: Angular frequencies at which the sensitivity is evaluated, shape (m,).
        crossover: Crossover frequencies to try, shape (k,).
        largest: Largest |K_p|, by the input's range; ignored if nothing else is stable.
        N: Filter of the derivative, as in `PID`.
    """
    T_s = plant.dt
    shapes = [(i, d) for i in _INTEGRAL_TIMES for d in _DERIVATIVE_TIMES]
    w = np.repeat(crossover, len(shapes))
    T_i, T_d = np.tile(np.array(shapes), (len(crossover), 1)).T / w
    unit = PIDLaw.of(np.ones(len(w)), T_i, T_d, N=N, T_s=T_s)
    size = np.abs(plant.at(1j * w)[:, 0, 0] * unit.at(np.exp(1j * w * T_s)))
    w, T_i, T_d, size = (v[size > 0] for v in (w, T_i, T_d, size))
    K = np.concatenate([1 / size, -1 / size])  # either sign
    w, T_i, T_d = (np.tile(v, 2) for v in (w, T_i, T_d))
    peak = LinearPIDs(K[:, None], T_i[:, None], T_d[:, None], N).sensitivity(plant, omega)
    drive, within = np.abs(K) / T_i, np.abs(K) <= largest
    for bound, allowed in [(b, within) for b in ROBUST] + [(np.inf, np.ones_like(within))]:
        fine = np.isfinite(peak) & (peak <= bound) & allowed
        if fine.any():
            # Among unbounded ones the most robust, else the strongest integral action.
            score = drive if np.isfinite(bound) else 1 / peak
            best = int(np.argmax(np.where(fine, score, -np.inf)))
            return Tuning(float(K[best]), float(T_i[best]), float(T_d[best])), float(w[best])
    return None
