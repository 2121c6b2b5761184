"""The surrogate Ĵ: radial basis functions whose weights reproduce the preferences.

Source: eq. rbf, eq. RBF-pref and eq. QP-pref.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from prefcal_env.qp import QP, Backend

from .ledger import Preferences
from .rbf import RADIAL_FUNCTIONS, squared_distances

_SHORTEST = 1e-12  # a shorter row (two samples that φ cannot tell apart) counts as this long
_FAR = 0.3  # root mean square distance per knob from which on the margin is σ in full
_NEAR = 1e-9  # closer samples count as this share of it: a margin stays above 0
_RIDGE = 1e-11  # on a Gram matrix of unit rows: below any accuracy asked for, above rounding


@dataclass(frozen=True, slots=True)
class Hyper:
    """What shapes the fit, apart from ε.

    Args:
        rbf: Name of φ, a key of `RADIAL_FUNCTIONS`.
        sigma: σ of eq. RBF-pref, above 0: how far apart two samples of different merit are.
        lam: λ of eq. QP-pref; 0 makes it a linear program.
        margin_power: See `margin_factors`; 0 is eq. RBF-pref.
    """

    rbf: str = "inverse_quadratic"
    sigma: float = 1e-6
    lam: float = 1.0
    margin_power: float = 0.0


@dataclass(frozen=True, slots=True)
class Surrogate:
    """Ĵ of eq. rbf: centres (N, n) in the unit cube, weights β (N,), ε and the name of φ."""

    centres: Float[np.ndarray, "N n"]
    beta: Float[np.ndarray, " N"]
    epsilon: float
    rbf: str

    def __call__(self, z: Float[np.ndarray, "m n"]) -> Float[np.ndarray, " m"]:
        """Ĵ at the rows of `z`, shape (m, n), unit cube; shape (m,)."""
        return self.at(squared_distances(z, self.centres))

    def at(self, d: Float[np.ndarray, "m N"]) -> Float[np.ndarray, " m"]:
        """Ĵ where the squared distances to the centres are `d`, shape (m, N)."""
        return np.asarray(basis(d, self.epsilon, self.rbf) @ self.beta)

    def gradient(self, z: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """∂Ĵ/∂z at one point of the cube, shape (n,)."""
        away = z - self.centres
        d = np.sum(away * away, axis=1)
        slope = RADIAL_FUNCTIONS[self.rbf].slope((self.epsilon * d) ** 2)
        # du/dz = ε² 2d ∂d/dz and ∂d/dz = 2 (z - centre).
        return np.asarray((4 * self.epsilon**2 * self.beta * slope * d) @ away)

    @property
    def spread(self) -> float:
        """ΔĴ: the range of Ĵ over the samples, which normalises eq. acquisition."""
        return float(np.ptp(self(self.centres)))


def basis(d: Float[np.ndarray, "m N"], epsilon: float, rbf: str) -> Float[np.ndarray, "m N"]:
    """φ(εd) of eq. rbf for squared distances `d`."""
    return RADIAL_FUNCTIONS[rbf].value((epsilon * d) ** 2)


def fit(
    preferences: Preferences,
    phi: Float[np.ndarray, "N N"],
    hyper: Hyper,
    backend: Backend,
    noise: Float[np.ndarray, " M"] | None = None,
) -> Float[np.ndarray, " N"]:
    """Weights β of eq. QP-pref, shape (N,); zero where nothing is known.

    The problem is divided by σ: with β = σ β' the margin is 1 and λ becomes λσ, which leaves
    the minimiser as it is and the numbers near 1. For λ > 0 the dual is solved, in one
    multiplier α per row (two for a tie), 0 <= α <= c_h / (λσ): it has no slacks, and half the
    variables of the primal; then β' is a combination of the rows.

    Source: eq. QP-pref.
    Deviation: the margin of a comparison is `margin_factors` times σ, times `noise`; with
    margin_power 0 and no noise there is none.

    Args:
        preferences: M comparisons of N samples.
        phi: φ(εd) between all samples, shape (N, N).
        hyper: σ, λ and margin_power; its φ is not used here.
        backend: QP solver, used for λ > 0.
        noise: Factor on each margin, above 0, shape (M,); None for 1.
    """
    if len(preferences) == 0:
        return np.zeros(len(phi))
    factors = margin_factors(preferences, hyper.margin_power)
    rows, margins, weights = constraints(
        preferences, phi, factors if noise is None else factors * noise
    )
    if hyper.lam == 0:
        return hyper.sigma * _linear_program(rows, margins, preferences)
    ceiling = weights / (hyper.lam * hyper.sigma)
    alpha = _dual(rows, margins, ceiling, backend)
    return np.asarray(hyper.sigma * (alpha @ rows))


def margin_factors(preferences: Preferences, power: float) -> Float[np.ndarray, " M"]:
    """By how much the margin of each comparison differs from σ, in (0, 1], shape (M,).

    Source: eq. RBF-pref has the same margin σ everywhere, which `power` 0 gives.
    Deviation: a continuous index differs little between close samples, yet one margin for
    all makes Ĵ as steep as their distance is small, and later samples then miss the minimum.
    So the margin grows with (distance / √n)^power up to a distance of 0.3 √n of the cube.
    """
    if power == 0:
        return np.ones(len(preferences))
    apart = preferences.samples[preferences.first] - preferences.samples[preferences.second]
    share = np.sqrt(np.mean(apart**2, axis=1)) / _FAR
    return np.asarray(np.clip(share, _NEAR, 1.0) ** power)


def constraints(
    preferences: Preferences,
    phi: Float[np.ndarray, "N N"],
    factors: Float[np.ndarray, " M"],
) -> tuple[Float[np.ndarray, "R N"], Float[np.ndarray, " R"], Float[np.ndarray, " R"]]:
    """Eq. RBF-pref, divided by σ, as rows · β' >= margins - slack; and c_h of each row.

    A strict preference gives one row with its factor as margin, a tie two opposite rows with
    the factor turned negative. Strict preferences come first, then all ties, then all ties
    again with the sign turned.
    """
    difference = phi[preferences.first] - phi[preferences.second]
    tie = preferences.b == 0
    strict = difference[~tie] * preferences.b[~tie, None]
    rows = np.vstack([strict, difference[tie], -difference[tie]])
    margins = np.concatenate([factors[~tie], -factors[tie], -factors[tie]])
    weights = preferences.weights
    return rows, margins, np.concatenate([weights[~tie], weights[tie], weights[tie]])


def _dual(
    rows: Float[np.ndarray, "R N"],
    margins: Float[np.ndarray, " R"],
    ceiling: Float[np.ndarray, " R"],
    backend: Backend,
) -> Float[np.ndarray, " R"]:
    """Multipliers: min ½|rowsᵀα|² - margins·α subject to 0 <= α <= ceiling, shape (R,)."""
    # Rows of close samples are short and their multipliers huge; unit rows even that out.
    length = np.maximum(np.linalg.norm(rows, axis=1), _SHORTEST)
    unit = rows / length[:, None]
    gram = unit @ unit.T
    scale = np.max(1 / length)
    solution = backend.solve(
        QP(
            P=0.5 * (gram + gram.T) + _RIDGE * np.eye(len(gram)),
            q=-margins / length / scale,
            G=np.eye(len(gram)),
            lower=np.zeros(len(gram)),
            upper=ceiling * length / scale,
        )
    )
    if not np.all(np.isfinite(solution.z)):
        return np.zeros(len(rows))
    return np.asarray(np.clip(solution.z * scale / length, 0.0, ceiling))


def _linear_program(
    rows: Float[np.ndarray, "R N"],
    margins: Float[np.ndarray, " R"],
    preferences: Preferences,
) -> Float[np.ndarray, " N"]:
    """β' for λ = 0: min c·slack subject to rows · β' + slack >= margins, slack >= 0."""
    from scipy.optimize import linprog  # heavy, and needed for λ = 0 only

    strict = int(np.count_nonzero(preferences.b))
    ties = len(preferences) - strict
    # One slack per comparison: the two rows of a tie share theirs.
    owner = np.concatenate([np.arange(strict), *[strict + np.arange(ties)] * 2]).astype(int)
    slack = np.zeros((len(rows), len(preferences)))
    slack[np.arange(len(rows)), owner] = 1.0
    weights = np.concatenate(
        [preferences.weights[preferences.b != 0], preferences.weights[preferences.b == 0]]
    )
    n = rows.shape[1]
    result = linprog(
        c=np.concatenate([np.zeros(n), weights]),
        A_ub=-np.hstack([rows, slack]),
        b_ub=-margins,
        bounds=[(None, None)] * n + [(0, None)] * len(preferences),
        method="highs",
    )
    return np.zeros(n) if result.x is None else np.asarray(result.x[:n], dtype=float)
