"""A linear plant as a digital controller sees it: sampled, with dead time and held inputs."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

from prefcal_env.plants.systems import LinearSystem


@dataclass(frozen=True, slots=True, eq=False)
class Sampled:
    """A model x⁺ = A x + B u, y = C x, with u held for T_s; x holds delayed inputs, too."""

    A: Float[np.ndarray, "n n"]
    B: Float[np.ndarray, "n n_u"]
    C: Float[np.ndarray, "n_y n"]
    T_s: float

    def at(self, omega: Float[np.ndarray, " m"]) -> Complex[np.ndarray, "m n_y n_u"]:
        """Return the frequency response at angular frequencies, shape (m,)."""
        z = np.exp(1j * omega * self.T_s)
        resolvent = z[:, None, None] * np.eye(len(self.A)) - self.A
        return np.asarray(self.C @ np.linalg.solve(resolvent, np.broadcast_to(
            self.B.astype(complex), (len(z), *self.B.shape))))  # fmt: skip


def held(
    A: Float[np.ndarray, "n n"], B: Float[np.ndarray, "n n_u"], T: float
) -> tuple[Float[np.ndarray, "n n"], Float[np.ndarray, "n n_u"]]:
    """Return A_d and B_d of ẋ = A x + B u over T with u held, by the matrix exponential."""
    from scipy.linalg import expm  # takes a while to import

    n, m = B.shape
    E = expm(np.block([[A, B], [np.zeros((m, n + m))]]) * T)
    return E[:n, :n], E[:n, n:]


def sampled(
    J: LinearSystem, T_s: float, delay: Float[np.ndarray, "n_y n_u"] | None = None
) -> Sampled:
    """Return the sampled model of a linear plant, exact also for fractions of T_s.

    With a direct feedthrough D, an output is measured before the next input acts.

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
    from scipy.linalg import block_diag  # takes a while to import

    # Each output has states of its own, which its dead times reach.
    each = [_sampled(J.part([i], range(J.D.shape[1])), T_s, row) for i, row in enumerate(delays)]
    A, C = (block_diag(*(getattr(s, name) for s in each)) for name in "AC")
    return Sampled(A, np.vstack([s.B for s in each]), C, T_s)


def _sampled(J: LinearSystem, T_s: float, delay: Float[np.ndarray, " n_u"]) -> Sampled:
    """Return the sampled model with a dead time for each input."""
    n, n_u = J.B.shape
    A, B_now = _over(J, T_s)
    C, B = J.C, np.zeros((n, n_u))
    blocks: list[tuple[int, int, np.ndarray, np.ndarray]] = []  # input, samples, older, newer
    for i in range(n_u):
        samples, rest = divmod(float(delay[i]), T_s)
        late = np.zeros(n)
        if rest > 1e-9 * T_s:
            Phi, Gamma = _over(J, T_s - rest)
            late, now = Phi @ _over(J, rest)[1][:, i], Gamma[:, i]
        else:
            now = B_now[:, i]
        blocks.append((i, int(samples), late, now))
    lengths = [samples + 1 for _, samples, _, _ in blocks]  # inputs of the past, newest first
    size = n + sum(lengths)
    A_all, B_all, C_all = np.zeros((size, size)), np.zeros((size, n_u)), np.zeros((len(C), size))
    A_all[:n, :n], B_all[:n], C_all[:, :n] = A, B, C
    start = n
    for (i, samples, late, now), length in zip(blocks, lengths, strict=True):
        A_all[:n, start + samples] += late  # u of samples + 1 steps ago
        if samples:
            A_all[:n, start + samples - 1] += now
        else:
            B_all[:n, i] += now
        B_all[start, i] = 1.0
        A_all[start + 1 : start + length, start : start + length - 1] = np.eye(length - 1)
        C_all[:, start + samples] += J.D[:, i]
        start += length
    return Sampled(A_all, B_all, C_all, T_s)


def _over(J: LinearSystem, T: float) -> tuple[np.ndarray, np.ndarray]:
    """Return A_d and B_d over T with u held; T is a multiple of the sample time if J has one."""
    if not J.dt:
        return held(J.A, J.B, T)
    n, m = J.B.shape
    once = np.block([[J.A, J.B], [np.zeros((m, n)), np.eye(m)]])
    E = np.linalg.matrix_power(once, round(T / J.dt))
    return E[:n, :n], E[:n, n:]


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
