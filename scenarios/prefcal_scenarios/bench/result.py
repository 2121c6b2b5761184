"""What came out of a cell."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from math import isfinite, isnan
from typing import Any

from prefcal_env.errors import SettingsError
from prefcal_scenarios.own_line import whole

from .cell import Cell

Theta = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Result:
    """What an agent did in a cell, experiment by experiment; N experiments.

    A gap is the latent cost, free of noise, minus the best known one: 0 is the optimum. Where a
    best known value is only measured, a better one would show as a gap just below 0; a gap far
    below 0 lies in a hole of the cost that gaps leave out (`problems.HOLES`).

    Args:
        cell: Which cell.
        thetas: θ tried, physical, in their order; N tuples.
        gaps: Gap of the θ that the agent would return after each experiment, N of them; None
            where the problem has no cost.
        visited: Smallest gap of all θ tried until then, N of them; None as `gaps`.
        questions: Questions that had been answered when each experiment was settled, N of them.
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
        """The result of a cell that failed."""
        return cls(cell, (), (), (), (), (), failure=whole(why) or "for no stated reason")

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON; floats survive exactly, an infinite one as a word."""
        plain: dict[str, Any] = _plain(asdict(self))
        return plain

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> "Result":
        """Read what `to_dict` gave, before or after JSON.

        Raises:
            SettingsError: something is missing, malformed or unknown.
        """
        names = {f.name for f in fields(cls)}
        if not isinstance(data, Mapping) or set(data) != names:
            raise SettingsError(f"a result must have {sorted(names)}, got {data!r}")
        try:
            return cls(
                cell=Cell.from_dict(data["cell"]),
                thetas=tuple(_floats(theta) for theta in data["thetas"]),
                gaps=None if data["gaps"] is None else _floats(data["gaps"]),
                visited=None if data["visited"] is None else _floats(data["visited"]),
                questions=tuple(int(count) for count in data["questions"]),
                best=_floats(data["best"]),
                failure=str(data["failure"]),
                seconds=None if data["seconds"] is None else float(data["seconds"]),
            )
        except (TypeError, ValueError) as error:
            raise SettingsError(f"a result cannot be read: {error}") from error


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _plain(one) for name, one in value.items()}
    if isinstance(value, (tuple, list)):
        return [_plain(one) for one in value]
    return str(value) if isinstance(value, float) and not isfinite(value) else value


def _floats(values: Any) -> Theta:
    return tuple(float(value) for value in values)
