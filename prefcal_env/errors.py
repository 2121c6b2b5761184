"""Errors that prefcal raises. All are mistakes of the caller, and say what was expected.

What happens in an experiment (unstable, QP unsolved, stopped) is data, never an error.
"""

from typing import Any


class PrefcalError(Exception):
    """Base class of every error that prefcal raises."""


class KnobError(PrefcalError, ValueError):
    """A knob or a knob space is not valid, or θ does not fit it."""


class PreferenceError(PrefcalError, ValueError):
    """An answer is neither a preference nor an abstention."""


class ProtocolError(PrefcalError, RuntimeError):
    """An agent was used out of order: a stale query, or a question after the end."""


class SettingsError(PrefcalError, ValueError):
    """An agent, a controller or a calibrator is configured with an impossible value."""


class SimulationError(PrefcalError, ValueError):
    """A function given as `simulate` works for no θ, or returns something else than KPIs."""


class ExperimentError(PrefcalError, ValueError):
    """An experiment's arrays do not fit each other or its channels."""


class PlantError(PrefcalError, ValueError):
    """A plant is not valid, or received a state or input of the wrong shape."""


class QPError(PrefcalError, ValueError):
    """A quadratic program is malformed: wrong shapes, NaN, crossed bounds, not convex."""


class ScenarioError(PrefcalError, ValueError):
    """A scenario or one of its options does not exist."""


class StudyError(PrefcalError, RuntimeError):
    """A study file cannot be read or written, or does not fit; nothing was recorded."""


class StaleError(ProtocolError):
    """A question, an answer or a wait is already over; nothing was recorded."""


class RecordError(PrefcalError, ValueError):
    """A record of a run on a rig is not valid; the message lists what is wrong with it."""


class LiveError(PrefcalError, RuntimeError):
    """A live plant is described wrongly, cannot be reached, or refuses a value."""


class ConnectionLostError(LiveError):
    """The connection to a live plant is lost; it may come back."""


class MissingExtraError(PrefcalError, ImportError):
    """An optional dependency is not installed; the message says how to install it."""


class BenchmarkError(PrefcalError, RuntimeError):
    """A benchmark cannot continue: its results folder or its workers are not usable."""


class RunError(PrefcalError, RuntimeError):
    """A run of a user's own scenario produced no experiment. This is data: the study continues.

    Args:
        words: Message for people that says what happened.
        why: "raised" if their code raised an error, "died" if its process ended, "late" if it
            took too long, "stopped" if a person stopped it, "given up" if it is no longer needed.
        trace: Traceback of their code; empty if there is none.
    """

    def __init__(self, words: str, why: str, trace: str = "") -> None:
        super().__init__(words)
        self.why, self.trace = why, trace

    def __reduce__(self) -> tuple[Any, ...]:  # it travels between processes
        return type(self), (str(self), self.why, self.trace)
