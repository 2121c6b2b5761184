"""A linear plant as a digital controller sees it: sampled, with dead time and held inputs."""

import numpy as np
from jaxtyping import Float
from scipy.linalg import block_diag

from prefcal_env.plants.systems import LinearSystem


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
        if rest > 1e-9 * T_s:
            Phi, Gamma = J.held(T_s - rest)
            A[:n, end - 1], now = Phi @ J.held(rest)[1][:, i], Gamma[:, i]
        if length > 1:
            A[:n, end - 2] = now
        else:
            B[:n, i] = now
        B[start, i] = 1.0
        A[start + 1 : end, start : end - 1] = np.eye(length - 1)
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
