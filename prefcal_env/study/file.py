"""Store a study in an SQLite file, to which events are appended durably and never changed."""

import sqlite3
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any, Self

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import StudyError
from prefcal_env.experiments.experiment import End, Experiment
from prefcal_env.knobs.key import theta_key

from . import schema
from .codec import LONGEST_HEADER, decode, encode, end_of, pack, unpack
from .connection import beside, connect, existing, publish, vacant
from .events import Created, Event, Finished, Recorded, from_text, to_text
from .fold import State, begin, step
from .trouble import told

Entry = Event | tuple[Finished, Experiment]
Clock = Callable[[], str]
_DAMAGED = "It is damaged: nothing was changed; use an earlier copy or an export"


class StudyFile:
    """Open study, made by `create` or `open`. Methods can be called from any thread.

    An event is on the disk when `append` returns. If another process writes to the same file, the
    next `append` here is refused, so nothing is recorded twice.
    """

    def __init__(self, connection: sqlite3.Connection, path: str, clock: Clock) -> None:
        self._connection, self.path, self._clock = connection, path, clock
        self._lock = threading.RLock()
        self._last = 0  # number of the last event
        self._state: State | None = None
        self._experiments: dict[bytes, int] = {}

    @classmethod
    def create(cls, path: Path | str, configuration: Mapping[str, Any], *, clock: Clock) -> Self:
        """Start a study at `path`, or in memory at ":memory:".

        Args:
            path: New file in an existing folder.
            configuration: Nested plain data, with an integer `n_max`.
            clock: Function that returns the time of an event as text.

        Raises:
            StudyError: If there is a file already, or it cannot be written.
        """
        created = Created(configuration)
        if str(path) == ":memory:":
            file = cls(connect(":memory:"), ":memory:", clock)
            file._begin(created)
            return file
        target = vacant(path)
        # Write a temporary file and link it, so that a file of this name is always complete.
        part = beside(target)
        with told(target, "begin", "Nothing was recorded"):
            try:
                with closing(connect(part)) as connection:
                    cls(connection, str(part), clock)._begin(created)
                publish(part, target)
            finally:
                part.unlink(missing_ok=True)
        return cls.open(target, clock=clock)

    @classmethod
    def open(cls, path: Path | str, *, clock: Clock) -> Self:
        """Open the study at `path`.

        Raises:
            StudyError: If there is none, or it is damaged, not a study, or of another format.
        """
        with told(existing(path), "open"), ExitStack() as undo:
            connection = connect(path)
            undo.callback(connection.close)
            schema.check(connection, str(path))
            connection.execute("PRAGMA journal_mode = WAL")
            connection.execute("PRAGMA synchronous = FULL")
            file = cls(connection, str(path), clock)
            file._load()
            undo.pop_all()  # it stays open
        return file

    def _begin(self, created: Created) -> None:
        schema.create(self._connection)
        self._insert([(created, None)], [self._clock()])
        self._connection.execute("COMMIT")

    def _load(self) -> None:
        last = 0
        for last, recorded in enumerate(self.events(), start=1):
            if recorded.seq != last:
                raise StudyError(f"event {last} of {self.path} is missing. {_DAMAGED}")
            self._take(recorded)
        if not last:
            raise StudyError(f"there are no events in {self.path}. {_DAMAGED}")
        self._last = last

    def _take(self, recorded: Recorded) -> None:
        """Apply one event to the state."""
        seq, at, event = recorded.seq, recorded.at, recorded.event
        if self._state is None:
            self._state = begin(seq, at, event)
        else:
            self._state = step(self._state, seq, at, event)
        if isinstance(event, Finished):
            theta = self._state.history.samples[event.index].theta
            self._experiments[theta_key(theta)] = self._state.finished[event.index]

    @property
    def state(self) -> State:
        """Return the state of the study after all events."""
        assert self._state is not None
        return self._state

    def events(self) -> Iterator[Recorded]:
        """Yield all events in order, without payloads."""
        with self._lock, told(self.path, "read"):
            rows = self._connection.execute("SELECT seq, at, body FROM event ORDER BY seq")
            found = rows.fetchall()
        for seq, at, body in found:
            try:
                event = from_text(body)
            except StudyError as error:
                raise StudyError(f"event {seq} of {self.path}: {error}") from error
            yield Recorded(seq, at, event)

    def experiment(self, seq: int) -> Experiment:
        """Return the experiment of event `seq`. Raises StudyError if it has none."""
        with self._lock, told(self.path, "read"):
            found = self._connection.execute("SELECT payload FROM event WHERE seq = ?", (seq,))
            row = found.fetchone()
        if row is None or row[0] is None:
            raise StudyError(f"event {seq} of {self.path} has no experiment")
        try:
            return decode(unpack(bytes(row[0])))
        except StudyError as error:
            raise StudyError(f"event {seq} of {self.path}: {error}") from error

    def end(self, seq: int) -> End:
        """Return how the experiment of event `seq` ended, without reading its trajectory.

        Raises:
            StudyError: If the event has none, or it cannot be read.
        """
        with self._lock, told(self.path, "read"):
            query = "SELECT substr(payload, 1, ?) FROM event WHERE seq = ?"
            row = self._connection.execute(query, (LONGEST_HEADER, seq)).fetchone()
        found = None if row is None or row[0] is None else end_of(bytes(row[0]))
        return self.experiment(seq).end if found is None else found

    def to_frame(self, *, answers: bool = False) -> Any:
        """Return the experiments as a pandas DataFrame: θ, KPIs, how each ended, and its marks.

        Args:
            answers: Whether to return the answers instead, one a row.
        """
        from .tables import frame_of

        return frame_of(self, answers=answers)

    def _repr_html_(self) -> str:
        """Return how far the study is, and its experiments, for notebooks."""
        from .tables import html_of

        return html_of(self)

    def rows(self) -> list[tuple[Any, ...]]:
        """Return every event as it is stored: seq, at, body and payload (compressed)."""
        query = "SELECT seq, at, body, payload FROM event ORDER BY seq"
        with self._lock, told(self.path, "read"):
            return self._connection.execute(query).fetchall()

    def find_experiment(self, theta: Float[np.ndarray, " n"]) -> int | None:
        """Return the number of an event with an experiment of θ, (n,), even after an undo."""
        return self._experiments.get(theta_key(tuple(map(float, theta))))

    def append(self, *entries: Entry) -> tuple[int, ...]:
        """Record all events or none; they are durable when this returns.

        Args:
            entries: Events; a Finished with its experiment as a pair.

        Returns:
            Their numbers.

        Raises:
            StudyError: If an event is impossible in the present state, the disk is full, the file
                is read-only, or another process has written to it. Nothing is recorded then, and
                the study can still be used.
        """
        pairs = [e if isinstance(e, tuple) else (e, None) for e in entries]
        with self._lock:
            times = [self._clock() for _ in pairs]
            first = self._last + 1
            recorded = [
                Recorded(first + i, at, event)
                for i, ((event, _), at) in enumerate(zip(pairs, times, strict=True))
            ]
            state = self.state
            for r in recorded:
                state = step(state, r.seq, r.at, r.event)
            with told(self.path, "write to", "Nothing was recorded"):
                self._write(pairs, times)
            for r in recorded:
                self._take(r)
        return tuple(r.seq for r in recorded)

    def _write(self, pairs: Sequence[Any], times: Sequence[str]) -> None:
        connection, before = self._connection, self._last
        connection.execute("BEGIN IMMEDIATE")
        try:
            (last,) = connection.execute("SELECT max(seq) FROM event").fetchone()
            if last != before:
                raise StudyError(
                    f"another process has written to {self.path}: nothing was recorded here. "
                    "Close one of the two and open the study again"
                )
            self._insert(pairs, times)
            connection.execute("COMMIT")
        except BaseException:  # Ctrl-C too: either all of it is recorded, or nothing
            self._last = before
            if connection.in_transaction:
                connection.execute("ROLLBACK")
            raise

    def _insert(self, pairs: Sequence[Any], times: Sequence[str]) -> None:
        """Insert rows, inside a transaction."""
        for (event, experiment), at in zip(pairs, times, strict=True):
            seq = self._last + 1
            self._check_experiment(seq, event, experiment)
            payload = None if experiment is None else pack(encode(experiment))
            row = (seq, at, to_text(event), payload)
            self._connection.execute("INSERT INTO event VALUES (?, ?, ?, ?)", row)
            self._last = seq
        if self._state is None:
            self._state = begin(1, times[0], pairs[0][0])

    def _check_experiment(self, seq: int, event: Event, experiment: Experiment | None) -> None:
        """Check that each Finished, and no other event, has an experiment or refers to one.

        Raises:
            StudyError: If that is not so, or the event it refers to has none.
        """
        source = event.same_as if isinstance(event, Finished) else None
        if isinstance(event, Finished) != ((experiment is None) != (source is None)):
            raise StudyError(
                f"event {seq} is impossible: a Finished event, and no other, has an experiment or "
                "names the event that has it"
            )
        if source is None:
            return
        brought = "SELECT 1 FROM event WHERE seq = ? AND payload IS NOT NULL"
        if self._connection.execute(brought, (source,)).fetchone() is None:
            raise StudyError(f"event {seq} is impossible: event {source} has no experiment")

    def close(self) -> None:
        """Close the file and remove its write-ahead log."""
        with self._lock:
            self._connection.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
