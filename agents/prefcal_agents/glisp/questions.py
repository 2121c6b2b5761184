"""Follow-up questions: which two known samples to compare before the next one is proposed."""

import numpy as np
from jaxtyping import Float, Int

from prefcal_agents.history.lessons import Marks, Preferences, cube_of
from prefcal_agents.models.rbf import Surrogate
from prefcal_env.preferences.answer import Preference
from prefcal_env.preferences.best import contradictory, reigns
from prefcal_env.preferences.history import History

from .selection import Dataset, ModelSelection, Selection, train, trust
from .settings import GLISpSettings

_APART = 10
"""Number of experiments between two questions that are only based on a suspicion."""
_SURE = 2.0
"""A difference of at least this many standard deviations is certain enough not to ask."""
_RIVALS = 9  # samples next to the best, by Ĵ
FINALS = 3
"""Maximum number of questions after the last experiment."""


def follow_up(history: History, models: ModelSelection, settings: GLISpSettings) -> tuple[int, int] | None:
    """Return two known samples to compare now, the challenger first; None if there are none.

    If mistakes are suspected, ask whether the best sample really is the best; once that is
    settled, find the rank of the latest one.

    Source: none.
    Deviation: the paper asks one comparison for each experiment.
    """
    asked, most = len(history.latest), settings.questions_per_experiment
    if asked >= max(most, 2) or history.answered < 3:
        return None
    # As long as no answers contradict each other, additional questions are rare.
    lately = any((c.after or 0) > history.answered - _APART for c in history.follow_ups)
    if asked >= most and lately and not contradictory(history.verdicts()):
        return None
    # As selected one experiment earlier, so a question does not wait for a model selection.
    kpis, before = models.kpi_fit(history), history.until(history.answered - 1)
    if kpis is not None:
        pair = kpis.doubted(history) if settings.error_rate else None
    else:
        data, sure = models.dataset(history), 0.0 if asked >= most else _SURE
        pair = confirm_best(data, models.after(before), settings.error_rate, sure)
    if pair is not None or asked >= most:
        return pair
    if kpis is not None:
        return insertion_question(history, kpis.values(history))
    surrogate = train(models.dataset(history), models.after(before), settings)
    return insertion_question(history, surrogate(cube_of(history)))


def confirm_best(
    data: Dataset, selection: Selection, error_rate: float, sure: float
) -> tuple[int, int] | None:
    """Return the best sample and the one that may be better, if mistakes are suspected; or None.

    The next experiment is compared with the best, so it matters most that it really is the best.
    Of the other samples with the lowest Ĵ, the rival is the one least certain to be worse. A pair
    that was asked before is left out, whatever was answered.

    Source: none; the least certain pair, as in uncertainty sampling.
    Deviation: the paper asks one comparison for each experiment, and takes all answers for right.

    Args:
        data: Samples and answers.
        selection: Selected settings of the models.
        error_rate: Probability that an answer is wrong.
        sure: A rival that is worse by more than this many standard deviations is not asked about;
            with 0, only one that is probably better is.

    Returns:
        The later and the earlier sample of the pair.
    """
    history, best = data.history, data.history.incumbent
    if best is None or selection.noise is None or not selection.noise.suspects:
        return None
    candidates, shape = contenders(history), selection.noise.shape
    posterior = trust(data, selection, error_rate)
    samples = data.preferences.samples
    known = shape.basis(samples, samples)
    features = np.zeros((history.answered, known.shape[1]))
    values = np.full(history.answered, np.inf)
    features[data.kept] = known
    values[data.kept] = Surrogate(samples, posterior.mean, shape)(samples)
    candidates = candidates[np.isfinite(values[candidates])]
    rest = [int(k) for k in candidates[np.argsort(values[candidates], kind="stable")] if k != best]
    rivals = [k for k in rest[:_RIVALS] if not history.asked(best, k)]
    if not rivals:
        return None
    behind = posterior.deviations(features[rivals] - features[best])
    nearest = int(np.argmin(behind))
    if behind[nearest] > sure:
        return None
    return max(best, rivals[nearest]), min(best, rivals[nearest])


def contenders(history: History) -> Int[np.ndarray, " K"]:
    """Return the samples that were compared and are not marked unsafe; all compared if all are.

    Runs that were cut short are left out.
    """
    preferences, marks = Preferences.of(history), Marks.of(history)
    strict = preferences.b != 0
    compared = np.unique(np.concatenate([preferences.first[strict], preferences.second[strict]]))
    samples, unsafe = cube_of(history), marks.samples[marks.unsafe]
    cut = history.cut_short()
    compared = np.array([i for i in compared if i not in cut], dtype=np.int64)
    safe = [i for i in compared if not np.any(np.all(unsafe == samples[i], axis=1))]
    return np.array(safe or compared, dtype=np.int64)


def insertion_question(history: History, values: Float[np.ndarray, " N"]) -> tuple[int, int] | None:
    """Return the latest sample and the one to compare it with; None once its place is known.

    A sample that lost against the best is somewhere below it. Bisection finds where with few
    answers: in the order of Ĵ, the next rival is the middle one of those that it may lie between.
    After a win, a tie or an abstention, no further question is needed.

    Source: none.
    Deviation: the paper asks one comparison for each experiment.

    Args:
        history: Samples and answers.
        values: Ĵ at the N samples that are answered, lower is better.
    """
    new = history.answered - 1
    latest = [c for c in history.latest if c.challenger == new]  # others may be about the best
    if not latest or not all(c.teaches for c in latest):
        return None
    asked = {c.incumbent for c in latest}
    left_out = history.cut_short() - asked  # half a run cannot be compared with a whole one
    if new in left_out:
        return None
    order = [int(i) for i in np.argsort(values, kind="stable") if i not in {new, *left_out}]
    above, below = -1, len(order)  # positions of the worst better one and of the best worse one
    for c in latest:
        assert c.incumbent is not None  # it teaches
        position = order.index(c.incumbent)
        if c.answer.preference is Preference.INCUMBENT:
            above = max(above, position)
        elif c.answer.preference is Preference.CHALLENGER and c.after is not None:
            below = min(below, position)
        else:
            return None
    between = order[above + 1 : below]
    if not between or not asked.isdisjoint(between):
        return None
    return new, between[len(between) // 2]


def final_question(history: History) -> tuple[int, int] | None:
    """Return the best sample and a former best for a final comparison; None if none is needed.

    People who call two experiments "about the same" have a threshold, and differences below it add
    up: each new best may be slightly worse in what matters most. So after the last experiment, the
    best is compared with up to three former bests, earliest first, that it was not compared with
    before. People who never said "about the same" and never contradicted themselves are not asked.

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
    left_out = {best, *history.cut_short()}
    for former in dict.fromkeys(reigns(verdicts)):
        if former not in left_out and not history.asked(best, former):
            return max(best, former), min(best, former)
    return None
