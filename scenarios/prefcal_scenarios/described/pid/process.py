"""What limits the control of a linear process: its gain, lags, dead time and unstable parts."""

import numpy as np
from jaxtyping import Complex
from scipy.linalg import eigvals

from prefcal_env.controllers.rules import ProcessModel
from prefcal_env.controllers.sampled import minimal
from prefcal_env.plants.systems import LinearSystem
from prefcal_env.plants.systems.matrices import rates_of

_INTEGRATES = 1e-6
"""A pole this small relative to the largest one integrates."""
_ROUNDING = 1e-12
"""Rounding spreads k equal poles over a circle whose radius is the k-th root of about this."""
_AT_ZERO = 1e-3
"""Magnitude below which a discrete pole counts as one at 0."""


def process_of(J: LinearSystem, delay: float = 0.0) -> ProcessModel:
    """Return the process from one input to one output, by its linearization.

    The rules are for continuous processes: poles and zeros of a discrete one count as those with
    the same decay, and the samples in which its impulse response is still 0 as dead time.

    Args:
        J: Linear system with one input and one output.
        delay: Dead time.
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
        delay=delay + waiting * M.dt,
        unstable=bool((others.real > 0).any()),
        damping=float((-swinging.real / np.abs(swinging)).min(initial=1.0)),
    )


def integrators_of(rates: Complex[np.ndarray, " n"], dt: float) -> int:
    """Return how many poles integrate.

    Args:
        rates: Poles as rates, shape (n,), the smallest first.
        dt: Sample time; 0 if the system is continuous.
    """
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
