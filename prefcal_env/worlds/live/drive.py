"""Do one run on a live plant: write, start, record, and restore whatever happens."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from math import isnan, nan

import numpy as np

from prefcal_env.errors import ConnectionLostError, LiveError
from prefcal_env.experiments.end import End
from prefcal_env.sources.run import Change, Progress, Stage

from .journal import Journal
from .outcome import Row, experiment_of, never_good
from .parts import all_within, within
from .plan import LivePlan
from .plant import TypedPlant
from .progress import Confirm, Driven, Tell
from .writer import SLACK, Way, Writer

_SLICE = 0.2
"""Longest sleep in seconds, so that a stop is noticed soon although the period may be long."""
_RESTORING = 1.0
"""Longest period, in seconds, at which old values are restored."""


@dataclass(frozen=True, slots=True)
class Hands:
    """What a run gets from outside: time, and the will of a person; see `LiveRig.drive`."""

    clock: Callable[[], float]
    sleep: Callable[[float], None]
    confirm: Confirm = lambda changes: False
    stop: Callable[[], bool] = lambda: False
    closing: Callable[[], bool] = lambda: False
    tell: Tell = lambda progress: None


class _EndedError(Exception):
    """End of a run before its time, for a reason that is no error of the caller."""

    def __init__(self, end: End, why: str, *, stopped: bool = False) -> None:
        super().__init__(why)
        self.end, self.why, self.stopped = end, why, stopped


class Drive:
    """One run, as mutable state; `run` does all of it.

    Args:
        rig: What is done, and on which plant.
        theta: New value of each knob, by name.
        journal: File for the old values.
        hands: Clock, confirmation, stop and progress.
    """

    def __init__(self, rig: LivePlan, theta: Mapping[str, float], journal: Journal, hands: Hands) -> None:
        self.rig, self.theta, self.journal, self.hands = rig, theta, journal, hands
        self.plant = rig.plant
        self.written = {part.knob.name: part for part in (*rig.knobs, *rig.start)}
        self.start = {start.knob.name: float(start.value) for start in rig.start}
        self.tags = {tag.key: tag for tag in rig.tags}
        self.writer = Writer(self.plant, self.written, rig.period, hands.clock)
        self.old: dict[str, float] = {}
        self.rows: list[Row] = []
        self.problem = ""
        self._next, self._period = hands.clock(), rig.period
        self._began: float | None = None
        self._now: Mapping[str, float] = {}
        self._held_since: float | None = None
        self._seen_at: dict[str, float] = {}

    def run(self) -> Driven:
        """Do the run. Whatever happens, the old values are restored, at the latest afterward."""
        end, why, stopped, keep = End.FAILED, "", False, False
        try:
            end = self._forward()
            keep = self.rig.after == "keep"
        except _EndedError as ended:
            end, why, stopped = ended.end, ended.why, ended.stopped
        except LiveError as error:
            why = str(error)
        except BaseException:
            self.restore()
            raise
        self.problem = why
        done = self.restore(keep=keep)
        blind = ", ".join(never_good(self.rig, self.rows))
        why = why or (f"the plant had no good value of {blind} in the run" if blind else "")
        experiment = experiment_of(self.rig, np.array([*self.theta.values()]), self.rows, end)
        problem = "" if done else self.problem
        return Driven(experiment, why, done and not keep, stopped, done and keep, problem)

    def look(self) -> tuple[Change, ...]:
        """Return what would be written.

        Raises:
            ConnectionLostError: If the plant cannot be reached.
            LiveError: If the plant has no good value of a node, or one outside the limits.
        """
        if not self.plant.connected:
            self.plant.connect()
        values, new = self.writer.read(), {**self.theta, **self.start}
        # A record that cannot be read must be noticed before anything is written.
        self.plant.read([tag.node for tag in self.tags.values()])
        for name, written in self.written.items():
            knob = written.knob
            if not within(values[name], (knob.low, knob.high)):
                got = "no good value" if isnan(values[name]) else f"{values[name]:g}"
                raise LiveError(
                    f"the plant has {got} for {name}, expected one in [{knob.low:g}, "
                    f"{knob.high:g}] {knob.unit}: set it there, or widen the range"
                )
        self._check_types()
        changes = tuple(w.changed(values[name], new[name]) for name, w in self.written.items())
        for change in changes:
            name = change.name
            if name in self.start and change.seconds >= self.rig.duration:
                raise LiveError(
                    f"{name} takes {change.seconds:g} s from {change.old:g} to {change.new:g} "
                    f"{change.unit}, as long as the run or longer: the duration "
                    f"must be above that, got {self.rig.duration:g} s"
                )
        return changes

    def _check_types(self) -> None:
        """Refuse nodes that cannot hold the values between, before the first of them is written."""
        real = [w for w in self.written.values() if not w.knob.integer]
        if not (real and isinstance(self.plant, TypedPlant)):
            return
        for written, whole in zip(real, self.plant.whole([w.node for w in real]), strict=True):
            if whole:
                raise LiveError(
                    f"the node {written.node!r} of {written.knob.name} holds whole numbers only: "
                    "declare integer = true"
                )

    def restore(self, old: Mapping[str, float] | None = None, *, keep: bool = False) -> bool:
        """Move the plant back to its old values; return whether it has them again.

        While the connection is lost, this tries to connect again once per sampling period, for as
        long as the process is not told to end. It ends, too, if the values come no closer: the
        plant refuses them, shows no good value, or another station writes its own.

        Args:
            old: Values to restore; by default, those from before this run.
            keep: Whether to keep the knobs' new values, and take back the start values only.
        """
        targets = dict(self.old if old is None else old)
        if not targets:
            return True  # nothing was written
        if keep:
            targets = self._without_knobs(targets)
            if not targets:
                return True
        self._next, self._period = self.hands.clock(), min(self.rig.period, _RESTORING)
        way, last = Way(self.written, targets, self.rig.period, self.hands.clock()), ""
        while not way.blocked(self.hands.clock(), closing=self.hands.closing()):
            stage = Stage.RESTORING
            try:
                if self._moved_to(targets):
                    self.journal.clear()
                    return True
                last = ""
                way.went(self._now, self.hands.clock())
            except ConnectionLostError as error:
                stage, last = Stage.LOST, str(error)
                way.lost(self.hands.clock())
            except LiveError as error:
                last = str(error)
                way.went(self._now, self.hands.clock())
            self.problem = self.problem or last
            with suppress(Exception):  # a front end that fails must not keep the values changed
                self._tell(stage)
            self._wait()
        self.problem = last or self._refused(targets)
        return False

    def _without_knobs(self, targets: Mapping[str, float]) -> dict[str, float]:
        """Return the start values to take back, and forget the old knobs on the disk, too.

        Otherwise, the next start would take back a θ that is kept on purpose.
        """
        start = {name: v for name, v in targets.items() if name in self.start}
        with suppress(LiveError, OSError):  # the start values must be taken back all the same
            self.journal.save(start) if start else self.journal.clear()
        return start

    def _moved_to(self, targets: Mapping[str, float]) -> bool:
        """Connect if necessary, move one step, and return whether the plant shows the targets."""
        if not self.plant.connected:
            try:
                self.plant.connect()
            except LiveError as error:  # a server that restarts refuses sessions for a while
                raise ConnectionLostError(str(error)) from error
        values = self.writer.read()
        self._now = {**self._now, **values}
        if all(self.written[n].same(values[n], target) for n, target in targets.items()):
            return True
        problems = []
        for name, target in targets.items():  # one that is refused must not keep the others changed
            try:
                self.writer.step({name: target})
            except ConnectionLostError:
                raise
            except LiveError as error:
                problems.append(f"{name}: {error}")
        if problems:
            raise LiveError("; ".join(problems))
        return False

    def _forward(self) -> End:
        changes = self.look()
        if not self.hands.confirm(changes):
            raise _EndedError(End.FAILED, "it was not confirmed: nothing was written", stopped=True)
        # Again, since the person may have taken minutes, and on the disk before the first write.
        if [c.old for c in self.look()] != [c.old for c in changes]:
            raise LiveError("the plant's values changed before they were confirmed: look again")
        if self.hands.stop() or self.hands.closing():
            raise _EndedError(End.FAILED, "it was stopped: nothing was written", stopped=True)
        old = {change.name: change.old for change in changes}
        self.journal.save(old)
        self.old = old
        self._next = self.hands.clock()
        self._ramp(self.theta)
        self._until_ready()
        return self._record()

    def _ramp(self, targets: Mapping[str, float]) -> None:
        """Write `targets` at their rates, and read them back."""
        deadline = self._deadline(targets)
        while not self._shows(targets):
            if self.hands.clock() > deadline:
                raise LiveError(self._refused(targets))
            self.writer.step(targets)
            self._sample(Stage.WRITING)

    def _deadline(self, targets: Mapping[str, float]) -> float:
        """Return the time by which the plant must show `targets`."""
        rates = {name: self.written[name].rate for name in targets}
        longest = max((abs(v - self.old[n]) / rates[n] for n, v in targets.items()), default=0.0)
        return self.hands.clock() + 2.0 * longest + SLACK * self.rig.period

    def _shows(self, targets: Mapping[str, float]) -> bool:
        written = self.written
        return all(written[n].same(self._now.get(n, self.old[n]), v) for n, v in targets.items())

    def _refused(self, targets: Mapping[str, float]) -> str:
        shown = {n: self._now.get(n, self.old.get(n, nan)) for n in targets}
        wrong = [
            f"{n} = {'no good value' if isnan(shown[n]) else format(shown[n], 'g')} "
            f"instead of {v:g} {self.written[n].knob.unit}"
            for n, v in targets.items()
            if not self.written[n].same(shown[n], v)
        ]
        return f"the plant shows {', '.join(wrong)}: it limits the value, or another station writes it"

    def _until_ready(self) -> None:
        ready = self.rig.keyed(self.rig.ready)
        if not ready:
            return
        deadline, self._held_since = self.hands.clock() + self.rig.ready_within, None
        while not self._holds(ready):
            if self.hands.clock() >= deadline:
                wanted = ", ".join(
                    f"{self.tags[key].name} in [{low:g}, {high:g}] {self.tags[key].unit}"
                    for key, (low, high) in ready.items()
                )
                raise LiveError(
                    f"the start condition was not met within {self.rig.ready_within:g} s: {wanted}"
                )
            self._sample(Stage.WAITING)

    def _holds(self, limits: Mapping[str, tuple[float, float]]) -> bool:
        """Return whether a condition has held long enough, by the latest sample."""
        if not self._now or not all_within(self._now, limits):
            self._held_since = None
            return False
        now = self.hands.clock()
        self._held_since = now if self._held_since is None else self._held_since
        return now - self._held_since >= self.rig.hold - 1e-9

    def _record(self) -> End:
        """Start the run and record it from there on."""
        rig, started = self.rig, not self.start
        done = rig.keyed(rig.done)
        deadline, self._held_since = self._deadline(self.start), None
        while True:
            self._sample(Stage.RECORDING)
            self._unchanged(self.theta)
            started = started or self._shows(self.start)
            if started and done and self._holds(done):
                return End.SETTLED
            over = self.rows[-1][0] >= rig.duration - 1e-9
            if over and started:
                return End.TIME_UP
            if not started:
                if over or self.hands.clock() > deadline:
                    raise LiveError(self._refused(self.start))
                self.writer.step(self.start)

    def _unchanged(self, targets: Mapping[str, float]) -> None:
        """Stop if somebody else changed a knob: the record would be one of another θ."""
        for name, value in targets.items():
            shown, written = self._now[name], self.written[name]
            if not isnan(shown) and not written.same(shown, value):
                now = f"{shown:g} {written.knob.unit}"
                raise _EndedError(End.FAILED, f"{name} was changed on the plant to {now} during the run")

    def _sample(self, stage: Stage) -> None:
        """Wait for the next sampling instant, read everything, and check the abort limits."""
        if self._began is not None or stage is not Stage.RECORDING:
            self._wait(stops=True)
        now = self.hands.clock()
        names = [*self.written, *self.tags]
        nodes = [written.node for written in self.written.values()]
        nodes += [tag.node for tag in self.tags.values()]
        values = dict(zip(names, self.plant.read(nodes), strict=True))
        self.writer.see({name: values[name] for name in self.written})
        self._now = values
        if stage is Stage.RECORDING:
            self._began = now if self._began is None else self._began
            self.rows.append((now - self._began, {key: values[key] for key in self.tags}))
        self._tell(stage)
        self._supervise(now)

    def _supervise(self, now: float) -> None:
        for key, tag in self.tags.items():
            value = self._now[key]
            if not tag.supervised:
                continue
            if not isnan(value):
                self._seen_at[key] = now
                if not within(value, tag.abort):
                    raise _EndedError(
                        End.UNSAFE,
                        f"{tag.name} = {value:g} {tag.unit} is outside its abort limits "
                        f"[{tag.abort[0]:g}, {tag.abort[1]:g}]",
                    )
            elif now - self._seen_at.setdefault(key, now) > self.rig.blind:
                raise _EndedError(End.FAILED, f"{tag.name} had no good value for {self.rig.blind:g} s")

    def _wait(self, *, stops: bool = False) -> None:
        """Sleep until the next sampling instant; a person can stop the run meanwhile."""
        hands, period = self.hands, self._period
        self._next = max(self._next + period, hands.clock() - period)
        while True:
            if stops and (hands.stop() or hands.closing()):
                raise _EndedError(End.FAILED, "it was stopped", stopped=True)
            left = self._next - hands.clock()
            if left <= 1e-9:
                return
            hands.sleep(min(left, _SLICE))

    def _tell(self, stage: Stage) -> None:
        elapsed = self.rows[-1][0] if self.rows else 0.0
        values = {key: self._now[key] for key in self.tags if key in self._now}
        told = Progress(stage, elapsed, self.rig.duration, values, self.problem)
        self.hands.tell(told)
