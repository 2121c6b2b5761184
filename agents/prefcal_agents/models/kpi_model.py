"""What happened, beside θ: the KPIs of all samples, and what they would be at another θ."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from prefcal_agents.history.history import History

from .interpolant import Interpolant, best_interpolants, normalised

CEILING = 2.0  # see `normalised`: an interrupted run must not flatten the differences of others
_EPSILONS = (0.1, 0.18, 0.32, 0.56, 1.0, 1.8, 3.2)
_RBF = "inverse_quadratic"
_FEWEST = 3  # values that a KPI needs before anything can be foretold
_FORESEEABLE = 0.9  # of the error of foretelling the mean, below which θ does tell something


@dataclass(frozen=True, slots=True)
class Outcomes:
    """p KPIs of N samples, and each as a function of θ.

    Args:
        columns: Lower is better; 0 for the best sample and 1 for the worst, shape (N, p).
        models: Each column interpolated over the cube scaled to [-1, 1].
        names: Of the KPIs, p of them.
        ranges: Of each KPI, the values that count as 0 and as 1, in its unit.
        errors: Of each KPI, by how much its model is wrong at a left-out sample, in units of how
            wrong the mean of the others is.
    """

    columns: Float[np.ndarray, "N p"]
    models: tuple[Interpolant, ...]
    names: tuple[str, ...]
    ranges: tuple[tuple[float, float], ...]
    errors: tuple[float, ...]

    @classmethod
    def none(cls) -> "Outcomes":
        """No KPIs at all."""
        return cls(np.zeros((0, 0)), (), (), (), ())

    @classmethod
    def of(cls, history: History) -> "Outcomes":
        """Those that the answers in `history` hold.

        A value that is missing or no number is filled in by its KPI's interpolation; an infinite
        one counts as the worst. A KPI with fewer than three values, or always the same, is left
        out: nothing can be learned from it.
        """
        known = history.outcomes()
        x = 2 * history.cube() - 1
        # KPIs that are known of the same samples share the costly part.
        alike: dict[tuple[int, ...], list[_KPI]] = {}
        for name in sorted({name for outcome in known for name in outcome}):
            kpi = _KPI.of(known, name)
            if len(kpi.there) >= _FEWEST and np.ptp(kpi.shares) > 0:
                alike.setdefault(tuple(kpi.there), []).append(kpi)
        columns, models, kpis, errors = [], [], [], []
        for group in alike.values():
            there, shares = group[0].there, np.array([kpi.shares for kpi in group]).T
            alone = np.std(shares, axis=0) * len(there) / (len(there) - 1)
            best = best_interpolants(x[there], shares, _EPSILONS, _RBF)
            for k, (model, error) in enumerate(best):
                column = np.clip(model(x), 0.0, 1.0) if len(there) < len(x) else np.zeros(len(x))
                column[there] = shares[:, k]
                columns.append(column)
                models.append(model)
                kpis.append(group[k])
                errors.append(error / float(alone[k]))
        return cls(
            columns=np.array(columns).reshape(len(columns), len(x)).T,
            models=tuple(models),
            names=tuple(kpi.name for kpi in kpis),
            ranges=tuple(kpi.range for kpi in kpis),
            errors=tuple(errors),
        )

    def foreseeable(self) -> "Outcomes":
        """Those KPIs that θ foretells: the others cannot say where to go, and lead astray."""
        kept = [k for k, error in enumerate(self.errors) if error < _FORESEEABLE]
        return Outcomes(
            self.columns[:, kept],
            tuple(self.models[k] for k in kept),
            tuple(self.names[k] for k in kept),
            tuple(self.ranges[k] for k in kept),
            tuple(self.errors[k] for k in kept),
        )

    def __len__(self) -> int:
        return len(self.models)


@dataclass(frozen=True, slots=True)
class _KPI:
    """One KPI: at which samples it is known, how bad it is there, and what counts as 0 and 1."""

    name: str
    there: Int[np.ndarray, " K"]
    shares: Float[np.ndarray, " K"]
    range: tuple[float, float]

    @classmethod
    def of(cls, known: Sequence[Mapping[str, float]], name: str) -> "_KPI":
        values = np.array([outcome.get(name, np.nan) for outcome in known], dtype=float)
        there = np.flatnonzero(~np.isnan(values))
        values = values[there]
        finite = np.isfinite(values)
        shares = np.where(values > 0, 1.0, 0.0)  # of the infinite ones
        if not finite.any():
            return cls(name, there, shares, (0.0, np.inf))
        shares[finite] = normalised(values[finite], CEILING)
        best = float(values[finite].min())
        if not shares[finite].any():
            return cls(name, there, shares, (best, np.inf))  # only an infinite one is worse
        # Shares are linear in the values up to where they are cut off, or up to the largest.
        inner = int(np.argmax(np.where(shares[finite] < 1.0, shares[finite], 0.0)))
        share, value = float(shares[finite][inner]), float(values[finite][inner])
        worst = best + (value - best) / share if share > 0 else float(values[finite].max())
        return cls(name, there, shares, (best, worst))


@dataclass(frozen=True, slots=True)
class KPIModel:
    """What the KPIs add to the surrogate: Σ w_k times KPI k, foretold at any θ.

    Args:
        outcomes: The KPIs.
        weights: w, 0 or more, shape (p,).
    """

    outcomes: Outcomes
    weights: Float[np.ndarray, " p"]

    def __call__(self, z: Float[np.ndarray, "m n"]) -> Float[np.ndarray, " m"]:
        """Value at the rows of `z`, unit cube, shape (m,)."""
        total = np.zeros(len(z))
        for weight, model in self._terms():
            total += weight * model(2 * z - 1)
        return total

    def gradient(self, z: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Gradient at one point of the cube, shape (n,)."""
        total = np.zeros(len(z))
        for weight, model in self._terms():
            total += 2 * weight * model.gradient(2 * z - 1)
        return total

    def _terms(self) -> list[tuple[float, Interpolant]]:
        """The KPIs that count."""
        most = float(np.max(self.weights, initial=0.0))
        pairs = zip(self.weights, self.outcomes.models, strict=True)
        return [(float(w), model) for w, model in pairs if w > 1e-6 * most]
