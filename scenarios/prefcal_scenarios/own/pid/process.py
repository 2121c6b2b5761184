"""What limits the control of a linear process: its gain, lags, dead time and unstable parts."""

import numpy as np
from jaxtyping import Complex

from prefcal_env.controllers.rules import Process
from prefcal_env.controllers.sampled import minimal
from prefcal_env.plants.plant import Jacobians

_INTEGRATES = 1e-6
"""A pole this small relative to the largest one integrates."""


def process_of(J: Jacobians, delay: float = 0.0) -> Process:
    """Return the process from one input to one output, by its linearization.

    Args:
        J: Matrices with one input and one output.
        delay: Dead time.
    """
    M = minimal(J)
    poles = np.linalg.eigvals(M.A) if len(M.A) else np.zeros(0)
    largest = float(np.abs(poles).max(initial=0.0))
    integrators = int(np.count_nonzero(np.abs(poles) <= _INTEGRATES * largest))
    others = poles[np.abs(poles) > _INTEGRATES * largest]
    swinging = others[np.abs(others.imag) > 1e-6 * np.abs(others)]
    zeros = _zeros(M)
    return Process(
        gain=_gain(M, integrators, largest),
        integrators=integrators,
        lags=tuple(sorted((1 / np.abs(others)).tolist(), reverse=True)),
        inverse=tuple((1 / np.abs(zeros[zeros.real > 0])).tolist()),
        delay=delay,
        unstable=bool((others.real > 0).any()),
        damping=float((-swinging.real / np.abs(swinging)).min(initial=1.0)),
    )


def _gain(M: Jacobians, integrators: int, largest: float) -> float:
    """Return the limit of s^n G(s) for s to 0, by its value at a very small s."""
    if not len(M.A):
        return float(M.D[0, 0])
    s = 1e-4j * (largest or 1.0) * (1e-2 if not integrators else 1.0)
    slow = np.linalg.eigvals(M.A)
    finite = np.abs(slow)[np.abs(slow) > _INTEGRATES * largest]
    if len(finite):
        s = 1e-3j * float(finite.min())
    G = (M.C @ np.linalg.solve(s * np.eye(len(M.A)) - M.A, M.B) + M.D)[0, 0]
    return float((G * s**integrators).real)


def _zeros(M: Jacobians) -> Complex[np.ndarray, " k"]:
    """Return the finite zeros: generalized eigenvalues of the system matrix."""
    from scipy.linalg import eigvals

    n = len(M.A)
    if not n:
        return np.zeros(0, dtype=complex)
    pencil = np.block([[M.A, M.B], [M.C, M.D]])
    mass = np.zeros_like(pencil)
    mass[:n, :n] = np.eye(n)
    alpha, beta = eigvals(pencil, mass, homogeneous_eigvals=True)
    finite = np.abs(beta) > 1e-9 * (np.abs(alpha) + np.abs(beta))
    zeros = alpha[finite] / beta[finite]
    fastest = np.abs(np.linalg.eigvals(M.A)).max()
    return np.asarray(zeros[np.abs(zeros) < 1e3 * max(fastest, 1e-300)], dtype=complex)
