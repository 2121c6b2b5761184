"""Studies for tests: driven in memory by one loop, or kept in a file."""

import sqlite3
from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from prefcal_env.experiments.experiment import Channel, Channels, End, Experiment
from prefcal_env.preferences.answer import Answer, Mark, Query
from prefcal_env.study import Answered, Finished, Shown, State, StudyFile, Suggested, study_path
from support.interviews import clock

Theta = np.ndarray
Prefer = Callable[[Theta, Theta], Any]

CONFIGURATION: dict[str, Any] = {
    "n_max": 9,
    "seed": 0,
    "name": "toy",
    "title": "Toy",
    "knobs": [{"name": "gain", "low": 0.0, "high": 1.0, "unit": "m/%", "scale": "linear", "integer": False}],
    "kpis": [{"name": "late", "title": "late", "unit": "s"}],
}
CHANNELS = Channels(
    x=(Channel("level", "m", high=3.0, target=2.0, band=0.1),),
    u=(Channel("valve", "%"),),
    y=(Channel("level", "m"),),
    time_unit="s",
)


def by(cost: Callable[[Theta], float]) -> Prefer:
    """Return the answers of someone who compares two θ by `cost`, and never errs."""
    return lambda new, old: int(np.sign(cost(new) - cost(old)))


def drive(
    agent: Any,
    prefer: Prefer,
    count: int | None = None,
    *,
    kpis: Callable[[Theta], Mapping[str, float] | None] | None = None,
    wrong: Callable[[Query], bool] = lambda query: False,
    unsafe: Callable[[Theta], bool] = lambda theta: False,
) -> list[Query]:
    """Answer `count` queries of `agent`, or all that are left; return them.

    Args:
        agent: A preference-based agent; changed by this.
        prefer: Answer about two θ, the challenger's first; not asked about the first experiment.
        count: Number of answers; None: until the agent is done.
        kpis: KPIs of a θ, told with every answer.
        wrong: Whether the answer to a query is turned around.
        unsafe: Whether a θ is marked unsafe.
    """
    asked: list[Query] = []
    while not agent.done and (count is None or len(asked) < count):
        query = agent.ask()
        sides = [None if s is None else s.theta for s in (query.challenger, query.incumbent)]
        given = None if sides[1] is None else prefer(*sides)
        if given and wrong(query):
            given = -given
        answer = Answer.of(given)
        found = (Mark.CHALLENGER_UNSAFE, Mark.INCUMBENT_UNSAFE)
        marks = [m for m, s in zip(found, sides, strict=True) if s is not None and unsafe(s)]
        if kpis is not None:
            answer = replace(answer, outcomes=tuple(s if s is None else kpis(s) for s in sides))
        agent.tell(query, replace(answer, marks=tuple(marks)))
        asked.append(query)
    return asked


def state_of(study: Path | str) -> State:
    """Return the state of a study, by its name or its file."""
    with StudyFile.open(study_path(str(study)), clock=clock(), reading=True) as file:
        return file.state


def experiment(theta: float, count: int = 4, **changes: Any) -> Experiment:
    """A small experiment of one knob with `count` instants."""
    t = np.arange(count, dtype=float)
    given: dict[str, Any] = {
        "theta": np.array([theta]),
        "t": t,
        "x": theta + t[:, None],
        "u": t[:, None] / 3,
        "t_control": t,
        "u_control": t[:, None],
        "y_ref": np.full((count, 1), 2.0),
        "iterations": np.arange(count),
        "solve_time": t / 1000,
        "solved": t > 0,
        "channels": CHANNELS,
        "end": End.TIME_UP,
        "kpis": {"late": np.inf, "sum": float(theta)},
    }
    return Experiment(**{**given, **changes})


def compared(file: StudyFile, index: int, preference: int | None = -1) -> None:
    """Append sample `index`, its experiment, and (from 1 on) a question and its answer."""
    theta = 0.05 + 0.1 * index
    file.append(Suggested(index, (theta,), (theta,)), (Finished(index), experiment(theta)))
    if index == 0:
        file.append(Answered(None, 0, None, Answer(None)))
        return
    best = 0
    for closed in file.state.history.comparisons:
        if closed.answer.preference == -1 and not closed.retracted:
            best = closed.challenger
    (shown,) = file.append(Shown(index, best, bool(index % 2)))
    file.append(Answered(shown, index, best, Answer(preference), f"answer {index}"))


def small_study(path: Path | str, answers: int = 3, now: Callable[[], str] | None = None) -> StudyFile:
    """An open study with some answers."""
    file = StudyFile.create(path, CONFIGURATION, clock=now or clock())
    for index in range(answers + 1):
        compared(file, index, (None, -1, 0, 1)[index % 4])
    return file


def tamper(path: Path, script: str, *, signed: bool = False) -> int:
    """Change a study file without a trace in its tables and triggers; return the changed rows.

    Args:
        path: Study file.
        script: Statements of SQL.
        signed: Whether to make the checksums fit, as only somebody who wants to deceive does.
    """
    with closing(sqlite3.connect(path)) as connection:
        query = "SELECT name, sql FROM sqlite_master WHERE type = 'trigger' ORDER BY rowid"
        triggers = connection.execute(query).fetchall()
        for name, _ in triggers:
            connection.execute(f"DROP TRIGGER {name}")
        connection.executescript(script)
        changed = connection.total_changes
        before = 0
        query = "SELECT seq, at, body, length(payload) FROM event ORDER BY seq"
        for seq, at, body, size in connection.execute(query).fetchall() if signed else ():
            before = crc32(f"{seq}\n{at}\n{-1 if size is None else size}\n{body}".encode(), before)
            connection.execute("UPDATE event SET checksum = ? WHERE seq = ?", (before, seq))
        for _, sql in triggers:
            connection.execute(sql)
        connection.commit()
    return changed
