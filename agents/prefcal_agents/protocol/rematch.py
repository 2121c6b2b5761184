"""Choose which two samples to compare when the answers leave open which one is best."""

from prefcal_env.preferences.answer import Preference
from prefcal_env.preferences.best import contradictory, reigns, representative, undominated
from prefcal_env.preferences.history import History

FINALS = 3
"""Maximum number of questions after the last experiment."""


def rematch(history: History) -> tuple[int, int] | None:
    """Return the best sample and another unbeaten one; None if there is no other.

    As long as every new sample is compared with the best, only one stays unbeaten. A retraction or
    "can't tell" can leave two, which the next question then compares. A pair that the person
    cannot tell apart is not asked again; a pair whose answer was retracted is.

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
    """Return the best sample and a former best for a final comparison; None if none is needed.

    People who call two experiments "about the same" have a threshold, and differences below it add
    up: each new best may be slightly worse in what matters most. So after the last experiment, the
    best is compared with up to three former bests, earliest first, that it was not compared with
    yet. People who never said "about the same" and never contradicted themselves are not asked.

    Source: none.
    Deviation: the paper compares each experiment with the best so far only.

    Returns:
        The later and the earlier sample of the pair.
    """
    verdicts, best = history.verdicts(), history.incumbent
    asked = sum(c.after == history.answered for c in history.follow_ups)
    ties = any(v.preference is Preference.TIE for v in verdicts)
    if best is None or asked >= FINALS or not (ties or contradictory(verdicts)):
        return None
    for former in dict.fromkeys(reigns(verdicts)):
        if former != best and not history.asked(best, former):
            return max(best, former), min(best, former)
    return None
