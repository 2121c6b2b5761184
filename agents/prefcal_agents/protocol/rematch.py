"""Which two samples to compare when the answers leave open who is the best."""

from prefcal_agents.history.history import History
from prefcal_env.preferences.answer import Preference
from prefcal_env.preferences.best import contradictory, reigns, representative, undominated

FINALS = 3
"""Most questions after the last experiment."""


def rematch(history: History) -> tuple[int, int] | None:
    """Return the best sample and one that never lost to it either; None where there is none.

    As long as every new sample meets the best, only one stays unbeaten. A retraction or "can't
    tell" may leave two: the next question compares them. A pair that cannot be told apart is not
    asked again; one whose answer was taken back is.

    Returns:
        The later and the earlier sample of the pair.
    """
    best, verdicts = history.incumbent, history.verdicts()
    if best is None:
        return None
    for group in undominated(verdicts, history.unsafe()):
        rival = representative(verdicts, group)
        if best not in group and not history.asked(best, rival, standing=True):
            return max(best, rival), min(best, rival)
    return None


def final(history: History) -> tuple[int, int] | None:
    """Return the best sample and a former best for a last comparison; None where none is due.

    People who call two experiments about the same have a threshold, and steps below it add up:
    each new best may be a little worse in what counts most. So after the last experiment the best
    meets up to three former ones that it has not met, the earliest first. Someone who never
    said "about the same" and never contradicted themselves is not asked.

    Source: none.
    Deviation: the paper compares each experiment with the best so far only.

    Returns:
        The later and the earlier sample of the pair.
    """
    verdicts, best = history.verdicts(), history.incumbent
    asked = sum(c.after == history.answered for c in history.further)
    ties = any(v.preference is Preference.TIE for v in verdicts)
    if best is None or asked >= FINALS or not (ties or contradictory(verdicts)):
        return None
    for former in dict.fromkeys(reigns(verdicts)):
        if former != best and not history.asked(best, former):
            return max(best, former), min(best, former)
    return None
