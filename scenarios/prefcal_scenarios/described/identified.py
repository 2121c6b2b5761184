"""A plant that a record of a step test describes: identified once, and kept beside the record."""

import json
import re
import shlex
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.disk import digest_of, write_durably
from prefcal_env.errors import RecordError, ScenarioError
from prefcal_env.experiments.experiment import Channel, End
from prefcal_env.plain import UNREADABLE, from_plain, to_plain
from prefcal_env.plants.explained import Model
from prefcal_env.plants.identify import Identified, identify, interval
from prefcal_env.plants.systems import Ensemble, LinearPlant, LinearSystem, system_of
from prefcal_env.tables.frame import TableColumns
from prefcal_scenarios.names import KEPT_PLANT, TABLES
from prefcal_scenarios.wording import number

# --- Read a record: its input, its output and its time, guessed where that is obvious.

_INPUT = re.compile(
    r"(u|in|input|mv|op|co|valve|pump|heater)([ _-]?(position|opening|power|speed|output|\d+))?",
    re.IGNORECASE,
)
_HELD = 0.2  # share of the rows in which an input that was stepped by hand changes, at most


@dataclass(frozen=True, slots=True, eq=False)
class StepTest:
    """A record of one input and one output."""

    t: Float[np.ndarray, " K"]
    u: Float[np.ndarray, " K"]
    y: Float[np.ndarray, " K"]
    input: Channel
    output: Channel
    time_unit: str
    said: str = ""  # how the time was read, in words


def step_test(path: Path, about: TableColumns | None = None, output: str = "", given: str = "") -> StepTest:
    """Read a step test from any file that `prefcal look` reads.

    Args:
        path: CSV, Parquet or Excel file.
        about: What is known of the columns: names, units and time.
        output: Name of the output; "" if it is the only column of numbers beside input and time.
        given: Name of the input; "" for the one that is called like one, or moves in steps.

    Raises:
        RecordError: If the file is no table, or it is not clear which column is which.
    """
    known = tuple(name for name in (given, output) if name) if given and output else ()
    columns = replace(about or TableColumns(), outputs=known, max_rows=None, kpis=None, end=End.TIME_UP)
    columns = replace(columns, allow=("gaps",))
    try:
        made, said = columns.told(path, [0.0])
        columns_read = {c.name: made.output(k) for k, c in enumerate(made.channels.y)}
        curves = {name: values for name, values in columns_read.items() if values is not None}
        u = _named(given, curves, "input") or _guessed(curves, output)
        others = [name for name in curves if name != u]
        y = _named(output, curves, "output") or (others[0] if len(others) == 1 else "")
        if not y:
            raise RecordError(f"which column is the output? Name it with --output: one of {_list(others)}")
    except RecordError as error:
        raise RecordError(f"{path}: {error}") from error
    units = {c.name: c.unit for c in made.channels.y}
    ends = Channel(u, units[u]), Channel(y, units[y])
    return StepTest(made.t, curves[u], curves[y], *ends, made.channels.time_unit, said)


def _named(name: str, curves: Mapping[str, Any], what: str) -> str:
    if name and name not in curves:
        raise RecordError(f"no column of numbers is called {name!r}: the {what} is one of {_list(curves)}")
    return name


def _guessed(curves: Mapping[str, Float[np.ndarray, " K"]], output: str) -> str:
    """Return the name of the input: the only one that is called like one or moves in steps."""
    there = [name for name in curves if name != output]
    moves = {name: float(np.mean(np.diff(curves[name]) != 0)) for name in there}
    called = [name for name in there if _INPUT.fullmatch(name)]
    held = [name for name, share in moves.items() if 0 < share <= _HELD]
    found = {each[0] for each in (called, held) if len(each) == 1}
    if not found and output and len(there) == 1:
        return there[0]
    if len(found) != 1:
        raise RecordError(f"which column is the input? Name it with --input: one of {_list(there)}")
    return found.pop()


def _list(names: Any) -> str:
    return ", ".join(names) or "none"


# --- Keep what was identified, and make the plant of it.

_FARTHER, _USUAL = 2.0, 0.2
"""How far a reference moves the input at most, as a factor of its move in the record; share of the input's
range that a usual reference needs."""
_NUMBERS = ("gain", "rate", "time constant 1", "lag 1", "1/ω", "dead time")
"""Numbers whose intervals say what a record leaves open."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """What was identified of a record, as it is kept in a file."""

    record: str  # name of the record
    digest: str  # SHA-256 of the record, in hexadecimal digits
    time_unit: str
    input: str
    output: str
    units: tuple[str, str]  # of input and output
    start: tuple[float, float]  # values of input and output at the start, from which models say the changes
    limits: tuple[float, float]  # what the input may reach
    best: int  # number of the typical model of the most probable family
    models: tuple[Model, ...]  # those that are easiest to control first
    noise: float = 0.0  # standard deviation of what the best model leaves of the output
    notes: tuple[str, ...] = ()  # what to know of the record, in sentences
    moved: float = 0.0  # largest move of the input away from its start; 0 if it is not known
    guessed: bool = False  # whether nobody stated the limits, and they are none of a percentage

    @classmethod
    def of(cls, path: Path, test: StepTest, found: Identified, limits: tuple[float, float] | None) -> "Found":
        """Return what was identified of the record at `path`, with limits of its input.

        Raises:
            RecordError: If the record is beyond the limits.
        """
        u, first = float(test.u[0]), int(np.argmax(test.u != test.u[0]))
        return cls(
            record=path.name,
            digest=digest_of(path),
            time_unit=test.time_unit,
            input=test.input.name,
            output=test.output.name,
            units=(test.input.unit, test.output.unit),
            start=(u, float(test.y[: max(first, 1)].mean())),
            limits=_limits(test.input, test.u, limits),
            guessed=limits is None and not _is_percentage(test.input, test.u),
            best=found.best,
            models=found.models,
            noise=found.noise,
            notes=found.notes,
            moved=float(np.abs(test.u - u).max()),
        )

    @classmethod
    def read(cls, path: Path) -> "Found":
        """Return what a file keeps. Raises ScenarioError if it cannot be read."""
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            found = from_plain(content, cls, ScenarioError, "its content")
            if not 0 <= found.best < len(found.models):
                raise ScenarioError(f"best must be a number of a model, got {found.best}")
        except OSError as error:
            raise ScenarioError(f"cannot read the identified plant {str(path)!r}: {error}") from error
        except (ScenarioError, *UNREADABLE) as error:
            # Not identified again at once: limits that were given with it would be lost without a word.
            raise ScenarioError(
                f"cannot read the identified plant {str(path)!r}, which is damaged or of another version: "
                f"{error}. Delete it, or identify its record again: prefcal identify"
            ) from error
        return found

    def write(self, path: Path) -> None:
        """Write the file. Raises OSError."""
        write_durably(path, f"{json.dumps(to_plain(self), ensure_ascii=False)}\n".encode())

    def unit(self, name: str) -> str:
        """Return the unit of a number of the models."""
        u, y = self.units
        gain = f"{y or '1'}/{u}" if u else y
        rate = f"{gain or '1'}/{self.time_unit}"
        return {"damping": "", "gain": gain, "rate": rate}.get(name, self.time_unit)

    @property
    def told(self) -> str:
        """Return what the record leaves open, for people."""
        said = list[str]()
        for name in self.models[self.best].numbers:
            if name in _NUMBERS:
                low, high, _ = interval(self.models, name)
                said.append(f"{name} {' to '.join(ends(low, high))} {self.unit(name)}".rstrip())
        share = float(np.mean([model.integrates for model in self.models]))
        if 0 < share < 1:
            said.append(f"{100 * share:.2g} % of the models integrate")
        return ". ".join([", ".join(said), *(note.rstrip(".") for note in self.notes)])

    def plant(self) -> LinearPlant:
        """Return the plant: the typical model around the start, and what else it may be."""
        order = max(len(model.den) for model in self.models) - 1
        systems = tuple((_padded(model, order), model.delay) for model in self.models)
        u, y = self.start
        names = f"{self.output} by {self.input}"
        about = f"around {y:.4g} {self.units[1]}".rstrip() + f" at {u:.4g} {self.units[0]}".rstrip()
        plant = LinearPlant(
            (systems[0][0].A, systems[0][0].B, systems[0][0].C, systems[0][0].D),
            inputs=[Channel(self.input, self.units[0], *self.limits)],
            outputs=[Channel(self.output, self.units[1], target=self._reference)],
            rest=self.start,
            name=f"{names} ({about})",
            time_unit=self.time_unit,
        )
        more = self.noise, self.guessed, self.moved
        return plant.among(Ensemble(systems, self.best, self.record, self.told, *more))

    @property
    def _reference(self) -> float | None:
        """Return a reference near what the record has shown; None if a usual one is, too."""
        best, most = self.models[self.best], _FARTHER * self.moved
        if best.integrates or not 0 < most < _USUAL * (self.limits[1] - self.limits[0]):
            return None
        return float(f"{self.start[1] + best.gain * most:.6g}")


def ends(low: float, high: float) -> tuple[str, str]:
    """Return the ends of an interval for people: with three digits, or four if they would read alike."""
    for digits in (3, 4):
        texts = number(float(f"{low:.{digits}g}")), number(float(f"{high:.{digits}g}"))
        if texts[0] != texts[1]:
            break
    return texts


def _is_percentage(c: Channel, u: Float[np.ndarray, " K"]) -> bool:
    return bool(c.unit == "%" and u.min() >= 0 and u.max() <= 100)


def _limits(
    c: Channel, u: Float[np.ndarray, " K"], limits: tuple[float, float] | None
) -> tuple[float, float]:
    """Return what an input may reach.

    Unless that is given, it is 0 and 100 if it is in %, or else twice as far away as the record moves it.
    """
    start, moved = float(u[0]), float(np.abs(u - u[0]).max())
    if limits is None and not _is_percentage(c, u):
        return start - 2 * moved, start + 2 * moved
    low, high = limits or (0.0, 100.0)
    if u.min() < low or u.max() > high:
        raise RecordError(
            f"{c.name} is {u.min():g} to {u.max():g} {c.unit}".rstrip()
            + f", beyond its limits {low:g} to {high:g}"
        )
    return low, high


def _padded(model: Model, order: int) -> LinearSystem:
    """Return a model with `order` states: those that it lacks decay, and nothing drives or shows them."""
    made = system_of((list(model.num), list(model.den)))
    missing, rate = order - len(made.A), -1 / max([*model.lags, model.delay, 1e-9])
    A = np.zeros((order, order))
    A[: len(made.A), : len(made.A)] = made.A
    A[len(made.A) :, len(made.A) :] = rate * np.eye(missing)
    B, C = np.pad(made.B, ((0, missing), (0, 0))), np.pad(made.C, ((0, 0), (0, missing)))
    return LinearSystem(A, B, C, made.D)


def is_record(source: str) -> bool:
    """Return whether a plant is named by its record, or by what was identified of one."""
    return source.lower().endswith((KEPT_PLANT, *TABLES))


def plant_of_record(source: str) -> LinearPlant:
    """Return the plant of a record, or of the file that keeps what was identified.

    A record is identified once: what is found is kept beside it, and holds as long as it stays the same.

    Raises:
        RecordError: If the record does not tell enough, or is not clear.
        ScenarioError: If the file cannot be read.
    """
    path = Path(source)
    if source.lower().endswith(KEPT_PLANT):
        return Found.read(path).plant()
    kept = path.with_suffix(KEPT_PLANT)
    if path.is_file() and kept.is_file():
        found = Found.read(kept)
        if found.digest == digest_of(path):
            return found.plant()
    found, _ = identified(path)
    with suppress(OSError):  # a folder to read only: it is identified again next time
        found.write(kept)
    return found.plant()


def _unasked(path: Path) -> StepTest:
    """Read a step test of which nothing is said, or say where something can be said."""
    try:
        return step_test(path)
    except RecordError as error:
        if " --" not in str(error):
            raise
        command = shlex.join(["prefcal", "identify", str(path)])
        raise RecordError(
            f"{error}. Such options are those of `{command}`, which keeps the plant that it finds for --plant"
        ) from error


def identified(
    path: Path,
    test: StepTest | None = None,
    *,
    resolution: float = 0.0,
    limits: tuple[float, float] | None = None,
) -> tuple[Found, Identified]:
    """Return what a record tells: as it is kept in a file, and as it was found."""
    test = test or _unasked(path)
    try:
        made = identify(test.t, test.u, test.y, resolution=resolution)
    except RecordError as error:
        raise RecordError(f"{path}: {error}") from error
    return Found.of(path, test, made, limits), made
