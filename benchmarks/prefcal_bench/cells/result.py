"""The result of a cell, and a digest of many results."""

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from math import isfinite, isnan
from typing import Any

from prefcal_env.errors import SettingsError
from prefcal_env.own_line import whole

from .cell import Cell, canonical, read_as

Theta = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Result:
    """Course of a study of N experiments.

    A gap is the noise-free latent cost minus the best known cost, so 0 is the optimum. A gap just
    below 0 means that a measured best known cost was beaten; a gap far below 0 lies in a hole of
    the cost that gaps exclude (`problems.HOLES`).

    Args:
        cell: Cell that was run.
        thetas: Physical θ that were tried, in order; N tuples.
        gaps: Gap of the θ that the agent would return after each experiment, N values; None if
            the problem has no cost.
        visited: Smallest gap of all θ tried so far, N values; None if `gaps` is.
        questions: Number of questions answered up to each experiment, N values.
        best: θ that the agent returned.
        failure: Reason why the cell failed; all other fields are then empty.
        seconds: Time of a proposal at the end (median of the last five), measured in serial runs
            only and ignored when results are compared.
        worth: Worth of the θ that the agent would return after each experiment, N values, see
            `prefcal_bench.people.worth`; None if there is no pool.
        kpi_names: Names of the scenario's KPIs.
        kpis: KPIs of each experiment, N rows in that order; empty if the problem has none.
        comparisons: Challenger, incumbent and answer of each question: -1 if the challenger is
            better, 0 for a tie, 1 if the incumbent is; empty if the agent is told values.
        simulated: Number of θ that the agent simulated; None if it does not simulate.

    Raises:
        SettingsError: If lengths do not fit each other, or there are NaN values.
    """

    cell: Cell
    thetas: tuple[Theta, ...]
    gaps: tuple[float, ...] | None
    visited: tuple[float, ...] | None
    questions: tuple[int, ...]
    best: Theta
    failure: str = ""
    seconds: float | None = None
    worth: tuple[float, ...] | None = None
    kpi_names: tuple[str, ...] = ()
    kpis: tuple[tuple[float, ...], ...] = ()
    comparisons: tuple[tuple[int, int, int], ...] = ()
    simulated: int | None = None

    def __post_init__(self) -> None:
        count = len(self.thetas)
        for name in ("gaps", "visited", "questions", "worth"):
            column = getattr(self, name)
            if column is not None and len(column) != count:
                raise SettingsError(f"{name} must have {count} values, got {len(column)}")
        if (count == 0) != bool(self.failure):
            raise SettingsError("a result must have experiments, or else say why the cell failed")
        if self.kpis and len(self.kpis) != count:
            raise SettingsError(f"kpis must have {count} rows, got {len(self.kpis)}")
        rows = (*self.thetas, self.best, self.gaps or (), self.visited or (), self.worth or ())
        if any(isnan(value) for row in rows for value in row):
            raise SettingsError(f"a result of {self.cell} must hold numbers, got NaN")

    @classmethod
    def failed(cls, cell: Cell, why: str) -> "Result":
        """Return the result of a cell that failed."""
        return cls(cell, (), (), (), (), (), failure=whole(why) or "for no stated reason")

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON; floats are exact, and infinity is a word."""
        plain: dict[str, Any] = _plain(asdict(self))
        if self.simulated is None:  # results of before agents could simulate stay the same
            del plain["simulated"]
        return plain

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> "Result":
        """Return the result for the data that `to_dict` returned, before or after JSON.

        Raises:
            SettingsError: If anything is missing, malformed or unknown.
        """
        known = {"simulated": None, **data} if isinstance(data, Mapping) else data
        return read_as(cls, known)


def digest(results: Iterable[Result]) -> str:
    """Return the sha256 in hex of all results, sorted by cell, so their order does not matter.

    Times are excluded, and so is the text of a failure, which can contain process ids or
    addresses. Whether a cell failed is included.
    """
    total = hashlib.sha256()
    for result in sorted(results, key=lambda result: result.cell):
        content = result.to_dict() | {"seconds": None, "failure": bool(result.failure)}
        total.update(canonical(content).encode() + b"\n")
    return total.hexdigest()


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _plain(one) for name, one in value.items()}
    if isinstance(value, (tuple, list)):
        return [_plain(one) for one in value]
    return str(value) if isinstance(value, float) and not isfinite(value) else value
