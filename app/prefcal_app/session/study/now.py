"""Define what a front end sees of an interview at one moment, as frozen data."""

from dataclasses import dataclass
from enum import Enum

from prefcal_app.simulating import Simulated
from prefcal_env.compiling import Compiling
from prefcal_env.sources.run import Change, LiveCurve, Progress
from prefcal_env.study import State, Suggested

from .question import Question


class Phase(Enum):
    """What a study waits for."""

    RUNNING = "running"
    """A proposal is being computed or an experiment is being run."""
    RECORD = "record"
    """The person must run the experiment and provide its record."""
    CONFIRM = "confirm"
    """The person must confirm what is written to a live plant."""
    FAILED = "failed"
    """The run raised an error, or the study file could not be written."""
    QUESTION = "question"
    """The person must answer the open question."""
    OVER = "over"
    """The study has ended: all is compared, one is good enough, or the person finished it."""


class Recovery(Enum):
    """Whether the plant has its old values again, which an interrupted run may have changed."""

    DUE = "due"
    RUNNING = "running"
    FAILED = "failed"
    DONE = "done"


@dataclass(frozen=True, slots=True)
class LiveNow:
    """What a front end shows of a plant on which each run must be confirmed.

    Args:
        changes: What a run would write, for the person to confirm; None while it is not known.
        problem: Why it is not known, or what remains to be done on the plant; empty if all is well.
        progress: How far the run is; None if none is in progress.
        times: Instants recorded so far, in seconds.
        curves: Outputs recorded so far.
        stopping: Whether the run was told to stop.
        recovery: Whether the plant has its old values again. If that failed, `problem` says why,
            and nothing is written until it succeeds.
    """

    changes: tuple[Change, ...] | None
    problem: str
    progress: Progress | None
    times: tuple[float, ...]
    curves: tuple[LiveCurve, ...]
    stopping: bool
    recovery: Recovery = Recovery.DONE


@dataclass(frozen=True, slots=True)
class Now:
    """Consistent view of an interview.

    Args:
        version: Number that grows with every change.
        phase: What the interview waits for.
        question: Open question, in phase QUESTION.
        problem: Description of the problem, in phase FAILED.
        pending: Sample that is running, awaited or failed; None while it is being proposed.
        incumbent: Index of the best experiment so far; None before the first.
        can: Names of the steps that the person can take.
        state: State of the study file.
        draft: Comment of the answer that was just undone.
        preparing: Part that is being compiled before the first experiment; None when done.
        run_limit: Time limit of a run in seconds; None if it has none.
        simulated: Numbers of what was simulated unseen; None if the agent simulates nothing.
        live: What is known of the live plant; None if the scenario has none.
        running: Number of experiments that are running, if several can; 0 if one runs at a time.
    """

    version: int
    phase: Phase
    question: Question | None
    problem: str | None
    pending: Suggested | None
    incumbent: int | None
    can: frozenset[str]
    state: State
    draft: str = ""
    preparing: Compiling | None = None
    run_limit: float | None = None
    simulated: Simulated | None = None
    live: LiveNow | None = None
    running: int = 0
