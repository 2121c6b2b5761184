"""Let the agent choose queries in the background: it may simulate for seconds, without a lock.

Its functions return an `Attempt`, as the work of `runs` is.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import cast

import numpy as np
from jaxtyping import Float

from prefcal_agents.protocol.agent import Agent
from prefcal_agents.screening.agent import Screening
from prefcal_app.simulating import Abandoned, Basis, Carried

from .flow import Flow
from .study.now import Phase, Question
from .volatile.thoughts import LIKELIEST, LIKELY
from .volatile.underway import Attempt


def think(flow: Flow) -> Attempt:
    """Choose the next query, then show it or run its experiment.

    A copy of the agent does it, since the person may undo or retract an answer meanwhile.
    """
    history, twin = flow.agent.history, flow.agent.copy()
    flow.thoughts.about = history
    flow.thoughts.resume()

    def choose() -> Callable[[], None]:
        try:
            basis = _basis(flow, twin)
        except Abandoned:
            return lambda: None

        def keep() -> None:
            flow.thoughts.about = None
            if flow.agent.history == history and flow.phase is Phase.RUNNING:
                flow.thoughts.basis = basis or flow.thoughts.basis
                # A question that was already open, before a restart, stays open under its id.
                flow.resume()

        return keep

    return choose


def look_ahead(
    flow: Flow, asked: Question, is_known: Callable[[Float[np.ndarray, " n"]], bool]
) -> Attempt | None:
    """Tell a copy of the agent the next likely answer; None if all were tried.

    Errors are ignored here, since that answer may never be given. If it is, the same work is done
    again, and an error is shown.

    Args:
        flow: Flow of the interview.
        asked: Open question.
        is_known: Function that tells whether a physical θ, shape (n,), has run.
    """
    most = len(LIKELY) if flow.thoughts.simulator is None else LIKELIEST
    answer = flow.thoughts.prefetch.missing(asked, most)
    if answer is None:
        return None
    query, twin = flow.agent.ask(), flow.agent.copy()
    flow.thoughts.prefetch.busy = answer
    flow.thoughts.resume()

    def look() -> Callable[[], None]:
        try:
            twin.tell(query, answer)
            told = twin.history
            basis = _basis(flow, twin)
            theta = None if twin.done else twin.ask().challenger.theta
        except Exception:
            return lambda: _rest(flow)

        def keep() -> None:
            _rest(flow)
            if flow.question is asked:
                flow.thoughts.prefetch.keep_basis(answer, basis)
                if theta is not None and not is_known(theta):
                    flow.thoughts.prefetch.next = theta
            elif (
                flow.phase is Phase.RUNNING
                and flow.agent.history.pending is None
                and flow.agent.history == told
            ):
                # The answer came meanwhile, and it is this one.
                flow.thoughts.basis = basis or flow.thoughts.basis
                flow.proceed()

        return keep

    return look


def is_unexplained(flow: Flow) -> bool:
    """Return whether it is not known what the open question was chosen from.

    That is so after a restart, after the last answer, and if the person asked for a θ.
    """
    thoughts = flow.thoughts
    unknown = thoughts.simulator is not None and thoughts.grounds(flow.agent) is None
    return unknown and not thoughts.prefetch.explained


def explain(flow: Flow) -> Attempt:
    """Find out what the open question was chosen from. Errors are ignored: it can be answered."""
    flow.thoughts.prefetch.explained = True
    return _looking(flow, lambda twin: Basis.of(twin))


def is_untold(flow: Flow) -> bool:
    """Return whether it is not worked out what the answer can change or, at the end, what was wanted."""
    known = flow.thoughts.grounds(flow.agent)
    if known is None or flow.thoughts.prefetch.told:
        return False
    carried, over = known.carried, flow.phase is Phase.OVER
    return carried is None or not carried.complete or carried.over is not over


def tell(flow: Flow) -> Attempt:
    """Work out what the answer can change or, at the end, what was wanted; nothing after an error."""
    known, over = flow.thoughts.grounds(flow.agent), flow.phase is Phase.OVER
    assert known is not None
    carried = None if known.carried is None or known.carried.over is not over else known.carried
    flow.thoughts.prefetch.told = not over or carried is not None  # else the smaller change comes next

    def told(twin: Screening) -> Basis:
        try:
            return known.completed(twin) if carried else replace(known, carried=Carried.of(twin, over=over))
        except Exception:
            failed = carried or Carried(over, None, None, {}, {})
            return replace(known, carried=replace(failed, complete=True))

    return _looking(flow, told)


def _looking(flow: Flow, look: Callable[[Screening], Basis]) -> Attempt:
    """Look at a copy of the agent; keep what is found if the question is still the same."""
    asked, twin = flow.question, cast(Screening, flow.agent.copy())
    flow.thoughts.resume()

    def advance() -> Callable[[], None]:
        try:
            basis = look(twin)
        except Exception:
            return lambda: None

        def keep() -> None:
            if flow.question is asked:
                flow.thoughts.basis = basis
                flow.version += 1

        return keep

    return advance


def _rest(flow: Flow) -> None:
    flow.thoughts.prefetch.busy = None


def _basis(flow: Flow, twin: Agent) -> Basis | None:
    """Let `twin` choose its next query; return what it was chosen from, if it simulates.

    A question can be answered without its reason, so no error of that is raised; one of the
    simulations is.
    """
    if twin.done:
        return None
    twin.ask()
    if flow.thoughts.simulator is None:
        return None
    screening = cast(Screening, twin)
    _ = screening.bank
    try:
        return Basis.of(screening)
    except Abandoned:
        raise
    except Exception:
        return None
