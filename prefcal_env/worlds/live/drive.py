"""One run on a live plant: write within limits, start, record, and restore whatever happens."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from math import copysign, inf, isfinite, isnan, nan
from typing import get_args

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import ConnectionLostError, LiveError
from prefcal_env.experiments.experiment import End, Experiment
from prefcal_env.sources.source import Change, PlantTrial, Progress, Stage
from prefcal_env.tables.recorded import bridge, recorded

from .plan import Journal, LiveKnob, LivePlan, LivePlant, Role, TypedPlant, all_within, within


@dataclass(frozen=True, slots=True)
class Driven:
    """Result of a run on a live plant.

    Args:
        experiment: What was recorded. It ended as failed if the run was stopped, refused or lost.
        why: What stopped the run, as a sentence; empty if it was completed.
        restored: Whether the plant has its old values again. False if they are kept on purpose,
            or if the plant could not be reached or refused them.
        stopped: Whether a person stopped the run, or did not confirm it.
        kept: Whether the knobs keep their new values on purpose; the start values are taken back.
        problem: Why the plant does not have the values that it should have; empty if it has.
    """

    experiment: Experiment
    why: str = ""
    restored: bool = True
    stopped: bool = False
    kept: bool = False
    problem: str = ""


Confirm = Callable[[tuple[Change, ...]], bool]
"""Function that shows a person what will be written and returns whether they confirm it."""
Tell = Callable[[Progress], None]  # function that is called after every sample


Row = tuple[float, Mapping[str, float]]
"""A sample: seconds since the start of the record, and the value of each tag by its key."""


def experiment_of(rig: LivePlan, theta: Float[np.ndarray, " n"], rows: Sequence[Row], end: End) -> Experiment:
    """Return the experiment of a physical θ, shape (n,), from the samples of its run.

    Where an output had bad quality, its curve is interpolated, and the signal "NAME as read" keeps
    the gaps. Inputs and references keep their latest good value meanwhile, since they are held
    between samples anyway. A run in which an output or input never had a good value has failed. An
    output whose reference never had one has no reference in this run.
    """
    nothing = bool(never_good(rig, rows))
    kept = slice(0, 0) if nothing else slice(None)
    read = {tag: rig.as_output(tag, np.array([row[tag.key] for _, row in rows])[kept]) for tag in rig.tags}
    drawn = [tag for tag in rig.tags if tag.role != "reference"]
    t = np.array([instant for instant, _ in rows])[kept]
    curves = {
        role: {
            tag.name: bridge(t, values, held=role != "output")
            for tag, values in read.items()
            if tag.role == role
        }
        for role in get_args(Role)
    }
    return recorded(
        theta,
        t,
        curves["output"],
        curves["input"],
        curves["reference"],
        {c.name: c.unit for c in drawn},
        {c.name: (c.low, c.high) for c in drawn},
        signals={
            f"{tag.name} as read": values
            for tag, values in read.items()
            if tag.role == "output" and np.isnan(values).any()
        },
        kpis=rig.kpis,
        end=End.FAILED if nothing else end,
        time_unit="s",
    )


def never_good(rig: LivePlan, rows: Sequence[Row]) -> list[str]:
    """Return the roles and names of outputs and inputs without any good value in a run."""
    return [
        tag.key
        for tag in rig.tags
        if tag.role != "reference" and all(np.isnan(row[tag.key]) for _, row in rows)
    ]


# --- Write to a live plant within limits and rates, and notice if it comes no closer to a target.

_ROUNDING = 1e-9  # relative error of sums and products of doubles, with a margin


@dataclass(frozen=True, slots=True)
class _Known:
    """Value of a node on the plant, since when it has it, and what it may be instead.

    If the connection is lost during a write, the plant has either of the two.
    """

    value: float
    since: float
    before: float


class Writer:
    """Writer of one plant. Every value that reaches the plant passes `_write`, which checks it.

    `written` are the nodes that may be written to, by name; period and clock are in seconds.
    """

    def __init__(
        self, plant: LivePlant, written: Mapping[str, LiveKnob], period: float, clock: Callable[[], float]
    ) -> None:
        self._plant, self._written = plant, written
        self._period, self._clock = period, clock
        self._known: dict[str, _Known] = {}

    def read(self) -> dict[str, float]:
        """Read all nodes that may be written to, by name; NaN for bad quality.

        Raises:
            ConnectionLostError: If the connection is lost.
        """
        nodes = [written.node for written in self._written.values()]
        values = dict(zip(self._written, self._plant.read(nodes), strict=True))
        self.see(values)
        return values

    def see(self, values: Mapping[str, float]) -> None:
        """Take note of the values that the plant has now."""
        now = self._clock()
        for name, value in values.items():
            known = self._known.get(name)
            if not isfinite(value):
                self._known.pop(name, None)  # unknown: nothing is written until it is known
            elif known and any(self._written[name].same(value, v) for v in (known.value, known.before)):
                self._known[name] = _Known(value, known.since, known.before)
            else:  # neither what was written last, nor what the plant had before
                self._known[name] = _Known(value, now, value)

    def step(self, targets: Mapping[str, float]) -> None:
        """Move each value one step toward its target, as far as its rate allows.

        Raises:
            ConnectionLostError: If the connection is lost; a value may have arrived.
            LiveError: If the plant refuses a value.
        """
        for name, target in targets.items():
            known, written = self._known.get(name), self._written[name]
            if known is None or written.same(known.value, target):
                continue
            allowed = written.step(self._clock() - known.since, self._period)
            way = target - known.value
            if abs(way) <= allowed * (1 + _ROUNDING):
                self._write(written, known, target)
            elif allowed:
                self._write(written, known, known.value + copysign(allowed, way))

    def _write(self, written: LiveKnob, known: _Known, value: float) -> None:
        """Check one value against limits and rate, then write it."""
        now, knob = self._clock(), written.knob
        allowed = written.step(now - known.since, self._period)
        if not (isfinite(value) and knob.low <= value <= knob.high):
            raise LiveError(
                f"{knob.name} = {value:g} {knob.unit} is outside "
                f"[{knob.low:g}, {knob.high:g}]: nothing was written"
            )
        if abs(value - known.value) > allowed * (1 + 2 * _ROUNDING):
            raise LiveError(
                f"{knob.name} may change by {allowed:g} {knob.unit} now, got "
                f"{known.value:g} to {value:g}: nothing was written"
            )
        try:
            self._plant.write(written.node, value)
        finally:
            # After an error, too: the value may have arrived, at the latest now.
            self._known[knob.name] = _Known(value, self._clock(), known.value)


SLACK = 10  # additional periods that a plant may take to show a written value
_PATIENCE = 10.0
"""Seconds without progress, or without a connection, that are waited for at least once the process
was told to end; the old values are then restored at the next start."""


@dataclass(slots=True)
class Way:
    """Way of a plant back to its old values, as mutable state; times are in seconds."""

    written: Mapping[str, LiveKnob]  # nodes that may be written to, by name
    targets: Mapping[str, float]  # old values by name
    period: float  # sampling period of the run
    since: float  # time of the latest progress; at first, of the beginning
    _steps: int = 0
    _left: dict[str, float] = field(default_factory=dict)
    _waiting: float = field(init=False)

    def __post_init__(self) -> None:
        self._waiting = self.since

    def went(self, values: Mapping[str, float], now: float) -> None:
        """Take note of a step at time `now`, and of the values that the plant showed before it.

        Progress is that a value is closer to its target than ever before, so that two stations
        that write in turn make none.
        """
        self._steps += 1
        for name, target in self.targets.items():
            left, least = abs(values.get(name, inf) - target), self._left.get(name, inf)
            span = self.written[name].knob.high - self.written[name].knob.low
            if left < least - 1e-9 * span:  # never true of NaN
                self._left[name] = left
                self._steps, self.since, self._waiting = 0, now, now

    def lost(self, now: float) -> None:
        """Take note that the connection is lost, which only counts once the process must end."""
        self._steps, self.since = 0, now

    def blocked(self, now: float, *, closing: bool) -> bool:
        """Return whether there was no progress for so long that a person must help."""
        self._waiting = self._waiting if closing else now
        patience = _PATIENCE + SLACK * self.period + self._slowest()
        stuck = self._steps >= 20 and now - self.since > patience  # steps in a row without progress
        return stuck or (closing and now - self._waiting > _PATIENCE + self._slowest())

    def _slowest(self) -> float:
        """Return the longest time in seconds between two steps: integers cannot move by less."""
        rates = [self.written[n].rate for n in self.targets if self.written[n].knob.integer]
        return max((1.0 / rate for rate in rates), default=0.0)


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
    """One run, as mutable state; `run` or `try_out` does all of it.

    `theta` is the new value of each knob, by name; without `starts`, no start value is written.
    """

    def __init__(
        self,
        rig: LivePlan,
        theta: Mapping[str, float],
        journal: Journal,
        hands: Hands,
        *,
        starts: bool = True,
    ) -> None:
        self.rig, self.theta, self.journal, self.hands = rig, theta, journal, hands
        self.plant = rig.plant
        start = rig.start if starts else ()
        self.written = {part.knob.name: part for part in (*rig.knobs, *start)}
        self.start = {each.knob.name: float(each.value) for each in start}
        self.tags = {tag.key: tag for tag in rig.tags}
        self.writer = Writer(self.plant, self.written, rig.period, hands.clock)
        self.old: dict[str, float] = {}
        self._ways: tuple[Mapping[str, float], ...] = ()  # what the plant may have when it is written to
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

    def try_out(self, trial: PlantTrial, patience: float) -> tuple[str, bool]:
        """Have the θ that a trial wants on the plant until one of them is confirmed, which then stays.

        Whatever else happens, the values from before are restored.

        Args:
            patience: Seconds with the same values on the plant after which nothing is waited for any more.

        Returns:
            Why nothing was confirmed, or what the plant has in place of what was; empty if all is well.
            And whether the values from before need not be restored any more.
        """
        why = ""
        try:
            self._begin(trial.mark)
            self._try(trial, patience)
        except _EndedError as ended:
            why = ended.why
        except LiveError as error:
            why = str(error)
        except BaseException:
            if trial.leave():
                self.restore()
            raise
        if trial.leave():
            self.problem = why
            done = self.restore()
            return (why if done else f"{why}; {self.problem}"), done
        why = self._differs()
        self.journal.settle(trial.mark)  # last: until then, the study and this file say together what stays
        return why, True

    def _differs(self) -> str:
        """Return what the plant has in place of what was confirmed: since the last sample, it may differ."""
        try:
            self._now = self.writer.read()
        except LiveError as error:
            return f"it was confirmed, but the plant cannot be read, so look what it has: {error}"
        shown = self._shows(self.theta)
        return "" if shown else f"it was confirmed, but now {self._refused(self.theta)}"

    def _try(self, trial: PlantTrial, patience: float) -> None:
        sides = {i: dict(zip(self.theta, map(float, theta), strict=True)) for i, theta in trial.sides.items()}
        self._ways = (self.old, *sides.values())
        # Each of them takes as long as the slowest: else a blind trial would tell which one the plant had.
        slowest = self._longest(*self._ways) + 3 * self.rig.period
        since = self.hands.clock()
        while not trial.confirmed():
            if (wanted := trial.turn()) is not None:
                began, self.theta = self.hands.clock(), sides[wanted]
                self._ramp(self.theta)
                while self.hands.clock() < began + slowest:
                    self._sample(Stage.WRITING)
                self.rows, self._began = [], None
                trial.has(wanted)
                since = self.hands.clock()  # writing them may take longer than the patience
            self._sample(Stage.RECORDING)
            self._unchanged(self.theta)
            if self.hands.clock() > since + patience:
                raise _EndedError(End.FAILED, f"nothing was confirmed within {patience:g} s")

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
            if change.name in self.start and change.seconds >= self.rig.duration:
                raise LiveError(
                    f"{change.name} takes {change.seconds:g} s from {change.old:g} to {change.new:g} "
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
        if targets and keep:
            targets = self._without_knobs(targets)
        if not targets:
            return True  # nothing was written, or nothing is to be taken back
        self._next, self._period = self.hands.clock(), min(self.rig.period, 1.0)
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
        self._begin()
        self._ramp(self.theta)
        self._until_ready()
        return self._record()

    def _begin(self, trial: str = "") -> None:
        """Let a person confirm what is written, and save what the plant has."""
        changes = self.look()
        if not self.hands.confirm(changes):
            raise _EndedError(End.FAILED, "it was not confirmed: nothing was written", stopped=True)
        # Again, since the person may have taken minutes, and on the disk before the first write.
        if [c.old for c in self.look()] != [c.old for c in changes]:
            raise LiveError("the plant's values changed before they were confirmed: look again")
        if self.hands.stop() or self.hands.closing():
            raise _EndedError(End.FAILED, "it was stopped: nothing was written", stopped=True)
        old = {change.name: change.old for change in changes}
        self.journal.save(old, trial)
        self.old, self._ways = old, (old,)
        self._next = self.hands.clock()

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
        return self.hands.clock() + 2.0 * self._longest(targets) + SLACK * self.rig.period

    def _longest(self, *targets: Mapping[str, float]) -> float:
        """Return the longest time in seconds to one of `targets`, at the rates."""
        pairs = [(to, at) for to in targets for at in self._ways]
        times = [abs(v - at[n]) / self.written[n].rate for to, at in pairs for n, v in to.items() if n in at]
        return max(times, default=0.0)

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
            hands.sleep(min(left, 0.2))  # a stop is noticed soon, however long the period

    def _tell(self, stage: Stage) -> None:
        elapsed = self.rows[-1][0] if self.rows else 0.0
        values = {key: self._now[key] for key in self.tags if key in self._now}
        self.hands.tell(Progress(stage, elapsed, self.rig.duration, values, self.problem))
