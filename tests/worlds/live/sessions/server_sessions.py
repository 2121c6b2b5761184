"""Run random sessions over a real OPC UA server whose connection breaks at random instants.

The tests of live plants `run` a few of them.

A session is one experiment of a study, from reading the plant to the answer. A relay between
prefcal and the example server of `docs/` drops the connection once or twice in it, at random
instants, for a random time; sometimes requests or answers vanish before that. The server itself
notes every write. Checked after each session:

- no write was outside the limits, or faster than the rate;
- the old values are back on the server;
- after a regained connection, each of them is on its way back within two samples, and from then on
  moves at every sample (how far is what the rates allow; `simulated_sessions.py` checks that
  exactly, in simulated time);
- the study file, closed and opened again, holds every answer and experiment.
"""

import socket
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path

import numpy as np

from prefcal_agents import RandomSearch
from prefcal_app.session import Choice, Interview, Now, Phase, actions
from prefcal_app.session.study import agent_as_dict, knobs_as_dicts
from prefcal_env.study import StudyFile
from prefcal_env.worlds.live import LiveRig, live_rig
from prefcal_env.worlds.live.plan import LiveKnob
from prefcal_scenarios.scenario import Scenario

from .relay import WRITTEN, Loss, Relay, Watch, Write, loss_at_random, watched_tank

_PERIOD = 0.05
_SPAN = 1.1
"""Longest time in seconds from the beginning of a session to that of a loss."""
_LATE = 0.002
"""Seconds by which the server may see two writes closer together than prefcal sent them."""


class Broken(Exception):
    """A promise is broken."""


def rig_at(port: int, folder: Path) -> LiveRig:
    """Return a rig on the example server behind `port`."""
    node, setpoint = "ns=2;s=Tank.", "ns=2;s=Tank.Setpoint"
    start = {"node": setpoint, "value": 1.3, "low": 0.5, "high": 1.8, "rate": 4}
    return live_rig(
        {
            "url": f"opc.tcp://127.0.0.1:{port}/tank",
            "duration": 0.3,
            "period": _PERIOD,
            "timeout": 1.0,
            "journal": str(folder / "old.json"),
            "knobs": {
                "K_p": {"node": f"{node}Kp", "low": 0.2, "high": 10, "rate": 60},
                "T_i": {"node": f"{node}Ti", "low": 1, "high": 60, "rate": 400, "unit": "s"},
            },
            "outputs": {"level": {"node": f"{node}Level", "unit": "m"}},
            "references": {"level": {"node": setpoint}},
            "start": {"set-point": start},
        }
    )


@dataclass
class Study:
    """One study of several sessions, as mutable state; `sessions` does all of it.

    Args:
        seed: Seed of every random choice.
        watch: What the server notes.
        relay: Connection to the server.
        folder: Folder of the study file and of the old values.
    """

    seed: int
    watch: Watch
    relay: Relay
    folder: Path
    answers: int = 0
    finished: set[int] = field(default_factory=set)
    losses: list[Loss] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng(self.seed)
        self.rig = rig_at(self.relay.port, self.folder)
        self.scenario = Scenario("tank", "A tank", self.rig.space, self.rig)
        self.path = self.folder / "study.prefcal"
        self.old = dict(self.watch.values)
        parts = [*self.rig.knobs, *self.rig.start]
        self.written = dict(zip(WRITTEN, parts, strict=True))

    def sessions(self, count: int) -> Iterator[str]:
        """Run sessions until the study is over, and yield how each ended."""
        interview = self._interview(count)
        try:
            while interview.now().phase is not Phase.OVER:
                self.watch.forget()
                self.losses.clear()
                losing = [
                    threading.Thread(target=self._lose, args=loss_at_random(self.rng, _SPAN))
                    for _ in range(self.rng.integers(1, 3))
                ]
                for each in losing:
                    each.start()
                how = self._session(interview)
                for each in losing:
                    each.join()
                self._check_plant()
                interview.file.close()
                interview = Interview(self.scenario, StudyFile.open(self.path, clock=_now), ahead=False)
                self._check_study(interview.now())
                yield how
        finally:  # also if nobody asks for the rest: a file with the same inode could not be opened
            interview.file.close()
            self.rig.plant.close()

    def _interview(self, count: int) -> Interview:
        agent = RandomSearch(self.scenario.space, n_init=1, n_max=count, seed=self.seed)
        configuration = {
            "scenario": "tank",
            "name": "tank",
            "title": "A tank",
            "knobs": knobs_as_dicts(self.scenario.space),
            "agent": agent_as_dict(agent),
            "n_max": count,
            "seed": self.seed,
            "kpis": [],
            "options": {"calibrator": "human"},
            "versions": {},
        }
        file = StudyFile.create(self.path, configuration, clock=_now)
        return Interview(self.scenario, file, ahead=False)

    def _lose(self, instant: float, how: dict[str, float]) -> None:
        time.sleep(instant)
        self.losses.append(self.relay.lose(**how))

    def _session(self, interview: Interview) -> str:
        """Do one experiment, its trials and its answer; return how it ended."""
        how, ran = "completed", False
        while True:
            now = _waited_for(interview)
            self.finished |= now.state.finished.keys()
            if now.question is not None:
                interview.do(actions.Answer(now.question.id, Choice.LEFT))
                self.answers += 1
            elif now.phase is Phase.OVER or (now.phase is Phase.CONFIRM and ran):
                return how
            elif now.phase is Phase.FAILED and self.rng.random() < 0.5:
                interview.do(actions.Retry())
                how = "lost in the run, tried again"
            elif now.phase is Phase.FAILED:
                interview.do(actions.Fail(_pending(now), now.problem or ""))
                how, ran = "lost in the run, counted as failed", True
            elif now.plant is not None and now.plant.changes is None:
                interview.do(actions.Retry())
                how = "lost before the run, read again"
            else:
                interview.do(actions.WriteAndStart(_pending(now)))
                interview.work()
                ran = interview.now().phase is not Phase.FAILED

    def _check_plant(self) -> None:
        for write in self.watch.writes:
            part = self.written[write.name]
            if not part.knob.low <= write.new <= part.knob.high:
                raise Broken(f"{write} is outside [{part.knob.low}, {part.knob.high}]")
        for name in WRITTEN:
            writes = [write for write in self.watch.writes if write.name == name]
            for before, write in zip([None, *writes], writes, strict=False):
                self._check_rate(write, before)
            if not self.written[name].same(self.watch.values[name], self.old[name]):
                raise Broken(f"{name} is {self.watch.values[name]}, it was {self.old[name]}")
        if self.rig.left is not None:
            raise Broken("the old values are still on the disk")
        for loss in self.losses:
            self._check_restored_soon(loss)

    def _check_rate(self, write: Write, before: Write | None) -> None:
        part, elapsed = self.written[write.name], _PERIOD
        if before is not None:
            elapsed = min(write.at - before.at + _LATE, _PERIOD)
        if abs(write.new - write.old) > part.rate * elapsed * (1 + 1e-6):
            raise Broken(f"{write} after {before} is faster than {part.rate} per second")

    def _check_restored_soon(self, loss: Loss) -> None:
        """Check how many samples the old values took after the connection was regained."""
        then = dict(self.old)
        for write in self.watch.writes:
            if write.at <= loss.regained:
                then[write.name] = write.new
        if all(self.written[n].same(then[n], self.old[n]) for n in WRITTEN):
            return
        # With another loss or a run in between, this says nothing.
        back = _back_at(self.watch.writes, then, self.old, self.written, loss.regained)
        if any(o is not loss and o.regained > loss.began and o.began < back for o in self.losses):
            return
        reads = [at for at in self.watch.reads if loss.regained < at < back]
        idle = max(self._idle(name, then[name], reads, back) for name in WRITTEN)
        if idle > 1:
            writes = [(w.at, w.name, w.new) for w in self.watch.writes]
            raise Broken(f"{idle} idle samples after {loss}: {reads}, writes {writes}, {back}")

    def _idle(self, name: str, value: float, reads: list[float], back: float) -> int:
        """Return the number of samples at which a value was not moved though it was not restored.

        Args:
            name: Name of the node.
            value: Its value when the connection was regained.
            reads: Times of the samples from then on, in seconds.
            back: Time at which all values were restored, in seconds.
        """
        idle = 0
        for since, until in pairwise([*reads, back]):
            steps = [w.new for w in self.watch.writes if w.name == name and since < w.at <= until]
            idle += not steps and not self.written[name].same(value, self.old[name])
            value = steps[-1] if steps else value
        return idle

    def _check_study(self, now: Now) -> None:
        lost = self.finished - now.state.finished.keys()
        given = sum(answer.question is not None for answer in now.state.answers)
        if lost or given != self.answers:
            raise Broken(f"{given} answers of {self.answers}; experiments {sorted(lost)} are lost")


def _back_at(
    writes: list[Write],
    then: dict[str, float],
    old: dict[str, float],
    written: dict[str, LiveKnob],
    since: float,
) -> float:
    """Return when all nodes had their old values again, in seconds."""
    values = dict(then)
    for write in writes:
        if write.at > since:
            values[write.name] = write.new
            if all(part.same(values[n], old[n]) for n, part in written.items()):
                return write.at
    raise Broken(f"{values} were not restored to {old}")


def _waited_for(interview: Interview) -> Now:
    """Work until a person must do something; return what is waited for."""
    while interview.work():
        pass
    return interview.now()


def _pending(now: Now) -> int:
    assert now.pending is not None
    return now.pending.index


def _now() -> str:
    return datetime.now(UTC).isoformat()


@dataclass
class Results:
    """Number of sessions by how they ended, of writes, and what was broken, in words."""

    ends: Counter[str] = field(default_factory=Counter)
    writes: int = 0
    broken: list[str] = field(default_factory=list)


def run(seconds: float, most: int = 10**6, first: int = 0, study: int = 12) -> Results:
    """Return the results of as many sessions as `seconds` and `most` allow.

    Args:
        seconds: Time after which no further study begins, in seconds.
        most: Largest number of sessions.
        first: Seed of the first study.
        study: Number of sessions in a study.
    """
    with closing(socket.create_server(("127.0.0.1", 0))) as free:
        port = free.getsockname()[1]
    results, until, seed = Results(), time.monotonic() + seconds, first
    with ExitStack() as stack:
        watch = stack.enter_context(watched_tank(port))
        relay = stack.enter_context(Relay(port).running())
        while results.ends.total() < most and time.monotonic() < until:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            one = Study(seed, watch, relay, folder)
            # A study that breaks a promise is over; the next one tells whether it was the only one.
            try:
                for how in one.sessions(max(2, min(study, most - results.ends.total()))):
                    results.ends[how] += 1
                    results.writes += len(watch.writes)
            except Broken as error:
                results.broken.append(f"study {seed}: {error}")
            seed += 1
    return results
