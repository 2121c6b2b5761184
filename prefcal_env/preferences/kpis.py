"""Outcome of an experiment as an agent sees it: KPIs without trajectories."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from prefcal_env.errors import PreferenceError

_NUMBERS: Mapping[Any, float] = {"inf": np.inf, "-inf": -np.inf}


class Outcome(Mapping[str, float]):
    """KPIs of an experiment by name, frozen and hashable: lower is better, infinity means never.

    Args:
        kpis: Maps a name to its value; NaN means unknown and is dropped.

    Raises:
        PreferenceError: If a name is not a string or a value is not a number.
    """

    def __init__(self, kpis: Mapping[str, float]) -> None:
        self._kpis = numbers(kpis)

    def __getitem__(self, name: str) -> float:
        return self._kpis[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._kpis)

    def __len__(self) -> int:
        return len(self._kpis)

    def __hash__(self) -> int:
        return hash(tuple(self._kpis.items()))

    def __repr__(self) -> str:
        return f"Outcome({self._kpis!r})"

    def to_dict(self) -> dict[str, float | str]:
        """Return plain data for JSON, which has no infinity: it becomes the text "inf"."""
        return {k: v if np.isfinite(v) else str(v) for k, v in self._kpis.items()}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> "Outcome":
        """Read the data that `to_dict` returns. Raises PreferenceError for anything else."""
        if not isinstance(data, Mapping):
            raise PreferenceError(f"an outcome must map names to numbers, got {data!r}")
        words: dict[str, Any] = {k: _NUMBERS.get(v, v) if isinstance(v, str) else v for k, v in data.items()}
        return cls(words)


def numbers(kpis: Mapping[str, float]) -> dict[str, float]:
    """Return the KPIs of an `Outcome` as plain numbers, in the order of their names.

    Raises:
        PreferenceError: As `Outcome` does.
    """
    if not isinstance(kpis, Mapping):
        raise PreferenceError(f"an outcome must map names to numbers, got {kpis!r}")
    for name, value in kpis.items():
        numeric = isinstance(value, (int, float, np.integer, np.floating))
        if not isinstance(name, str) or not numeric:
            raise PreferenceError(f"a KPI must be a name and a number, got {name!r}: {value!r}")
    values = {name: _float(name, value) for name, value in kpis.items()}
    return dict(sorted((name, value) for name, value in values.items() if not np.isnan(value)))


def _float(name: str, value: Any) -> float:
    try:
        return float(value)
    except OverflowError as error:
        raise PreferenceError(f"KPI {name!r} must be a number, got one too large") from error
