"""The errors that prefcal raises: all are a caller's mistake, and say what was expected.

What happens in an experiment (unstable, QP unsolved, stopped) is data, never an error.
"""


class PrefcalError(Exception):
    """Base of every error that prefcal raises."""


class KnobError(PrefcalError, ValueError):
    """A knob or a knob space is defined wrongly, or θ does not fit it."""


class PreferenceError(PrefcalError, ValueError):
    """An answer is neither a preference nor an abstention."""


class ProtocolError(PrefcalError, RuntimeError):
    """An agent was used out of order: a stale query, or a question after the end."""


class SettingsError(PrefcalError, ValueError):
    """An agent, a controller or a calibrator is configured with an impossible value."""


class ExperimentError(PrefcalError, ValueError):
    """An experiment's arrays do not fit each other or its channels."""


class PlantError(PrefcalError, ValueError):
    """A plant is defined wrongly, or was given a state or input of the wrong shape."""


class QPError(PrefcalError, ValueError):
    """A quadratic program is malformed: wrong shapes, NaN, crossed bounds, not convex."""


class ScenarioError(PrefcalError, ValueError):
    """A scenario or one of its options does not exist."""


class StudyError(PrefcalError, RuntimeError):
    """A study file cannot be read or written, or does not fit; nothing was recorded."""


class StaleError(ProtocolError):
    """Somebody was late: the question, the answer or the wait is over; nothing was recorded."""


class RecordError(PrefcalError, ValueError):
    """The record of a run on a rig is refused; the message lists what is wrong with it."""


class MissingExtraError(PrefcalError, ImportError):
    """An optional dependency is not installed; the message says how to get it."""


class BenchmarkError(PrefcalError, RuntimeError):
    """A benchmark cannot go on: its folder of results or its cluster is not usable."""


class RunError(PrefcalError, RuntimeError):
    """A run of a user's own scenario gave no experiment. It is data: the study goes on.

    Args:
        words: What happened, for people.
        why: "raised": their code raised an error; "died": its process ended; "late": it took
            longer than it may; "stopped": a person stopped it; "given up": nobody waits for it.
        trace: The traceback of their code; empty if there is none.
    """

    def __init__(self, words: str, why: str, trace: str = "") -> None:
        super().__init__(words)
        self.why, self.trace = why, trace
