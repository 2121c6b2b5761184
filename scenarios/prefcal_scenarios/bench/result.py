"""The result of a cell, and one number for many results."""

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from math import isfinite, isnan
from typing import Any

from prefcal_env.errors import SettingsError
from prefcal_scenarios.own.own_line import whole

from .cell import Cell, canonical, read_as

Theta = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Result:
    """The course of a study of N experiments.

    A gap is the latent cost, free of noise, minus the best known one: 0 is the optimum. Where a
    best known value is only measured, a better one would show as a gap just below 0; a gap far
    below 0 lies in a hole of the cost that gaps leave out (`problems.HOLES`).

    Args:
        cell: The cell that was run.
        thetas: θ tried, physical, in their order; N tuples.
        gaps: Gap of the θ that the agent would return after each experiment, N values; None
            where the problem has no cost.
        visited: Smallest gap of all θ tried until then, N values; None as `gaps`.
        questions: Number of questions answered up to each experiment, N values.
        best: θ that the agent returned.
        failure: Why the cell failed; then everything else is empty.
        seconds: Time of a proposal at the end (median of the last five); measured in serial
            runs only, and never compared.

    Raises:
        SettingsError: lengths that do not fit each other, or NaN.
    """

    cell: Cell
    thetas: tuple[Theta, ...]
    gaps: tuple[float, ...] | None
    visited: tuple[float, ...] | None
    questions: tuple[int, ...]
    best: Theta
    failure: str = ""
    seconds: float | None = None

    def __post_init__(self) -> None:
        count = len(self.thetas)
        for name in ("gaps", "visited", "questions"):
            column = getattr(self, name)
            if column is not None and len(column) != count:
                raise SettingsError(f"{name} must have {count} values, got {len(column)}")
        if (count == 0) != bool(self.failure):
            raise SettingsError("a result must have experiments, or else say why the cell failed")
        rows = (*self.thetas, self.best, self.gaps or (), self.visited or ())
        if any(isnan(value) for row in rows for value in row):
            raise SettingsError(f"a result of {self.cell} must hold numbers, got NaN")

    @classmethod
    def failed(cls, cell: Cell, why: str) -> "Result":
        """Return the result of a cell that failed."""
        return cls(cell, (), (), (), (), (), failure=whole(why) or "for no stated reason")

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON; floats survive exactly, an infinite one as a word."""
        plain: dict[str, Any] = _plain(asdict(self))
        return plain

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> "Result":
        """Read what `to_dict` gave, before or after JSON.

        Raises:
            SettingsError: something is missing, malformed or unknown.
        """
        return read_as(cls, data)


def digest(results: Iterable[Result]) -> str:
    """Return the sha256 in hex of all results in the order of their cells, in whatever order given.

    Times are left out, and so is the text of a failure, which may name a process or an address.
    That a cell failed counts.
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
