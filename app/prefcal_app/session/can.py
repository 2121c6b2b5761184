"""Say which steps a person can take now, and why not the others; no screen decides it."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

from prefcal_agents import GLISp
from prefcal_env.errors import PrefcalError, ScenarioError, SettingsError, StaleError

from .flow import Flow
from .study.now import Phase, Recovery
from .study.study import Study, to_repeat

CLOSED = "this question is no longer open: it was already answered or undone, and nothing was recorded twice"
"""What is said of an answer to another question than the open one."""


def refusal(flow: Flow, step: str) -> PrefcalError | None:
    """Return why `step`, a name of `REFUSALS`, cannot be taken now; None if it can."""
    if step != "stop_run" and flow.underway.moves_plant:
        return StaleError("a run on the plant is in progress: stop it first")
    return REFUSALS[step](flow, flow.study)


def possible(flow: Flow) -> frozenset[str]:
    """Return the names of the steps that can be taken now."""
    steps = ("stop_run",) if flow.underway.moves_plant else REFUSALS
    study = flow.study
    return frozenset(step for step in steps if REFUSALS[step](flow, study) is None)


def _answer(flow: Flow, study: Study) -> PrefcalError | None:
    return StaleError(CLOSED) if flow.question is None else None


def _undo(flow: Flow, study: Study) -> PrefcalError | None:
    if flow.question is not None and flow.question.repeats is not None:
        return None  # a repeated question can always be skipped
    repeats = study.state.history.repeats
    last_was_repeat = bool(repeats) and study.state.answers[-1] is repeats[-1]
    has_one = study.state.history.answered > 1 and not last_was_repeat
    return None if has_one else StaleError("there is no answer to undo")


def _retract(flow: Flow, study: Study) -> PrefcalError | None:
    if flow.phase is Phase.RUNNING and study.must_think:
        return StaleError("the next experiment is being chosen: retract the answer once it is shown")
    if flow.phase is Phase.FAILED and study.must_think:
        # Choosing the next experiment may fail again, after the retraction is written.
        return StaleError("the last step failed: try it again first")
    has_one = study.state.history.answered > 1
    return None if has_one else StaleError("there is no answer to retract")


def _repeat(flow: Flow, study: Study) -> PrefcalError | None:
    has_one = flow.phase is Phase.QUESTION and to_repeat(study.state, study.seed) is not None
    return None if has_one else StaleError("there is no earlier question to ask again now")


def _pace(flow: Flow, study: Study) -> PrefcalError | None:
    if not isinstance(flow.agent, GLISp):
        return SettingsError("only the agent glisp can ask more than one comparison per experiment")
    # Until the retry, the study file and the agent may differ.
    failed = flow.phase is Phase.FAILED
    return StaleError("the last step failed: try it again first") if failed else None


def _ask_for(flow: Flow, study: Study) -> PrefcalError | None:
    over = flow.phase is Phase.OVER
    return StaleError("the study has ended: continue it first") if over else None


def _choose(flow: Flow, study: Study) -> PrefcalError | None:
    if not study.simulates:
        return StaleError("nothing is simulated unseen in this study: continue it and ask for a θ")
    return _go_on(flow, study)


def _record(flow: Flow, study: Study) -> PrefcalError | None:
    if flow.underway.source.asks != "record":
        return StaleError("the plant is simulated and takes no record")
    replaces = flow.phase is Phase.QUESTION and bool(study.state.finished)
    due = flow.phase is Phase.RECORD or replaces
    return None if due else StaleError("no record is waited for: nothing was changed")


def _write_and_start(flow: Flow, study: Study) -> PrefcalError | None:
    if flow.phase is not Phase.CONFIRM:
        return StaleError("no run is to be confirmed: nothing was written")
    underway = flow.underway
    if underway.plant.recovery is Recovery.FAILED:
        return StaleError("the plant does not have its old values yet: nothing was written")
    run = underway.of(study.pending)
    if run is None or run.changes is None or underway.plant.recovery is not Recovery.DONE:
        return StaleError("the plant's present values are not known yet: nothing was written")
    return None


def _stop_run(flow: Flow, study: Study) -> PrefcalError | None:
    source = flow.underway.source
    running = flow.underway.moves_plant if source.asks else flow.phase is Phase.RUNNING
    if not running or study.pending is None:
        return StaleError("this experiment is not running: nothing was changed")
    if source.stops:
        return None
    if source.asks:
        return ScenarioError("this run cannot be stopped from here")
    return ScenarioError("experiments of a built-in scenario run in seconds: wait for this one")


def _fail(flow: Flow, study: Study) -> PrefcalError | None:
    pending = study.pending if flow.phase in (Phase.RECORD, Phase.CONFIRM, Phase.FAILED) else None
    if pending is None:
        return StaleError("no experiment is waited for: nothing was changed")
    if pending.index in study.state.finished:
        # A later step failed, for example on a full disk: this experiment must not be replaced.
        return StaleError(f"experiment {pending.index + 1} is saved, it has not failed: try again")
    return None


def _retry(flow: Flow, study: Study) -> PrefcalError | None:
    on_the_plant = flow.phase is Phase.CONFIRM or flow.underway.plant.recovery is Recovery.FAILED
    failed = flow.phase is Phase.FAILED or on_the_plant
    return None if failed else StaleError("nothing has failed, so there is nothing to try again")


def _finish(flow: Flow, study: Study) -> PrefcalError | None:
    return StaleError("the study has ended already") if flow.phase is Phase.OVER else None


def _go_on(flow: Flow, study: Study) -> PrefcalError | None:
    return None if flow.phase is Phase.OVER else StaleError("the study has not ended")


REFUSALS: Mapping[str, Callable[[Flow, Study], PrefcalError | None]] = MappingProxyType(
    {
        "answer": _answer,
        "give": _answer,
        "mark": _answer,
        "undo": _undo,
        "retract": _retract,
        "repeat": _repeat,
        "pace": _pace,
        "ask_for": _ask_for,
        "choose": _choose,
        "record": _record,
        "write_and_start": _write_and_start,
        "stop_run": _stop_run,
        "fail": _fail,
        "retry": _retry,
        "finish": _finish,
        "go_on": _go_on,
    }
)
"""Functions that say why a step cannot be taken now, by the name of the step."""
