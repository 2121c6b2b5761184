"""A cell of the benchmark, one agent on one problem with one calibrator and seed, and its result."""

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from math import isfinite, isnan
from typing import Any, TypeVar

import msgspec

from prefcal_bench.problems import problem
from prefcal_env.errors import SettingsError
from prefcal_env.wording import whole

from .roster import entry

FORMAT = 2  # format of keys and results; raised when older results must not be reused
T = TypeVar("T")
Theta = tuple[float, ...]


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
