"""A live plant that prefcal drives itself, after a person confirmed what is written, and its description."""

import os
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np
from jaxtyping import Float

from prefcal_env.errors import ConnectionLostError, LiveError, RunError, SettingsError
from prefcal_env.experiments.experiment import End, Experiment
from prefcal_env.knobs import Knob
from prefcal_env.plain import checked, entries
from prefcal_env.sources.source import (
    Change,
    KPIsOf,
    PlantTrial,
    Progress,
    Run,
    RunCurve,
    Source,
    Stage,
    Table,
    formula_problems,
    with_own,
)

from .drive import Confirm, Drive, Driven, Hands, Tell
from .opcua import OPCUAPlant
from .plan import Journal, LiveKnob, LivePlan, LivePlant, LiveStart, Role, Tag


@dataclass(frozen=True)
class LiveRig(LivePlan, Source):
    """The `run` of a scenario whose experiments prefcal does on a live plant.

    A run writes θ at limited rates and reads it back, waits for the start condition, writes the
    start values, records, and restores the old values: after a completed run, when it is stopped or
    crosses an abort limit, and after a lost connection as soon as it is regained. The old values
    are on the disk before the first write, so that a later start restores them after a crash.

    Args:
        plant: Connection to the plant.
        knobs: Knobs, in the order of θ.
        tags: Nodes that are recorded; at least one output.
        duration: Longest recorded time, in seconds.
        period: Sampling period in seconds.
        start: Values that start a run, for example a set-point; they are always taken back.
        ready: Maps outputs or inputs to limits in which they must be before the start.
        ready_within: Longest wait for that, in seconds.
        done: Maps outputs or inputs to limits in which the run ends early; by default, it never
            does.
        hold: Time, in seconds, for which the conditions must hold.
        blind: Longest time, in seconds, for which a value with an abort limit may have bad quality.
        after: "restore" to take θ back after a completed run, "keep" to leave it on the plant.
        journal: File for the old values; by default, one per plant in the user's data folder.
        instructions: What a person must check before they confirm.
        kpis: Function that returns the KPIs of an experiment by name.

    Raises:
        SettingsError: If names or nodes repeat, there is no output, or a number is not valid.
    """

    asks = "confirm"
    stops = recovers = tries = True

    def begin(self, theta: Float[np.ndarray, " n"], seed: int = 0) -> Run:
        """Return a run of θ, physical, shape (n,), that asks for a confirmation before it writes."""
        return LiveRun(self, theta)

    def recovery(self) -> Run:
        """Return the run that restores what an interrupted one left."""
        return RestoringRun(self)

    def trial(self, trial: PlantTrial) -> Run:
        """Return the run of a trial, which asks for a confirmation before it writes."""
        return TrialRun(self, trial)

    def settle(self, mark: str) -> None:
        """Forget the values from before a trial that was confirmed.

        Raises:
            LiveError: If their file is damaged, or cannot be removed, or another process runs on the plant.
        """
        with self._kept.alone():
            self._kept.settle(mark)

    def close(self) -> None:
        """Close the connection to the plant."""
        self.plant.close()

    def look(
        self,
        theta: Float[np.ndarray, " n"],
        *,
        starts: bool = True,
        clock: Callable[[], float] = time.monotonic,
    ) -> tuple[Change, ...]:
        """Return what a run of θ, physical, shape (n,), would write; nothing is written.

        Without `starts`, that is what a trial writes: the knobs only.

        Raises:
            KnobError: If θ is outside the knobs' ranges.
            LiveError: If the plant cannot be reached, or has a value outside the limits.
        """
        return self._drive(theta, Hands(clock, lambda seconds: None), starts=starts).look()

    def drive(
        self,
        theta: Float[np.ndarray, " n"],
        confirm: Confirm,
        *,
        stop: Callable[[], bool] = lambda: False,
        closing: Callable[[], bool] = lambda: False,
        tell: Tell = lambda progress: None,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> Driven:
        """Run θ on the plant and return what was recorded.

        Args:
            theta: Physical θ, shape (n,).
            confirm: Function that shows a person the changes and returns whether they confirm
                them. Without their consent, nothing is written.
            stop: Function that returns whether to stop the run and restore the old values.
            closing: Function that returns whether the process has been told to end. Then a lost
                plant is waited for only briefly; its old values are restored at the next start.
            tell: Function that is called after every sample.
            clock: Function that returns the time in seconds.
            sleep: Function that waits for a number of seconds.

        Raises:
            KnobError: If θ is outside the knobs' ranges.
            LiveError: If another process runs on the plant, or an earlier run's values cannot be
                restored. What happens during the run is data: see `Driven.why`.
        """
        hands = Hands(clock, sleep, confirm, stop, closing, tell)
        drive = self._drive(theta, hands)
        with self._kept.alone():
            self._recover(drive)
            return drive.run()

    def try_out(self, trial: PlantTrial, hands: Hands) -> tuple[str, bool]:
        """Have the θ that a trial wants on the plant, until one is confirmed or the trial ends.

        No start value is written. Once the plant has shown the same values for an hour, or ten times the
        duration of a run if that is longer, the trial ends.

        Returns:
            Why nothing was confirmed, so that the values from before had to be restored, or what the plant
            has in place of what was; empty if all is well. And whether nothing is left to be restored.

        Raises:
            KnobError: If θ is outside the knobs' ranges.
            LiveError: As `drive`, and if the values from before cannot be forgotten.
        """
        first = next(iter(trial.sides.values()))
        with self._kept.alone():
            self._recover(self._drive(first, hands))
            return self._drive(first, hands, starts=False).try_out(trial, max(3600.0, 10 * self.duration))

    def measured(self, kpis_of: KPIsOf) -> "LiveRig":
        """Return the same rig, whose experiments have more KPIs than their own."""
        return replace(self, kpis=with_own(self.kpis, kpis_of(self.channels)))

    def problems(self, kpis: Iterable[Any]) -> Iterator[str]:
        """Yield which formulas of KPIs name what is not recorded, before a run is spent on it."""
        outputs = tuple(tag for tag in self.tags if tag.role == "output")
        yield from formula_problems(kpis, replace(self.channels, x=outputs), ())

    @property
    def left(self) -> dict[str, float] | None:
        """Old values, by name, that an interrupted run left to be restored; None if none are.

        Raises:
            LiveError: If their file is damaged.
        """
        return self._kept.load()

    def recover(
        self,
        *,
        closing: Callable[[], bool] = lambda: False,
        tell: Tell = lambda progress: None,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> bool:
        """Restore what an interrupted run left; return whether there was anything.

        Raises:
            LiveError: If another process runs on the plant, or it refuses its old values.
        """
        middle = self.space.decode(np.full(len(self.knobs), 0.5))
        hands = Hands(clock, sleep, closing=closing, tell=tell)
        with self._kept.alone():
            return self._recover(self._drive(middle, hands))

    def _recover(self, drive: Drive) -> bool:
        old = self._kept.load()
        if old is None:
            return False
        strangers = sorted(set(old) - set(drive.written))
        if strangers:
            values = ", ".join(f"{name} = {old[name]:g}" for name in strangers)
            raise LiveError(
                f"an interrupted run changed {values}, which this rig does not write: restore it "
                f"by hand, then remove {self._kept.path}"
            )
        if not drive.restore(old):
            raise LiveError(f"the values from before an interrupted run are not restored: {drive.problem}")
        return True

    @property
    def _kept(self) -> Journal:
        return self.journal or Journal.of(self.plant.address)

    def _drive(self, theta: Float[np.ndarray, " n"], hands: Hands, *, starts: bool = True) -> Drive:
        values = dict(zip(self.space.names, self.space.check(theta).tolist(), strict=True))
        return Drive(self, values, self._kept, hands, starts=starts)


class _Followed(Run):
    """A run that can be followed while another thread drives the plant."""

    def __init__(self, rig: LiveRig) -> None:
        self._rig = rig
        self._stop, self._closing = threading.Event(), threading.Event()
        self._lock = threading.Lock()
        self._rows: list[Progress] = []

    @property
    def recorded(self) -> tuple[tuple[float, ...], tuple[RunCurve, ...]]:
        with self._lock:
            rows = self._rows[:: max(1, -(-len(self._rows) // 400))]  # so many are drawn at most
        tags = self._rig.tags
        references = {tag.name: tag for tag in tags if tag.role == "reference"}
        curves = tuple(
            RunCurve(
                tag,
                tuple(row.values[tag.key] for row in rows),
                tuple(
                    self._rig.as_output(aim, row.values[aim.key])
                    for row in rows
                    if (aim := references.get(tag.name)) is not None
                ),
            )
            for tag in tags
            if tag.role == "output"
        )
        return tuple(row.elapsed for row in rows), curves

    def stop(self, why: str, within: float = 0.0) -> None:
        """Stop: the old values are restored, if the process ends, at the next start."""
        self.stopping = self.stopping or why == "stopped"
        (self._stop if why == "stopped" else self._closing).set()

    def _tell(self, progress: Progress) -> None:
        self.progress = progress
        with self._lock:
            if progress.stage is Stage.RECORDING:
                self._rows.append(progress)
            elif progress.stage is Stage.WRITING:  # what comes is of another θ
                self._rows.clear()
        self.changed()

    def _look(self, theta: Float[np.ndarray, " n"], *, starts: bool = True) -> None:
        try:
            self.changes = self._rig.look(theta, starts=starts) or None
        except ConnectionLostError as error:
            self.problem = f"the server is not reachable: {error}"
        except LiveError as error:
            self.problem = str(error)
        self.waits = True


class LiveRun(_Followed):
    """A run of θ: it looks at the plant, waits until a person confirms the changes, and drives."""

    def __init__(self, rig: LiveRig, theta: Float[np.ndarray, " n"]) -> None:
        super().__init__(rig)
        self._theta = theta
        self._agreed: tuple[Change, ...] | None = None

    def supply(self, given: Table | tuple[Change, ...]) -> None:
        """Let the run start with the changes that a person confirmed."""
        if not given or not isinstance(given, tuple):
            raise LiveError(self.problem or "nothing was confirmed")
        self._agreed, self.problem = given, ""
        self.waits, self.moves_plant = False, True
        self.progress = Progress(Stage.CONNECTING, 0.0, 0.0)

    def advance(self) -> Experiment | None:
        """Look at the plant or, once the changes are confirmed, run θ and return what it recorded.

        Raises:
            RunError: If the run failed; `partial` holds what was recorded until then.
            LiveError: If another process runs on the plant, or it lacks its old values.
        """
        if self._agreed is None:
            self._look(self._theta)
            return None
        agreed = self._agreed
        try:
            driven = self._rig.drive(
                self._theta,
                lambda changes: changes == agreed,
                stop=self._stop.is_set,
                closing=self._closing.is_set,
                tell=self._tell,
            )
        finally:
            self.progress = None
        made = driven.experiment
        self.partial = made if len(made.t) else None
        if not (driven.restored or driven.kept):
            self.problem = (
                f"the plant does not have its old values yet: {driven.problem}. They are restored first"
            )
        if not driven.why or made.end is not End.FAILED:
            return made
        restored = "The old values are restored" if driven.restored else self.problem
        raise RunError(f"{driven.why}. {restored}.", "stopped" if driven.stopped else "raised")


class TrialRun(_Followed):
    """A trial: it looks at the plant, waits until a person confirms, and has what they want on it."""

    def __init__(self, rig: LiveRig, trial: PlantTrial) -> None:
        super().__init__(rig)
        self._trial = trial
        for theta in trial.sides.values():
            rig.space.check(theta)

    def supply(self, given: Table | tuple[Change, ...]) -> None:
        """Let the trial begin, from the values that a person has seen."""
        if not given or not isinstance(given, tuple):
            raise LiveError(self.problem or "nothing was confirmed")
        self.waits, self.moves_plant = False, True
        self.progress = Progress(Stage.CONNECTING, 0.0, 0.0)

    def advance(self) -> None:
        """Look at the plant or, once a person has confirmed, have the θ that they want on it.

        Afterward, `problem` says why nothing was confirmed, or what the plant has in place of what was.

        Raises:
            LiveError: If another process runs on the plant, or it lacks its old values.
        """
        if not self.moves_plant:
            self._look(next(iter(self._trial.sides.values())), starts=False)
            return
        try:
            why, done = self._rig.try_out(self._trial, self._hands())
        finally:
            self.progress = None
        if not done:
            raise LiveError(f"{why}. The plant does not have its old values yet")
        before = "" if self._trial.confirmed() else ". The plant has the values from before"
        self.problem = f"{why}{before}" if why else ""

    def _hands(self) -> Hands:
        def stop() -> bool:
            return self._stop.is_set() or self._trial.confirmed()

        confirm, closing = self._confirm_unchanged, self._closing.is_set
        return Hands(time.monotonic, time.sleep, confirm, stop, closing, self._tell)

    def _confirm_unchanged(self, changes: tuple[Change, ...]) -> bool:
        if changes != self.changes:
            raise LiveError("the plant's values changed before they were confirmed: look again")
        return True


class RestoringRun(_Followed):
    """Restores what an interrupted run left on the plant; it has no experiment."""

    def advance(self) -> None:
        """Restore the old values.

        Raises:
            LiveError: If another process runs on the plant, or it refuses its old values.
        """
        try:
            self._rig.recover(closing=self._closing.is_set, tell=self._tell)
        finally:
            self.progress = None


# --- Make a live rig from plain data, such as the table [opcua] of a TOML file.

Range = tuple[float, float]
Entries = dict[str, dict[str, Any]]


class LiveTable(msgspec.Struct, frozen=True, kw_only=True):
    """Keys of a live rig as plain data; those left out have the defaults of what they are for."""

    url: str
    duration: float
    knobs: Entries
    outputs: Entries
    inputs: Entries = {}
    references: Entries = {}
    start: Entries = {}
    ready: dict[str, Range] = {}
    done: dict[str, Range] = {}
    period: float | None = None
    ready_within: float | None = None
    hold: float | None = None
    blind: float | None = None
    after: Literal["restore", "keep"] | None = None
    journal: str | None = None
    instructions: str | None = None
    user: str | None = None
    password_variable: str | None = None
    security: str | None = None
    timeout: float | None = None


def live_rig(description: Mapping[str, Any], *, plant: Callable[[str], LivePlant] | None = None) -> LiveRig:
    """Return the live rig that plain data describes.

    Args:
        description: "url", "duration" and the tables "knobs" (node, low, high, rate) and "outputs"
            (node) are required. Tables "inputs", "references" and "start", the conditions "ready"
            and "done", and the other arguments of `LiveRig` are optional.
        plant: Function that connects to an address; by default, over OPC UA.

    Raises:
        SettingsError: If a name is unknown, missing or of the wrong type; the message says where.
        KnobError: If a knob, or the range of a start value, is not valid.
        LiveError: If the address is none of OPC UA.
        MissingExtraError: If asyncua is not installed.
    """
    given = entries(description, (LiveTable,), "", SettingsError)
    as_they_are = {field.name for field in fields(LiveRig)} - {"knobs", "start", "journal"}
    roles: tuple[tuple[Role, Entries], ...] = (
        ("output", given["outputs"]),
        ("input", given.get("inputs", {})),
        ("reference", given.get("references", {})),
    )
    return LiveRig(
        plant=_connection(given) if plant is None else plant(given["url"]),
        knobs=tuple(_knob(name, entry, f"knobs.{name}") for name, entry in given["knobs"].items()),
        tags=tuple(
            checked(entry, Tag, f"{role}s.{name}", SettingsError, name=name, role=role)
            for role, tags in roles
            for name, entry in tags.items()
        ),
        start=tuple(_start(name, entry, f"start.{name}") for name, entry in given.get("start", {}).items()),
        journal=_journal(given["journal"]) if "journal" in given else None,
        **{name: value for name, value in given.items() if name in as_they_are},
    )


def _knob(name: str, entry: dict[str, Any], where: str) -> LiveKnob:
    plain = entry | {"scale": "log10"} if entry.get("scale") == "log" else entry
    found = entries(plain, (LiveKnob, Knob), where, SettingsError, known=("name", "knob"))
    node, rate = found.pop("node"), found.pop("rate")
    return LiveKnob(Knob(name, **found), node, rate)


def _start(name: str, entry: dict[str, Any], where: str) -> LiveStart:
    tuned_only = ("scale", "step", "about")
    found = entries(entry, (LiveStart, Knob), where, SettingsError, known=("name", "knob", *tuned_only))
    node, rate, value = (found.pop(key) for key in ("node", "rate", "value"))
    return LiveStart(Knob(name, **found), node, rate, value=value)


def _connection(given: Mapping[str, Any]) -> OPCUAPlant:
    stated = {name: given[name] for name in ("user", "security", "timeout") if name in given}
    variable = given.get("password_variable")
    if variable:
        if variable not in os.environ:
            raise SettingsError(f"the environment variable {variable!r} must hold the password")
        stated["password"] = os.environ[variable]
    return OPCUAPlant(given["url"], **stated)


def _journal(path: str) -> Journal:
    if Path(path).name in ("", ".."):
        raise SettingsError(f'journal: expected a file such as "old.json", got {path!r}')
    return Journal(Path(path).expanduser())
