"""Where experiments come from: each Finished brings one, or names the event that did."""

import sqlite3

from prefcal_env.errors import StudyError
from prefcal_env.experiment import Experiment

from .events import Event, Finished


def check_source(
    connection: sqlite3.Connection, seq: int, event: Event, experiment: Experiment | None
) -> None:
    """Check the experiment of an event that is to be appended as number `seq`.

    Raises:
        StudyError: a Finished without an experiment, an experiment with another event, or an
            experiment that is to be the same as one that is not there.
    """
    source = event.same_as if isinstance(event, Finished) else None
    if isinstance(event, Finished) != ((experiment is None) != (source is None)):
        raise StudyError(
            f"event {seq} is impossible: a Finished brings an experiment or names the event "
            "that brought it, and no other event does"
        )
    if source is None:
        return
    brought = "SELECT 1 FROM event WHERE seq = ? AND payload IS NOT NULL"
    if connection.execute(brought, (source,)).fetchone() is None:
        raise StudyError(f"event {seq} is impossible: event {source} brought no experiment")
