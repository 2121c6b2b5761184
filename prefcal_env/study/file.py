"""Store a study in an SQLite file, to which events are appended durably and never changed."""

import os
import sqlite3
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, closing, suppress
from pathlib import Path
from types import MappingProxyType
from typing import Any, Self

import numpy as np
from jaxtyping import Float

from prefcal_env.disk import synchronize
from prefcal_env.errors import StudyError
from prefcal_env.experiments.experiment import End, Experiment
from prefcal_env.knobs.key import theta_key

from . import connection as disk
from . import schema
from .codec import LONGEST_HEADER, decode, encode, end_of, pack, unpack
from .connection import open_elsewhere, told
from .events import Created, Event, Finished, Recorded
from .fold import State, begin, step
from .locations import data_folder, make_data_folder
from .tables import frame_of, html_of

Entry = Event | tuple[Finished, Experiment]
Rows = list[tuple[Recorded, Experiment | None]]
Clock = Callable[[], str]
_OVERWRITTEN = (sqlite3.SQLITE_ERROR, sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB)
"""What SQLite says of a file that something else was written to, with or without its tables."""
_DAMAGED = "It is damaged: nothing was changed; use an earlier copy or an export"


_UNBEGUN = State(MappingProxyType({}), "", 0)
"""State before the first event."""


class StudyFile:
    """Open study, made by `create` or `open`. Methods can be called from any thread.

    An event is on the disk, in the study's own file, when `append` returns. The file is locked
    until `close`: others can read it, but not write to it.
    """

    def __init__(self, connection: sqlite3.Connection, path: str, clock: Clock) -> None:
        self._connection, self.path, self._clock = connection, path, clock
        self._lock = threading.RLock()
        self._last = 0  # number of the last event
        self._checksum = 0  # of the last event
        self._address = os.path.abspath(path)  # the working folder may change
        self._place: tuple[int, int] | None = None  # device and inode; None if only read
        self._content = b""  # of the file, should others remove or overwrite it
        self._saved: tuple[int, Path] | None = None  # number of the last event, and the copy
        self.state = _UNBEGUN
        """State of the study after all events."""
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
        if path == ":memory:":
            file = cls(disk.connect(":memory:"), ":memory:", clock)
            file._begin(created)
            return file
        target = disk.vacant(path)
        with (
            told(target, "begin", "Nothing was recorded"),
            disk.complete_file(target) as part,
            closing(disk.connect(part)) as connection,
        ):
            cls(connection, str(part), clock)._begin(created)
        return cls.open(target, clock=clock)

    @classmethod
    def open(cls, path: Path | str, *, clock: Clock, reading: bool = False) -> Self:
        """Open the study at `path`.

        Args:
            path: Existing file.
            clock: Function that returns the time of an event as text.
            reading: Whether nothing will be appended: this works while another process has the
                study open.

        Raises:
            StudyError: If there is none, it is damaged, not a study, or of another format, or
                another process has it open, too.
        """
        with told(disk.existing(path), "open"), ExitStack() as undo:
            connection = disk.connect(path)
            undo.callback(connection.close)
            schema.check(connection, str(path))
            if different := schema.differences(connection):
                raise StudyError(f"{different[0]!r} of {path} is not as created. {_DAMAGED}")
            file = cls(connection, str(path), clock)
            undo.callback(file.close)
            if not reading:
                file._claim()
            file._load()
            if not reading:
                file._content = connection.serialize()
            undo.pop_all()  # it stays open
        return file

    def _claim(self) -> None:
        """Lock the file for this process until it is closed, for all but readers."""
        connection = self._connection
        connection.execute("PRAGMA busy_timeout = 500")
        try:
            # Not a log that outlives a crash and holds what is missing in the file itself.
            connection.execute("PRAGMA journal_mode = DELETE")
            connection.execute("BEGIN IMMEDIATE")
        except sqlite3.OperationalError as error:
            if error.sqlite_errorcode & 0xFF == sqlite3.SQLITE_BUSY:
                raise open_elsewhere(self.path) from error
            raise
        connection.execute("PRAGMA busy_timeout = 5000")
        self._place = disk.place_of(self.path)
        disk.WRITTEN_HERE.add(self._place)

    def _begin(self, created: Created) -> None:
        schema.create(self._connection)
        recorded = Recorded(1, self._clock(), created)
        self._insert([(recorded, None)])
        self._take(created, begin(1, recorded.at, created))
        self._connection.execute("COMMIT")

    def _load(self) -> None:
        for recorded, checksum in self._recorded():
            seq, at, event = recorded.seq, recorded.at, recorded.event
            unbegun = self.state is _UNBEGUN
            self._take(event, begin(seq, at, event) if unbegun else step(self.state, seq, at, event))
            self._last, self._checksum = seq, checksum
        if not self._last:
            raise StudyError(f"there are no events in {self.path}. {_DAMAGED}")

    def _recorded(self) -> Iterator[tuple[Recorded, int]]:
        with self._lock, told(self.path, "read"):
            rows = schema.events(self._connection)
        try:
            yield from schema.recorded(rows)
        except StudyError as error:
            raise StudyError(f"{self.path}: {error}. {_DAMAGED}") from error

    def _take(self, event: Event, state: State) -> None:
        """Take over the state after an event."""
        self.state = state
        if isinstance(event, Finished):
            theta = self.state.history.samples[event.index].theta
            self._experiments[theta_key(theta)] = self.state.finished[event.index]

    def events(self) -> Iterator[Recorded]:
        """Yield all events in order, without payloads."""
        for recorded, _ in self._recorded():
            yield recorded

    def experiment(self, seq: int) -> Experiment:
        """Return the experiment of event `seq`. Raises StudyError if it has none."""
        with self._lock, told(self.path, "read"):
            query = "SELECT CAST(payload AS BLOB) FROM event WHERE seq = ?"
            row = self._connection.execute(query, (seq,)).fetchone()
        if row is None or row[0] is None:
            raise StudyError(f"event {seq} of {self.path} has no experiment")
        try:
            return decode(unpack(row[0]))
        except StudyError as error:
            raise StudyError(
                f"event {seq} of {self.path}: {error}. The file is damaged there. Use an earlier "
                "copy, or start a new study with the best θ of this one: `prefcal calibrate ... "
                f"--start {self.path}:best`; `prefcal studies verify` shows what is damaged"
            ) from error

    def end(self, seq: int) -> End:
        """Return how the experiment of event `seq` ended, without reading its trajectory.

        Raises:
            StudyError: If the event has none, or it cannot be read.
        """
        with self._lock, told(self.path, "read"):
            query = "SELECT substr(CAST(payload AS BLOB), 1, ?) FROM event WHERE seq = ?"
            row = self._connection.execute(query, (LONGEST_HEADER, seq)).fetchone()
        found = None if row is None or row[0] is None else end_of(row[0])
        return self.experiment(seq).end if found is None else found

    def to_frame(self, *, answers: bool = False) -> Any:
        """Return the experiments as a pandas DataFrame: θ, KPIs, how each ended, and its marks.

        Args:
            answers: Whether to return the answers instead, one a row.
        """
        return frame_of(self, answers=answers)

    def _repr_html_(self) -> str:
        """Return how far the study is, and its experiments, for notebooks."""
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
                is read-only, or it was moved, removed, replaced or changed since it was opened.
                Nothing is recorded then. The study can still be used once the cause is gone.
        """
        pairs = [e if isinstance(e, tuple) else (e, None) for e in entries]
        with self._lock:
            first = self._last + 1
            rows: Rows = [
                (Recorded(seq, self._clock(), event), experiment)
                for seq, (event, experiment) in enumerate(pairs, start=first)
            ]
            states = [self.state]
            for r, _ in rows:
                states.append(step(states[-1], r.seq, r.at, r.event))
            try:
                with told(self.path, "write to", "Nothing was recorded"):
                    self._write(rows)
            finally:
                if self._last >= first:  # recorded, also if Ctrl-C came right after that
                    for (r, _), state in zip(rows, states[1:], strict=True):
                        self._take(r.event, state)
                    if self._place is not None:
                        self._content = self._connection.serialize()
        return tuple(r.seq for r, _ in rows)

    def _write(self, rows: Rows) -> None:
        try:
            self._check_file()
            self._record(rows)
        finally:
            self._hold()

    def _record(self, rows: Rows) -> None:
        before = self._last, self._checksum
        try:
            self._insert(rows)
            self._connection.execute("COMMIT")
        except BaseException as error:  # Ctrl-C too: either all of it is recorded, or nothing
            after, (self._last, self._checksum) = (self._last, self._checksum), before
            if not self._has_recorded(after):
                raise
            if isinstance(error, sqlite3.Error):
                return self._confirm(after)
            self._last, self._checksum = after
            raise

    def _has_recorded(self, after: tuple[int, int]) -> bool:
        """Return whether a step that raised an error is in the file all the same."""
        try:
            if self._connection.in_transaction:
                self._connection.execute("ROLLBACK")
            return after[0] > self._last and self._tail() == after
        except sqlite3.Error:
            return False

    def _confirm(self, after: tuple[int, int]) -> None:
        """Write the folder to the disk, which failed at the end of a step."""
        try:
            synchronize(Path(os.path.realpath(self.path)).parent)
        except OSError as error:
            raise StudyError(
                f"the disk does not confirm that the last step is recorded in {self.path}: close "
                "prefcal, and open the study again to see whether it is"
            ) from error
        self._last, self._checksum = after

    @property
    def in_place(self) -> bool:
        """Return whether the file is still where it was opened."""
        return self.path == ":memory:" or disk.place_of(self._address) == self._place

    def trouble(self) -> str | None:
        """Return why the file no longer holds everything that was recorded; None if it does.

        If it was moved, removed, replaced or overwritten, a copy is saved elsewhere.
        """
        try:
            with self._lock, told(self.path, "read"):
                try:
                    self._check_file()
                finally:
                    self._hold()
        except StudyError as error:
            return str(error)
        return None

    def _check_file(self) -> None:
        """Lock the file anew, and check that it is the one that was opened and ends as it should.

        Raises:
            StudyError: If it is not, or was opened for reading.
        """
        if self.path != ":memory:":
            if self._place is None:
                raise StudyError(f"the study {self.path} was opened for reading only")
            if not self.in_place:
                raise StudyError(self._lost("moved, renamed, removed or replaced", "Move it back"))
            disk.refuse_foreign_logs(self._address)
        try:
            same = self._is_as_recorded()
        except sqlite3.DatabaseError as error:
            if error.sqlite_errorcode & 0xFF not in _OVERWRITTEN:
                raise
            same = False
        if not same:
            raise StudyError(self._lost("changed by another program", "Restore it"))

    def _is_as_recorded(self) -> bool:
        """Lock the file anew; return whether it has the layout and the last event of this study."""
        connection = self._connection
        if connection.in_transaction and self._place is not None:
            connection.execute("ROLLBACK")
            connection.execute("PRAGMA shrink_memory")  # what others wrote is read from the disk
        if not connection.in_transaction:
            connection.execute("BEGIN IMMEDIATE")
        return not schema.differences(connection) and self._tail() == (self._last, self._checksum)

    def _tail(self) -> Any:
        """Return number and checksum of the last event in the file; None if there is none."""
        query = "SELECT seq, checksum FROM event ORDER BY seq DESC LIMIT 1"
        return self._connection.execute(query).fetchone()

    def _hold(self) -> None:
        """Lock the file until the next step, so that no other process can write to it."""
        if self._place is not None and not self._connection.in_transaction:
            with suppress(sqlite3.Error):  # the next step tries again, and tells what is wrong
                self._connection.execute("BEGIN IMMEDIATE")

    def _lost(self, what: str, remedy: str) -> str:
        """Save a copy elsewhere; return what happened and what to do."""
        lost = f"the study {self.path} was {what} while it was open. Nothing was recorded since."
        place = Path(self._address)
        for target in (place, data_folder() / place.name):
            with suppress(OSError, sqlite3.Error, StudyError):
                if self._saved is None or self._saved[0] != self._last:
                    make_data_folder(target)
                    self._saved = self._last, disk.save_copy(self._content, target)
                return (
                    f"{lost} {remedy} and try again, or close prefcal and continue with a copy of "
                    f"everything before: --study {self._saved[1]}"
                )
        return f"{lost} {remedy}: it could not be saved elsewhere"

    def _insert(self, rows: Rows) -> None:
        """Insert events with their experiments, inside a transaction."""
        for recorded, experiment in rows:
            has_payload = experiment is not None
            schema.check_experiment(recorded.seq, recorded.event, has_payload, self._payloads)
            payload = None if experiment is None else pack(encode(experiment))
            self._checksum = schema.insert(self._connection, recorded, payload, self._checksum)
            self._last = recorded.seq

    def _payloads(self, seq: int) -> bool:
        query = "SELECT 1 FROM event WHERE seq = ? AND payload IS NOT NULL"
        return self._connection.execute(query, (seq,)).fetchone() is not None

    def close(self) -> None:
        """Close the file and release its lock."""
        with self._lock:
            self._connection.close()
            disk.WRITTEN_HERE.discard(self._place)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
