"""Gaussian processes: their kernel, and fits to comparisons.

`ExpectationPropagation` learns from answers, some of which may be wrong, and `PreferenceGP` is a
process trained on comparisons only.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dpotrf, dtrtrs
from scipy.special import ndtr

from prefcal_agents.history.lessons import Preferences

from .preference_qp import Constraints

SHORTEST, LONGEST = 0.03, 10.0
"""Bounds of a length, in units of the cube."""
_ROOT5 = np.sqrt(5.0)
_PER_ROOT, _SPREAD = 0.35, 1.0  # prior of a length: median / √n, deviation of its logarithm
_NUGGET = 1e-9  # variance added for the Cholesky factor; that of the process is 1
_FEWER_STEPS = 10  # maximum number of steps of the fit of the lengths
_RECENT = 100  # number of samples, compared last, that it is trained on, for speed
_SWEEPS = 40  # maximum; 20 to 30 are enough unless answers that are surely right contradict
_DAMPING = 0.7  # share of each step to take, for all sites at once
_SETTLED = 1e-2  # converged when no site's precision changes relatively by more than this
_TINY = 1e-12  # a shorter row counts as this long
_LEAST, _LARGEST = 1e-8, 1e8  # bounds of a site's precision
_FLAT = 1e-6  # precision of a site without information
_SURE = 1e-6  # smallest error rate, for rounding; that of rows that are not answers


def squares(a: Float[np.ndarray, "m n"], b: Float[np.ndarray, "N n"]) -> Float[np.ndarray, "n m N"]:
    """Return the squared differences of every knob."""
    return np.asarray((a.T[:, :, None] - b.T[:, None, :]) ** 2)


def matern(u: Float[np.ndarray, "n m N"]) -> tuple[Float[np.ndarray, "m N"], Float[np.ndarray, "m N"]]:
    """Return the kernel, and twice its slope in Σ u, for squared differences u scaled by 1/ℓ².

    Source: C. E. Rasmussen, C. K. I. Williams, "Gaussian Processes for Machine Learning" (2006),
    equation 4.17.
    """
    r = np.sqrt(np.sum(u, axis=0))
    decay = np.exp(-_ROOT5 * r)
    return (1 + _ROOT5 * r + 5 / 3 * r * r) * decay, -5 / 3 * (1 + _ROOT5 * r) * decay


@dataclass(frozen=True, slots=True)
class Sites:
    """Normal distributions that approximate R answers, over rows · β with rows of length 1.

    Args:
        precision: Precision of each site, shape (R,).
        shift: Precision times mean of each site, shape (R,).
    """

    precision: Float[np.ndarray, " R"]
    shift: Float[np.ndarray, " R"]

    @classmethod
    def flat(cls, count: int) -> "Sites":
        """Return `count` sites without information."""
        return cls(np.full(count, _FLAT), np.zeros(count))

    def toward(self, other: "Sites") -> "Sites":
        """Return the sites after a damped step toward `other`."""
        return Sites(
            self.precision + _DAMPING * (other.precision - self.precision),
            self.shift + _DAMPING * (other.shift - self.shift),
        )


@dataclass(frozen=True, slots=True)
class ExpectationPropagation:
    """A normal distribution of β, from answers that are each wrong with some probability.

    The prior of β is standard normal, which matches βᵀβ in eq. QP-pref. An answer is right with
    probability 1 - e: only the signs of rows · β count, not their margins. So an answer that all
    others contradict has little influence, whereas with the slack of eq. QP-pref a mistake pulls
    harder the worse it is.

    Source: expectation propagation for such a likelihood, Kim and Ghahramani, SSPR 2008.
    Deviation: replaces eq. QP-pref if answers contradict each other.

    Args:
        mean: Mean of β, shape (N,).
        root: Lower Cholesky factor of the precision of β, shape (N, N).
        predicted: Sum of the log probabilities of the answers, each predicted from the others.
        wrong: Probability that each row is a mistake, shape (R,).
        evidence: Log probability of all rows together.
        sites: Sites of the rows; a starting point for similar fits.
    """

    mean: Float[np.ndarray, " N"]
    root: Float[np.ndarray, "N N"]
    predicted: float
    wrong: Float[np.ndarray, " R"]
    evidence: float
    sites: Sites

    @classmethod
    def of(
        cls, constraints: Constraints, error_rate: float, start: Sites | None = None
    ) -> "ExpectationPropagation":
        """Fit to answers that are each wrong with probability `error_rate`; ties are ignored.

        Starting from the sites `start` is faster and gives the same result within tolerance.
        """
        strict = constraints.margins >= 0
        unit = unit_rows(constraints.rows[strict])
        answered = constraints.owner[strict] >= 0
        e = np.where(answered, error_rate, _SURE)
        sites = Sites.flat(len(unit)) if start is None else start
        for _ in range(_SWEEPS):
            matched = _Rest.of(unit, sites).matched(e)
            change = np.abs(matched.precision - sites.precision) / (1 + sites.precision)
            sites = sites.toward(matched)
            if change.max(initial=0.0) < _SETTLED:
                break
        rest = _Rest.of(unit, sites)
        mean, _ = dtrtrs(rest.root, rest.half, lower=1, trans=1)
        probability, right = rest.probability(e)
        return cls(
            mean=mean,
            root=rest.root,
            predicted=float(np.sum(np.log(probability[answered]))),
            wrong=np.asarray((e * (1 - right) / probability)[answered]),
            evidence=rest.evidence(sites, probability),
            sites=sites,
        )

    def deviations(self, rows: Float[np.ndarray, "R N"]) -> Float[np.ndarray, " R"]:
        """Return how many standard deviations each of rows · β is above 0, shape (R,)."""
        across, _ = dtrtrs(self.root, rows.T, lower=1)
        deviation = np.maximum(np.sqrt(np.sum(across * across, axis=0)), _TINY)
        return np.asarray(rows @ self.mean / deviation)


@dataclass(frozen=True, slots=True)
class _Rest:
    """The posterior of β from all rows, and for each row the cavity: what the other rows say."""

    root: Float[np.ndarray, "N N"]
    half: Float[np.ndarray, " N"]
    m: Float[np.ndarray, " R"]
    precision: Float[np.ndarray, " R"]
    z: Float[np.ndarray, " R"]

    @classmethod
    def of(cls, unit: Float[np.ndarray, "R N"], sites: Sites) -> "_Rest":
        inner = (unit.T * sites.precision) @ unit
        inner.flat[:: len(inner) + 1] += 1.0
        root, _ = dpotrf(inner, lower=1, clean=1)
        across, _ = dtrtrs(root, unit.T, lower=1)
        variance = np.maximum(np.einsum("ij,ij->j", across, across), 1e-10)
        half = across @ sites.shift
        precision = np.maximum(1 / variance - sites.precision, _LEAST)
        m = (across.T @ half / variance - sites.shift) / precision
        return cls(root, half, m, precision, m * np.sqrt(precision))

    def probability(
        self, e: Float[np.ndarray, " R"]
    ) -> tuple[Float[np.ndarray, " R"], Float[np.ndarray, " R"]]:
        """Return the probability of each answer given the error rate, and that it is right."""
        right = ndtr(self.z)
        return np.maximum(e + (1 - 2 * e) * right, 1e-300), right

    def matched(self, e: Float[np.ndarray, " R"]) -> Sites:
        """Return the sites that match the true mean and variance of each answer."""
        z, v = self.z, 1 / self.precision
        density = np.exp(-z * z / 2) / np.sqrt(2 * np.pi * v)
        slope = (1 - 2 * e) * density / self.probability(e)[0]
        after = np.maximum(v - v * v * slope * (self.m / v + slope), 1e-12)
        target = np.minimum(np.maximum(1 / after - self.precision, _LEAST), _LARGEST)
        to = (self.m + v * slope) * (self.precision + target) - self.m * self.precision
        return Sites(target, to)

    def evidence(self, sites: Sites, probability: Float[np.ndarray, " R"]) -> float:
        """Return the log of the integral over β of prior and sites, scaled like the answers."""
        whole = self.precision + sites.precision
        pull = (self.m * self.precision + sites.shift) ** 2 / whole - self.m**2 * self.precision
        each = np.log(probability) + 0.5 * np.log(whole / self.precision) - 0.5 * pull
        together = 0.5 * self.half @ self.half - np.sum(np.log(np.diag(self.root)))
        return float(np.sum(each) + together)


def unit_rows(rows: Float[np.ndarray, "R N"]) -> Float[np.ndarray, "R N"]:
    """Return the rows scaled to length 1, which keeps the signs of rows · β."""
    length = np.sqrt(np.sum(rows * rows, axis=1))
    return np.asarray(rows / np.maximum(length, _TINY)[:, None])


@dataclass(frozen=True, slots=True)
class PreferenceGP:
    """Mean of a Gaussian process, given comparisons of its values at N samples.

    Source: W. Chu, Z. Ghahramani, "Preference learning with Gaussian processes", ICML 2005, with
    expectation propagation (`ExpectationPropagation`) in place of their Laplace approximation.
    Deviation: replaces eq. QP-pref for some proposals (`is_process_turn`). That gives one
    Ĵ that reproduces the answers, by the smallest weights. This is the average of all functions
    that (nearly) reproduce them, in which smooth ones count more; the lengths show which knobs
    matter. It is trained on the last 100 samples that were compared. Measured in
    docs/research/archive.md.

    Args:
        centers: Samples in the unit cube, shape (N, n).
        lengths: Length ℓ of each knob, shape (n,).
        alpha: Vector K⁻¹ times the mean at the samples, shape (N,).
    """

    centers: Float[np.ndarray, "N n"]
    lengths: Float[np.ndarray, " n"]
    alpha: Float[np.ndarray, " N"]

    @classmethod
    def of(cls, preferences: Preferences, error_rate: float = 0.0) -> "PreferenceGP":
        """Fit the process with the most likely lengths; at least one answer must not be a tie.

        Each answer is wrong with probability `error_rate`.
        """
        known = _Known.of(preferences, max(error_rate, _SURE))
        lengths, start = known.likeliest()
        factor = known.factor(lengths)[0]
        posterior = known.posterior(factor, start)
        alpha = solve_triangular(factor, posterior.mean, lower=True, trans=1)
        return cls(known.centers, lengths, np.asarray(alpha))

    def __call__(self, z: Float[np.ndarray, "m n"]) -> Float[np.ndarray, " m"]:
        """Return the mean at the rows of `z`, shape (m,), without unit; lower is better."""
        u = squares(z, self.centers) / self.lengths[:, None, None] ** 2
        return np.asarray(matern(u)[0] @ self.alpha)

    def value_and_gradient(self, z: Float[np.ndarray, " n"]) -> tuple[float, Float[np.ndarray, " n"]]:
        """Return the mean and its gradient at one point of the cube, shape (n,)."""
        away = (z - self.centers) / self.lengths
        kernel, slope = (each[:, 0] for each in matern((away.T**2)[:, :, None]))
        return float(kernel @ self.alpha), np.asarray((self.alpha * slope) @ away / self.lengths)

    @property
    def spread(self) -> float:
        """Return the range of the mean over the samples."""
        return float(np.ptp(self(self.centers)))


def predicted(preferences: Preferences, error_rate: float) -> float:
    """Return how well a process over θ predicts each strict answer from the others.

    Args:
        preferences: One strict answer or more.
        error_rate: Probability that an answer is wrong.

    Returns:
        The sum of the logarithms of their probabilities.
    """
    known = _Known.of(preferences, error_rate)
    lengths, start = known.likeliest()
    return float(known.posterior(known.factor(lengths)[0], start).predicted)


@dataclass(frozen=True, slots=True)
class _Known:
    """R strict comparisons of N samples, each wrong with probability `error_rate`.

    Each row has a 1 at the losing sample and a -1 at the winning one.
    """

    centers: Float[np.ndarray, "N n"]
    constraints: Constraints
    apart: Float[np.ndarray, "n N N"]
    error_rate: float

    @classmethod
    def of(cls, preferences: Preferences, error_rate: float) -> "_Known":
        """Return the comparisons of the last samples, without ties."""
        strict = np.flatnonzero(preferences.b)
        first, second = preferences.first[strict], preferences.second[strict]
        samples, at = np.unique(np.stack([first, second], 1).ravel()[::-1], return_index=True)
        recent = np.sort(samples[np.argsort(at)[:_RECENT]])
        kept = strict[np.isin(first, recent) & np.isin(second, recent)]
        one_each = np.eye(len(preferences.samples))[:, recent]
        centers = preferences.samples[recent]
        return cls(
            centers,
            Constraints.of(preferences.subset(kept), one_each, np.ones(len(kept))),
            squares(centers, centers),
            error_rate,
        )

    def factor(
        self, lengths: Float[np.ndarray, " n"]
    ) -> tuple[Float[np.ndarray, "N N"], Float[np.ndarray, "n N N"], Float[np.ndarray, "N N"]]:
        """Return the Cholesky factor of the kernel, the scaled squares and the kernel's slope."""
        u = self.apart / lengths[:, None, None] ** 2
        kernel, slope = matern(u)
        return np.linalg.cholesky(kernel + _NUGGET * np.eye(len(kernel))), u, slope

    def posterior(self, factor: Float[np.ndarray, "N N"], start: Sites | None) -> ExpectationPropagation:
        """Return the posterior of β, where the values at the samples are factor · β."""
        rows = self.constraints.rows @ factor
        return ExpectationPropagation.of(replace(self.constraints, rows=rows), self.error_rate, start)

    def likeliest(self) -> tuple[Float[np.ndarray, " n"], Sites | None]:
        """Return ℓ that maximizes evidence times a log-normal prior, and sites close to it."""
        from scipy.optimize import minimize

        n = len(self.apart)
        expected, sites = np.log(_PER_ROOT * np.sqrt(n)), None

        def loss(logs: Float[np.ndarray, " n"]) -> tuple[float, Float[np.ndarray, " n"]]:
            nonlocal sites  # each fit starts from the last sites
            factor, u, slope = self.factor(np.exp(logs))
            posterior = self.posterior(factor, sites)
            sites = posterior.sites
            beyond = (logs - expected) / _SPREAD
            # ∂K/∂log ℓ_j = -slope u_j.
            gradient = 0.5 * np.einsum("mN,jmN->j", self._pull(factor, posterior) * slope, u)
            value = -posterior.evidence + 0.5 * beyond @ beyond
            return float(value), gradient + beyond / _SPREAD

        found = minimize(
            loss,
            np.full(n, expected),
            jac=True,
            method="L-BFGS-B",
            bounds=[(np.log(SHORTEST), np.log(LONGEST))] * n,
            options={"maxiter": _FEWER_STEPS},
        )
        return np.asarray(np.exp(found.x)), sites

    def _pull(
        self, factor: Float[np.ndarray, "N N"], posterior: ExpectationPropagation
    ) -> Float[np.ndarray, "N N"]:
        """Return twice the slope of the evidence in the kernel, at fixed sites.

        Source: Rasmussen and Williams (2006), equation 5.27, for the differences of the values.
        """
        rows, sites = self.constraints.rows, posterior.sites
        length = np.sqrt(np.sum((rows @ factor) ** 2, axis=1))
        scaled, unit = rows / length[:, None], unit_rows(rows @ factor)
        weighted = sites.precision[:, None] * scaled
        ahead = scaled.T @ (sites.shift - sites.precision * (unit @ posterior.mean))
        across = solve_triangular(posterior.root, unit.T @ weighted, lower=True)
        return np.asarray(np.outer(ahead, ahead) - scaled.T @ weighted + across.T @ across)
