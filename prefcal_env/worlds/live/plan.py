"""A live plant, before anything runs: its connection, its nodes, its journal on the disk, and the plan."""

import json
import sqlite3
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, field
from hashlib import sha256
from math import inf, isfinite
from pathlib import Path
from typing import Any, Literal, Protocol, get_args, runtime_checkable

from platformdirs import user_data_path

from prefcal_env.disk import synchronize, write_durably
from prefcal_env.errors import LiveError, SettingsError
from prefcal_env.experiments.experiment import Channel, Channels, Experiment
from prefcal_env.experiments.kpis import tracking_kpis
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.sources.source import Change
from prefcal_env.units import Values, convert, same


class LivePlant(Protocol):
    """Connection to a live plant whose values have a node address each.

    No method blocks for longer than a few seconds: a plant that does not answer is lost.
    """

    @property
    def address(self) -> str:
        """Address of the plant, which tells it apart from other plants."""

    @property
    def connected(self) -> bool:
        """Whether the connection stands, as far as is known."""

    def connect(self) -> None:
        """Connect, or connect again after a loss.

        Raises:
            ConnectionLostError: If the plant cannot be reached.
        """

    def read(self, nodes: Sequence[str]) -> list[float]:
        """Return the value of each node, in order; NaN for a value of bad quality.

        Raises:
            ConnectionLostError: If the connection is lost.
            LiveError: If there is no such node.
        """

    def write(self, node: str, value: float) -> None:
        """Write one value, and return once the plant has accepted it.

        Raises:
            ConnectionLostError: If the connection is lost; the value may have arrived.
            LiveError: If the plant refuses the value.
        """

    def close(self) -> None:
        """Disconnect."""


@runtime_checkable
class TypedPlant(Protocol):
    """What a connection may offer, too, if nodes have types: a check before the first write."""

    def whole(self, nodes: Sequence[str]) -> list[bool]:
        """Return for each node, in order, whether its type holds whole numbers only.

        Raises:
            ConnectionLostError: If the connection is lost.
            LiveError: If there is no such node.
        """


# --- Describe the nodes of a live plant: knobs and start values that are written, and records.

Role = Literal["output", "input", "reference"]


@dataclass(frozen=True, slots=True)
class LiveKnob:
    """A knob on a live plant: a node that prefcal may write to.

    Args:
        knob: Knob, whose range limits what is written.
        node: Address of the node, for example "ns=2;s=PI.Kp".
        rate: Largest rate of change, in the knob's unit per second.

    Raises:
        SettingsError: If the node is empty, or the rate is not above 0 and finite.
    """

    knob: Knob
    node: str
    rate: float

    def __post_init__(self) -> None:
        _check_node(self.knob.name, self.node)
        if not (isfinite(self.rate) and self.rate > 0):
            raise SettingsError(
                f"{self.knob.name!r}: rate must be above 0 {self.knob.unit or '1'} per second and finite, "
                f"got {self.rate}"
            )

    def changed(self, old: float, new: float) -> Change:
        """Return what writing `new` in place of `old` changes, in the knob's unit."""
        return Change(self.knob, new, old, self.rate)

    def same(self, one: float, other: float) -> bool:
        """Return whether two values are equal up to single precision."""
        size = max(abs(one), abs(other))
        return abs(one - other) <= 1e-5 * size + 1e-9 * (self.knob.high - self.knob.low)

    def step(self, elapsed: float, period: float) -> float:
        """Return the largest change now, in the knob's unit.

        Args:
            elapsed: Time since the last change, in seconds.
            period: Sampling period in seconds. A pause does not allow a larger jump than one
                period does, except that an integer may always move by 1 once its rate allows it.
        """
        one = 1.0 if self.knob.integer else 0.0
        allowed = min(self.rate * max(elapsed, 0.0), max(self.rate * period, one))
        # Rounding must not cost a whole number.
        return float(int(allowed + 1e-9)) if self.knob.integer else allowed


@dataclass(frozen=True, slots=True)
class LiveStart(LiveKnob):
    """A knob that is not tuned: it is written to start a run, and taken back at its end.

    Its name, for example "set-point", differs from the knobs' names; an integer may be a switch.

    Args:
        value: Value that starts the run, in the knob's unit.

    Raises:
        SettingsError: If the value is outside the knob's range, or as for a `LiveKnob`.
    """

    value: float = field(kw_only=True)

    def __post_init__(self) -> None:
        LiveKnob.__post_init__(self)  # slots make a new class, which super() does not know
        knob = self.knob
        if not knob.low <= self.value <= knob.high:
            raise SettingsError(
                f"start value {knob.name!r} must be in [{knob.low}, {knob.high}] {knob.unit}, "
                f"got {self.value}"
            )
        if knob.integer and self.value != round(self.value):
            raise SettingsError(f"start value {knob.name!r} must be an integer, got {self.value}")


@dataclass(frozen=True, slots=True, kw_only=True, init=False)
class Tag(Channel):
    """A channel that is recorded: where it is on the plant, and its role.

    Args:
        name: Name, as shown to people; a reference has the name of its output.
        node: Address of the node.
        role: "output", "input" or "reference".
        unit: Unit of the values; a reference is converted to the unit of its output.
        low: Lower limit that is drawn and counts in KPIs, in `unit`.
        high: Upper limit that is drawn and counts in KPIs, in `unit`.
        abort: Limits (low, high) in `unit`; a value outside stops the run as unsafe.
        look: Target, band and symbol of the `Channel`; they are not drawn of a live plant.

    Raises:
        SettingsError: If the node is empty, the role is unknown, or limits do not increase.
    """

    node: str
    role: Role
    abort: tuple[float, float]

    def __init__(
        self,
        name: str,
        node: str,
        role: Role = "output",
        unit: str = "",
        low: float = -inf,
        high: float = inf,
        abort: tuple[float, float] = (-inf, inf),
        **look: Any,
    ) -> None:
        _check_node(name, node)
        if role not in get_args(Role):
            raise SettingsError(f"role of {name!r} must be one of {', '.join(get_args(Role))}, got {role!r}")
        for what, between in (("limits", (low, high)), ("abort", abort)):
            if not between[0] < between[1]:
                raise SettingsError(
                    f"{what} of {name!r} must be low < high, got [{between[0]}, {between[1]}] {unit}".rstrip()
                )
        Channel.__init__(self, name, unit, low, high, **look)
        object.__setattr__(self, "node", node)
        object.__setattr__(self, "role", role)
        object.__setattr__(self, "abort", abort)

    @property
    def key(self) -> str:
        """What tells it apart: role and name."""
        return f"{self.role} {self.name}"

    @property
    def supervised(self) -> bool:
        """Whether it has an abort limit."""
        return self.abort != (-inf, inf)


def _check_node(name: str, node: object) -> None:
    if not (isinstance(node, str) and node.strip()):
        raise SettingsError(f"{name!r} needs the address of its node, got {node!r}")


def within(value: float, limits: tuple[float, float]) -> bool:
    """Return whether `value` is inside `limits`, inclusive; NaN is not."""
    return limits[0] <= value <= limits[1]


def all_within(values: Mapping[str, float], limits: Mapping[str, tuple[float, float]]) -> bool:
    """Return whether every named value is inside its limits."""
    return all(within(values[name], between) for name, between in limits.items())


@dataclass(frozen=True, slots=True)
class Journal:
    """File that holds the old values of a plant from before the first write until they are back.

    If prefcal is killed, the next start finds the file and restores the values.

    Args:
        path: Path of the file; its folder is created.
    """

    path: Path

    @classmethod
    def of(cls, address: str) -> "Journal":
        """Return the journal of the plant at `address`, in the user's data folder."""
        name = sha256(address.encode()).hexdigest()[:16]
        return cls(user_data_path("prefcal", appauthor=False) / "live" / f"{name}.json")

    def save(self, old: Mapping[str, float], trial: str = "") -> None:
        """Write the old values by name; they are on the disk when this returns.

        Args:
            old: Values to restore.
            trial: Mark of the trial that changes them; empty for a run.

        Raises:
            LiveError: If the file cannot be written; then nothing may be changed on the plant.
        """
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            content = {"old": dict(old), **({"trial": trial} if trial else {})}
            write_durably(self.path, json.dumps(content).encode())
        except OSError as error:
            raise LiveError(
                f"cannot save the plant's values in {self.path}: {error.strerror or error}. "
                "Nothing was written to the plant"
            ) from error

    def load(self) -> dict[str, float] | None:
        """Return the values to restore, by name; None if there are none.

        Raises:
            LiveError: If the file is damaged.
        """
        return self._read()[0]

    def settle(self, trial: str) -> None:
        """Remove the file if a trial of this mark left it.

        Raises:
            LiveError: If the file is damaged, or cannot be removed.
        """
        if self._read()[1] == trial:
            try:
                self.clear()
            except OSError as error:
                raise LiveError(
                    "the values on the plant were confirmed, but those from before are still in "
                    f"{self.path}: {error.strerror or error}"
                ) from error

    def _read(self) -> tuple[dict[str, float] | None, str | None]:
        try:
            content = json.loads(self.path.read_text(encoding="utf-8"))
            old = {str(name): float(value) for name, value in content["old"].items()}
            if not all(map(isfinite, old.values())):
                raise ValueError("not all of them are numbers")
        except FileNotFoundError:
            return None, None
        except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
            raise LiveError(
                f"cannot read the plant's old values in {self.path}: restore them by hand, then "
                f"remove the file ({error})"
            ) from error
        return old, content.get("trial")

    def clear(self) -> None:
        """Remove the file, since the plant has its values again."""
        self.path.unlink(missing_ok=True)
        synchronize(self.path.parent)

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Keep other prefcal processes away from the plant inside the block.

        Raises:
            LiveError: If another process uses the plant.
        """
        lock = self.path.with_suffix(".lock")
        with ExitStack() as held:
            try:
                lock.parent.mkdir(parents=True, exist_ok=True)
                # SQLite locks a file on every system, and the lock ends with its process.
                connection = sqlite3.connect(lock, timeout=0.0, isolation_level=None)
                held.enter_context(closing(connection))
                connection.execute("BEGIN EXCLUSIVE")
            except (OSError, sqlite3.Error) as error:
                raise LiveError(
                    f"another prefcal runs on this plant, or {lock} cannot be written: end the "
                    f"other run first ({error})"
                ) from error
            yield


Limits = Mapping[str, tuple[float, float]]


@dataclass(frozen=True)
class LivePlan:
    """What a `LiveRig` is made of, which says what each argument means.

    Raises:
        SettingsError: If names or nodes repeat, there is no output, or a number is not valid.
    """

    plant: LivePlant
    knobs: tuple[LiveKnob, ...]
    tags: tuple[Tag, ...]
    duration: float = field()
    period: float = 1.0
    start: tuple[LiveStart, ...] = ()
    ready: Limits = field(default_factory=dict)
    ready_within: float = 600.0
    done: Limits = field(default_factory=dict)
    hold: float = 0.0
    blind: float = 5.0
    after: Literal["restore", "keep"] = "restore"
    journal: Journal | None = None
    instructions: str = ""
    kpis: Callable[[Experiment], Mapping[str, float]] = tracking_kpis

    channels: Channels = field(init=False, repr=False, compare=False)
    """Channels of its experiments; those in `y` are the outputs with a recorded reference."""

    def __post_init__(self) -> None:
        for name in ("knobs", "tags", "start"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        if not self.knobs or not any(tag.role == "output" for tag in self.tags):
            raise SettingsError("a live rig needs a knob to write and an output to record")
        self._check_names()
        for name, least in (("period", 0.0), ("duration", self.period), ("ready_within", 0.0)):
            value = getattr(self, name)
            if not (isfinite(value) and value > least):
                raise SettingsError(f"{name} must be above {least:g} s, got {value}")
        for name in ("hold", "blind"):
            value = getattr(self, name)
            if not (isfinite(value) and value >= 0):
                raise SettingsError(f"{name} must be 0 s or more, got {value}")
        if self.after not in ("restore", "keep"):
            raise SettingsError(f"after must be restore or keep, got {self.after!r}")
        self.keyed(self.ready), self.keyed(self.done)
        groups = {
            role: tuple(Channel(t.name, t.unit, t.low, t.high) for t in self.tags if t.role == role)
            for role in ("output", "input")
        }
        aimed = {tag.name for tag in self.tags if tag.role == "reference"}
        y = tuple(channel for channel in groups["output"] if channel.name in aimed)
        object.__setattr__(self, "channels", Channels((), groups["input"], y))
        kept = "the old values are restored" if self.after == "restore" else "the new θ stays"
        object.__setattr__(self, "afterward", kept)

    def _check_names(self) -> None:
        written = (*self.knobs, *self.start)
        references = [tag.name for tag in self.tags if tag.role == "reference"]
        for what, found in (
            ("name of a knob or start value", [w.knob.name for w in written]),
            ("node that is written to", [w.node for w in written]),
            ("output or input", [tag.name for tag in self.tags if tag.role != "reference"]),
            ("reference", references),
        ):
            twice = sorted({each for each in found if found.count(each) > 1})
            if twice:
                raise SettingsError(f"each {what} may be given once, got {twice[0]!r} twice")
        outputs = {tag.name for tag in self.tags if tag.role == "output"}
        for name in references:
            if name not in outputs:
                raise SettingsError(
                    f"a reference must have the name of an output, {sorted(outputs)}, got {name!r}"
                )
        for tag in self.tags:
            self.as_output(tag, 0.0)
            for each in written:
                units = tag.unit, each.knob.unit
                if tag.node == each.node and all(units) and not same(*units):
                    raise SettingsError(
                        f"{each.knob.name!r} is in {units[1]}, but its node {tag.node!r} is read as "
                        f"{tag.name!r} in {units[0]}: give both the unit that it has on the plant"
                    )

    def as_output(self, tag: Tag, values: Values) -> Values:
        """Return values of a tag; those of a reference in the unit of its output.

        Raises:
            SettingsError: If they cannot be converted.
        """
        output = next((t for t in self.tags if t.name == tag.name and t.role == "output"), tag)
        written = (each.knob.unit for each in (*self.knobs, *self.start) if each.node == tag.node)
        unit = tag.unit or next(written, "")
        if tag.role != "reference" or not unit or not output.unit:
            return values
        return convert(values, unit, output.unit, f"the reference of {tag.name!r}", SettingsError)

    @property
    def space(self) -> KnobSpace:
        """Space of the knobs."""
        return KnobSpace([live.knob for live in self.knobs])

    def keyed(self, limits: Limits) -> dict[str, tuple[float, float]]:
        """Return conditions by the key of their tag."""
        found = {tag.name: tag.key for tag in self.tags if tag.role != "reference"}
        for name, (low, high) in limits.items():
            if name not in found or not low < high:
                raise SettingsError(
                    f"a condition must give low < high of one of {sorted(found)}, got {name!r}: {low}, {high}"
                )
        return {found[name]: (float(low), float(high)) for name, (low, high) in limits.items()}
