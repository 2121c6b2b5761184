"""Learn the weights β of the surrogate: the QP that reproduces the preferences.

Source: eq. RBF-pref and eq. QP-pref. Everything here is divided by σ: with β = σ β' and slacks
in units of σ the margin is 1 and λ becomes λσ. The solution stays the same, without numbers
near 1e-6.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from threading import local

import numpy as np
from jaxtyping import Bool, Float, Int

from prefcal_agents.history.lessons import Preferences
from prefcal_env.qp import PIQPSolver

_SHORTEST = 1e-12  # a shorter row (two samples that φ cannot tell apart) counts as this long
_FAR = 0.3  # root mean square distance per knob from which on the margin is σ in full
_NEAR = 1e-9  # closer samples count as this share of it: a margin stays above 0
_NOBODY = -1  # owner of a row that holds for any answer
_RIDGE = 1e-11  # on a Gram matrix of unit rows: below any accuracy asked for, above rounding
_SOLVERS = local()  # one solver for each thread, since agents may compute at the same time


@dataclass(frozen=True, slots=True)
class Learning:
    """How β is learned.

    Source: section IV of the paper for σ. λσ = 1e-6 keeps all preferences that can be kept.
    Deviation: λ is above 0; with λ = 0 eq. QP-pref would be a linear program.

    Args:
        sigma: σ of eq. RBF-pref, above 0: smallest difference between a better and a worse
            sample.
        lam: λ of eq. QP-pref, above 0.
        margin_power: See `margins`; 0 is eq. RBF-pref.
    """

    sigma: float = 1e-6
    lam: float = 1.0
    margin_power: float = 0.0


@dataclass(frozen=True, slots=True)
class Constraints:
    """Eq. RBF-pref as rows · β' >= margins - slack: one row per strict preference, two per tie.

    Args:
        rows: Shape (R, N).
        margins: Shape (R,), above 0 for a strict preference, -1 for both rows of a tie.
        weights: c_h, shape (R,).
        owner: The comparison that each row belongs to, shape (R,); -1: none, it always holds.
    """

    rows: Float[np.ndarray, "R N"]
    margins: Float[np.ndarray, " R"]
    weights: Float[np.ndarray, " R"]
    owner: Int[np.ndarray, " R"]

    @classmethod
    def of(
        cls, preferences: Preferences, phi: Float[np.ndarray, "N P"], margin: Float[np.ndarray, " M"]
    ) -> "Constraints":
        """Make the rows of M comparisons, each with its margin in units of σ.

        `phi` holds what is weighted, at all samples: N functions φ, or p KPIs.
        """
        difference = phi[preferences.first] - phi[preferences.second]
        strict, tie = np.flatnonzero(preferences.b), np.flatnonzero(preferences.b == 0)
        owner = np.concatenate([strict, tie, tie])
        signs = np.concatenate([preferences.b[strict], np.ones(len(tie)), -np.ones(len(tie))])
        return cls(
            rows=difference[owner] * signs[:, None],
            margins=np.concatenate([margin[strict], -np.ones(2 * len(tie))]),
            weights=preferences.weights[owner],
            owner=owner,
        )

    def nonnegative(self) -> "Constraints":
        """Add a row for each of the P weights that keeps it at 0 or more, whatever is answered."""
        count = self.rows.shape[1]
        return Constraints(
            rows=np.vstack([self.rows, np.eye(count)]),
            margins=np.append(self.margins, np.zeros(count)),
            weights=np.append(self.weights, np.ones(count)),
            owner=np.append(self.owner, np.full(count, _NOBODY)),
        )

    def without(self, left_out: Bool[np.ndarray, " M"]) -> "Constraints":
        """Return the rows of the comparisons that are not left out."""
        kept = (self.owner == _NOBODY) | ~left_out[self.owner]
        return Constraints(self.rows[kept], self.margins[kept], self.weights[kept], self.owner[kept])


def margins(preferences: Preferences, power: float) -> Float[np.ndarray, " M"]:
    """Return the margin of each comparison in units of σ, in (0, 1], shape (M,).

    Source: eq. RBF-pref has the same margin σ everywhere, as `power` 0 does.
    Deviation: a continuous index differs little between close samples, yet one margin for
    all makes Ĵ as steep as their distance is small, and the following samples overshoot. So the
    margin grows with (distance / √n)^power, up to σ at a distance of 0.3 √n of the cube.
    """
    if power == 0:
        return np.ones(len(preferences))
    apart = preferences.samples[preferences.first] - preferences.samples[preferences.second]
    share = np.sqrt(np.mean(apart**2, axis=1)) / _FAR
    return np.asarray(np.clip(share, _NEAR, 1.0) ** power)


def fit(constraints: Constraints, learning: Learning) -> Float[np.ndarray, " N"]:
    """Return the weights β of eq. QP-pref, shape (N,); zero where nothing is known.

    The dual is solved, in one multiplier α per row, 0 <= α <= c_h / (λσ). It has no slacks, so
    fewer than half the variables of the primal, and β' = rowsᵀα. (The rows of a tie share their
    slack; they are never both at their bound, so each may have the full c_h.)

    Source: eq. QP-pref.
    Deviation: none; see `margins` for what the margins may be.
    """
    return _fits([constraints], learning)[0]


def fits_without(
    preferences: Preferences,
    bases: Sequence[Float[np.ndarray, "N N"]],
    slices: Bool[np.ndarray, "K M"],
    learning: Learning,
) -> list[list[Float[np.ndarray, " N"]]]:
    """Return β of many fits: for each of E bases, K fits without the comparisons of one slice."""
    margin, systems = margins(preferences, learning.margin_power), []
    for phi in bases:
        constraints = Constraints.of(preferences, phi, margin)
        systems += [constraints.without(left_out) for left_out in slices]
    betas = _fits(systems, learning)
    return [betas[k : k + len(slices)] for k in range(0, len(betas), len(slices))]


def _fits(systems: Sequence[Constraints], learning: Learning) -> list[Float[np.ndarray, " N"]]:
    if not hasattr(_SOLVERS, "qp"):
        _SOLVERS.qp = PIQPSolver()
    return [_fit(system, learning) for system in systems]


def _fit(system: Constraints, learning: Learning) -> Float[np.ndarray, " N"]:
    """Return β at a solution of min ½|rowsᵀα|² - margins·α subject to 0 <= α <= ceiling.

    Rows of close samples are short and their multipliers huge; unit rows even that out, so the
    variables are z = α · length / scale. Without a solution, β is zero.
    """
    rows, ceiling = system.rows, system.weights / (learning.lam * learning.sigma)
    length = np.maximum(np.sqrt(np.sum(rows * rows, axis=1)), _SHORTEST)
    unit = rows / length[:, None]
    gram = unit @ unit.T
    scale = 1 / float(length.min(initial=np.inf))
    symmetric = 0.5 * (gram + gram.T)
    symmetric.flat[:: len(gram) + 1] += _RIDGE
    q, upper = -system.margins / (length * scale), ceiling * length / scale
    z = _SOLVERS.qp.solve_box(symmetric, q, upper)
    if z is None:
        return np.zeros(rows.shape[1])
    alpha = np.clip(z * scale / length, 0.0, ceiling)
    return np.asarray(learning.sigma * (alpha @ rows))
