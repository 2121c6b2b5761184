"""A cell of the benchmark: one agent, one problem, one calibrator, and one seed."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any, TypeVar

import msgspec

from prefcal_bench.problems import problem
from prefcal_env.errors import SettingsError

from .roster import entry

FORMAT = 2
"""Format of keys and results; raised when older results must not be reused."""
T = TypeVar("T")


@dataclass(frozen=True, slots=True, order=True)
class Cell:
    """Everything that determines a result.

    Args:
        agent: Name of the agent in the roster, or path/to/own.py:Agent.
        problem: Name of the problem.
        calibrator: Name of one of the problem's calibrators.
        seed: Seed of the agent and of the calibrator, 0 or more.
        n_init: Number of experiments before the agent learns.
        n_max: Number of experiments.

    Raises:
        SettingsError: If a value is invalid.
    """

    agent: str
    problem: str
    calibrator: str
    seed: int
    n_init: int = 10
    n_max: int = 50

    def __post_init__(self) -> None:
        for name in ("agent", "problem", "calibrator"):
            value = getattr(self, name)
            if not isinstance(value, str) or not value:
                raise SettingsError(f"{name} of a cell must be a name, got {value!r}")
        for name, low in (("seed", 0), ("n_init", 1), ("n_max", 2)):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or value < low:
                raise SettingsError(f"{name} must be an integer, {low} or more, got {value!r}")
        if self.n_max < self.n_init:
            raise SettingsError(f"n_max must not be below n_init, got {self.n_max} below {self.n_init}")

    @property
    def key(self) -> str:
        """Return the sha256 in hex of the cell and of the versions of its agent and problem.

        A new version of either changes the key, so that its results are computed again.

        Raises:
            SettingsError: If there is no such agent or problem.
        """
        content = self.to_dict() | {
            "format": FORMAT,
            "agent version": entry(self.agent).version,
            "problem version": problem(self.problem).version,
        }
        return hashlib.sha256(canonical(content).encode()).hexdigest()

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> "Cell":
        """Return the cell for the data that `to_dict` returned.

        Raises:
            SettingsError: If anything is missing, malformed or unknown.
        """
        return read_as(cls, data)

    def __str__(self) -> str:
        return f"{self.agent} on {self.problem}, {self.calibrator}, seed {self.seed}"


def canonical(content: Any) -> str:
    """Return the canonical JSON of `content`: sorted keys, no spaces, floats by their repr."""
    return json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)


def read_as(kind: type[T], data: Any) -> T:
    """Return a dataclass for plain data from JSON, in which "inf" is a number.

    Raises:
        SettingsError: If anything is missing, malformed or unknown.
    """
    what = f"a {kind.__name__.lower()}"
    names = {f.name for f in fields(kind)}  # type: ignore[arg-type]
    if not isinstance(data, Mapping) or set(data) != names:
        raise SettingsError(f"{what} must have {sorted(names)}, got {data!r}")
    try:
        return msgspec.convert(data, kind, strict=False)
    except msgspec.ValidationError as error:
        raise SettingsError(f"{what} cannot be read: {error}") from error
