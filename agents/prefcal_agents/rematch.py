"""Which two samples to compare when the answers leave open who is the best."""

from prefcal_env.champions import contradictory, reigns, representative, undominated
from prefcal_env.preference import Preference

from .ledger import Ledger

FINALS = 3
"""Most questions after the last experiment."""


def rematch(ledger: Ledger) -> tuple[int, int] | None:
    """Return the best sample and one that never lost to it either; None where there is none.

    As long as every new sample meets the best, only one stays unbeaten. A retraction or "can't
    tell" may leave two: the next question compares them. A pair that cannot be told apart is not
    asked again; one whose answer was taken back is.

    Returns:
        The later and the earlier sample of the pair.
    """
    best, verdicts = ledger.incumbent, ledger.verdicts()
    if best is None:
        return None
    for group in undominated(verdicts, ledger.unsafe()):
        rival = representative(verdicts, group)
        if best not in group and not ledger.asked(best, rival, standing=True):
            return max(best, rival), min(best, rival)
    return None


def final(ledger: Ledger) -> tuple[int, int] | None:
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
    verdicts, best = ledger.verdicts(), ledger.incumbent
    asked = sum(c.after == ledger.answered for c in ledger.further)
    ties = any(v.preference is Preference.TIE for v in verdicts)
    if best is None or asked >= FINALS or not (ties or contradictory(verdicts)):
        return None
    for former in dict.fromkeys(reigns(verdicts)):
        if former != best and not ledger.asked(best, former):
            return max(best, former), min(best, former)
    return None
