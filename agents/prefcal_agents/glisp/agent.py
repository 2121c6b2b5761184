"""GLISp: preference-based optimization with radial basis functions and IDW exploration."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple, Self, final

import msgspec
import numpy as np
from jaxtyping import Float, Int
from scipy.special import expit, logit

from prefcal_agents.agent import Agent, Pair, Start, one_thread, rematch
from prefcal_agents.learned_cost import LearnedCost
from prefcal_agents.lessons import Marks, Preferences, Remembered, cube_of, judged
from prefcal_agents.search import (
    POOL,
    Acquisition,
    Objective,
    Penalized,
    Penalty,
    Tried,
    latin_hypercube,
    new_minimum,
    random_points,
    replace_unsafe,
    unsafe_penalty,
)
from prefcal_agents.surrogate import PreferenceGP, Surrogate
from prefcal_env.knobs import KnobSpace
from prefcal_env.preferences.answer import Preference
from prefcal_env.preferences.history import History, contradictory, lost_since, reigns

from .fits import (
    ALMOST_SURE,
    Dataset,
    Fit,
    GLISpSettings,
    GLISpSetup,
    Learned,
    ModelSelection,
    Selection,
    is_process_turn,
    most_promising,
    train,
    trust,
)

# --- Propose GLISp's next sample: the table of what is minimized when, and the search.


class StrategyRow(NamedTuple):
    """One row of the strategy."""

    # Function that returns whether the row applies to a fit in a study
    holds: Callable[[GLISpSetup, Fit], bool]
    # Function that trains a model, and returns what the next sample minimizes of it; None if the draws of
    # what the person wants choose, see `most_promising`
    objective: Callable[[GLISpSetup, Fit], Objective] | None


def _every_second_time(setup: GLISpSetup, fit: Fit) -> bool:
    turn = is_process_turn(fit.data.history.answered, setup.n_init)
    return setup.settings.process and fit.data.is_strict and turn


def _mean(setup: GLISpSetup, fit: Fit) -> Objective:
    """Return the mean of a Gaussian process trained on comparisons only."""
    # With one comparison per sample, answers cannot contradict each other; with more they can.
    trusted = ALMOST_SURE if fit.data.history.follow_ups else 0.0
    error_rate = setup.settings.error_rate if fit.selection.is_noisy else trusted
    return Acquisition.of(PreferenceGP.of(fit.data.preferences, error_rate), 0.0)


def _exploration(setup: GLISpSetup, fit: Fit) -> Objective:
    """Return eq. acquisition on Ĵ."""
    surrogate = train(fit.data, fit.selection, setup.settings)
    return Acquisition.of(surrogate, setup.settings.delta, cube_of(fit.data.history))


STRATEGY = (
    StrategyRow(lambda setup, fit: fit.kpis is not None, None),
    StrategyRow(_every_second_time, _mean),
    StrategyRow(lambda setup, fit: True, _exploration),
)
"""What chooses the next sample: the first row that holds.

A row above the first also applies where KPIs explain the answers.

Deviation: the paper has the last row only.
"""


def propose(setup: GLISpSetup, fit: Fit) -> Float[np.ndarray, " n"]:
    """Return the cube point of the next sample, shape (n,): a minimum of an acquisition.

    Source: eq. xNp1.
    Deviation: see `STRATEGY`; unsafe marks add to the acquisition, see `Penalized`.
    """
    history = fit.data.history
    # From the record's length alone, so that a resumed study draws the same θ as one that went on.
    rng = np.random.default_rng([setup.seed, history.answered])
    penalty = _penalty(setup, history)
    rule = next(rule for rule in STRATEGY if rule.holds(setup, fit))
    if rule.objective is None:
        assert fit.kpis is not None  # by the row's condition
        return most_promising(setup, history, fit.kpis, penalty, rng)
    objective = rule.objective(setup, fit)
    if penalty is not None:
        objective = Penalized(objective, penalty)
    return new_minimum(objective, setup.space, history, rng)


def propose_start(setup: GLISpSetup, history: History) -> Float[np.ndarray, " n"]:
    """Return the cube point of a sample of the start, shape (n,), from a Latin hypercube: GLISp, rule 1.

    Deviation: another point takes its place if it is likely unsafe according to the marks.
    """
    index = history.answered
    rng = np.random.default_rng([setup.seed, index])
    plan = latin_hypercube(setup.space, setup.n_init, setup.seed)
    z = np.asarray(plan[index])
    penalty = _penalty(setup, history)
    if penalty is not None:
        # What is planned later counts as tried, or two points of the start could end up side by side.
        others = np.vstack([cube_of(history), plan[index + 1 :]])
        z = replace_unsafe(z, others, random_points(setup.space, POOL, rng), penalty)
    return Tried(setup.space, history).fresh(z, rng)


def _penalty(setup: GLISpSetup, history: History) -> Penalty | None:
    if not history.unsafe:
        return None
    return unsafe_penalty(history, setup.settings.unsafe_weight, setup.settings.least_safe)


# --- Follow-up questions: which two known samples to compare before the next one is proposed.

_APART = 10  # number of experiments between two questions that are only based on a suspicion
_SURE = 2.0  # A difference of at least this many standard deviations is certain enough not to ask
_RIVALS = 9  # samples next to the best, by Ĵ
FINALS = 3  # maximum number of questions after the last experiment


def follow_up(history: History, models: ModelSelection, settings: GLISpSettings) -> tuple[int, int] | None:
    """Return two known samples to compare now, the challenger first; None if there are none.

    If mistakes are suspected, ask whether the best sample really is the best; once that is
    settled, find the rank of the latest one: GLISp, rule 6.

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
        pair = kpis.find_doubted(history) if settings.error_rate else None
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
    # Samples that long studies no longer learn from have no Ĵ, and cannot be rivals.
    values = np.full(history.answered, np.inf)
    features[data.kept] = known
    values[data.kept] = Surrogate(samples, posterior.mean, shape)(samples)
    candidates = candidates[np.isfinite(values[candidates])]
    rest = [int(k) for k in candidates[np.argsort(values[candidates], kind="stable")] if k != best]
    rivals = [k for k in rest[:_RIVALS] if not history.asked(best, k)]
    if not rivals:
        return None
    # By the posterior of the difference: two means apart say little if both are uncertain in the same way.
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
    cut = history.cut_short
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
        values: Ĵ at the N samples that are answered, lower is better.
    """
    new = history.answered - 1
    latest = [c for c in history.latest if c.challenger == new]  # others may be about the best
    if not latest or not all(c.teaches for c in latest):
        return None
    asked = {c.incumbent for c in latest}
    left_out = history.cut_short - asked  # half a run cannot be compared with a whole one
    if new in left_out:
        return None
    order = [int(i) for i in np.argsort(values, kind="stable") if i not in {new, *left_out}]
    above, below = -1, len(order)  # positions of the worst better one and of the best worse one
    for c in latest:
        assert c.incumbent is not None  # it teaches
        position = order.index(c.incumbent)
        if c.answer.preference is Preference.INCUMBENT:
            above = max(above, position)
        # A win over the best (`after` is None) makes it the best: then its place is known.
        elif c.answer.preference is Preference.CHALLENGER and c.after is not None:
            below = min(below, position)
        else:
            return None
    between = order[above + 1 : below]
    # The answers can contradict the order of Ĵ; then a rival that was asked before would come again.
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
    left_out = {best, *history.cut_short}
    for former in dict.fromkeys(reigns(verdicts)):
        if former not in left_out and not history.asked(best, former):
            return max(best, former), min(best, former)
    return None


# --- What the next experiment can bring, for people and plants unlike the draws, too.
#
# The draws' own chance is too sure. So it enters a formula with how the answers went, which was fitted to
# simulated people of eleven kinds, and checked on other loops and people (docs/research/certificate.md).

FROM = 5  # number of answers from which on something can be said
_CHANCE = (-0.69, 0.48, -0.25)
"""Coefficients of the logit of the chance: a constant, then of what `Foresight.terms` returns.

Source: none. A logistic regression of whether the next experiment is noticeably better.
"""
_BELIEVED = 0.996  # largest share of the draws that is believed; 1 minus it is the smallest


@dataclass(frozen=True, slots=True)
class Foresight:
    """What draws and answers say of the next experiment, before it runs: GLISp, rule 7."""

    # Share of the draws to which it is noticeably better than the best so far; None if KPIs do not explain
    # the answers
    better: float | None
    lost: int  # number of answers since a challenger won, see `lost_since`

    @property
    def terms(self) -> tuple[float, ...]:
        """Return the numbers in which the logit of the chance is linear; none if nothing can be said."""
        if self.better is None:
            return ()
        return float(logit(np.clip(self.better, 1.0 - _BELIEVED, _BELIEVED))), float(np.log1p(self.lost))

    @property
    def chance(self) -> float | None:
        """Return the chance that it is noticeably better; None if nothing can be said."""
        constant, *slopes = _CHANCE
        return float(expit(constant + np.dot(slopes, self.terms))) if self.terms else None


_STREAM = 4  # stream of random numbers


@final
class GLISp(Agent):
    """Learn from preferences which experiment to run next.

    The first `n_init` samples are a Latin hypercube. Then Ĵ is trained on all preferences
    (eq. QP-pref), ε is chosen by cross-validation, and an acquisition is minimized (eq. xNp1).

    Source: section III of the paper.
    Deviation: see `GLISpSettings`. Those of `GLISp.paper` are all in
    docs/deviations.md, with what they change: the box (see `KnobSpace`), the plain Latin hypercube
    of the start, the candidates of ε, a multistart descent instead of a particle swarm, and round
    numbers for each knob.

    Arguments and errors are those of `Agent`: n_max experiments take n_max - 1 comparisons, and
    `settings` are `GLISpSettings`. With `delta`, it is δ of eq. acquisition instead of the one in
    `settings`, and KPIs are off, so that eq. acquisition is minimized.
    """

    version: ClassVar[int] = 13
    options = GLISpSettings
    paced = True

    def __init__(
        self,
        space: KnobSpace,
        *,
        n_init: int = 10,
        n_max: int = 50,
        seed: int = 0,
        settings: GLISpSettings | None = None,
        delta: float | None = None,
        start: Start | None = None,
    ) -> None:
        if delta is not None:
            settings = replace(settings or GLISpSettings(), delta=delta, kpis=False)
        super().__init__(space, n_init=n_init, n_max=n_max, seed=seed, start=start, settings=settings)

    def _prepare(self) -> None:
        self._models = ModelSelection(self.setup)
        self._foresights = Remembered(self._foresight)

    def propose(self, history: History) -> Float[np.ndarray, " n"]:
        """Return the next point: of the start, or a minimum of an acquisition (eq. xNp1)."""
        if history.answered < self.setup.n_init:
            return propose_start(self.setup, history)
        return propose(self.setup, self._models.fit(history))

    def question(self, history: History) -> Pair | None:
        """Return two samples to compare: the unbeaten ones, or those about which answers may err.

        GLISp, rule 2.
        """
        pair = rematch(history)
        if pair is not None:
            return pair
        if history.answered < self._most(history):
            return follow_up(history, self._models, self.settings)
        # With error rate 0 every answer counts as right, as in the paper.
        return final_question(history) if self.settings.error_rate else None

    def remember(self, history: History) -> bytes:
        """Return draws and shapes of φ after `history`, which take a tenth of a second an answer."""
        with one_thread():
            return msgspec.msgpack.encode(self._models.remember(history))

    def recall(self, learned: bytes) -> None:
        """Use what `remember` of the same settings returned, as far as the record is the same."""
        with suppress(msgspec.MsgspecError):  # of another version: all is learned anew
            self._models.recall(msgspec.msgpack.decode(learned, type=Learned))

    @classmethod
    def paper(
        cls, space: KnobSpace, *, n_init: int = 10, n_max: int = 50, seed: int = 0, start: Start | None = None
    ) -> "GLISp":
        """Create an agent with the algorithm and settings of the paper, section IV.

        Deviation: the box is [0, 1]^n, the start a plain Latin hypercube, and eq. xNp1 is solved
        by the same multistart search as in the default, not by a particle swarm; see `GLISp`.
        """
        settings = GLISpSettings.paper()
        return cls(space, n_init=n_init, n_max=n_max, seed=seed, settings=settings, start=start)

    def with_questions(self, most: int) -> Self:
        """Return a copy that asks at most `most` comparisons for each experiment from now on.

        No answer is lost. An open query about a new experiment stays open; an open follow-up
        query is dropped if it exceeds the limit.

        Raises:
            SettingsError: If `most` is not an integer of 1 or more.
        """
        twin = self.copy()
        settings = replace(self.settings, questions_per_experiment=most)
        twin.setup = replace(self.setup, settings=settings)
        twin._forget()
        return twin

    @property
    def settings(self) -> GLISpSettings:
        """Return all settings."""
        settings: GLISpSettings = self.setup.settings
        return settings

    @property
    def epsilon(self) -> float:
        """Return the ε of eq. rbf in use after the answers so far."""
        with one_thread():
            return self._models.after(self.history).shape.epsilon

    @property
    def index(self) -> LearnedCost | None:
        """Return the weighted sum of KPIs that best explains the answers, to inspect or export.

        None if the answers came without KPIs, or nothing can be learned from the KPIs.
        """
        with one_thread():
            return LearnedCost.of(judged(self.history), self.setup.seed)

    @property
    def foresight(self) -> Foresight | None:
        """Return what the next experiment can bring: the open one or, at the end, one more.

        None before the fifth answer, while two known experiments are compared, and without KPIs.
        """
        return self._foresights(self.history)

    def _foresight(self, history: History) -> Foresight | None:
        past, best = history.past, history.incumbent
        if best is None or len(past.lessons) < FROM or not (self.settings.kpis and past.kpis.names):
            return None
        # A space with fewer θ than experiments asked for has no next one to speak of.
        tried_all = self._most(history) < self.setup.n_max
        if history.pending is None and (tried_all or not self.turn(history).over):
            return None
        with one_thread():
            fit = self._models.kpi_fit(past)
            if fit is None:
                return Foresight(None, lost_since(past))
            # At the end nothing is pending: what one more experiment would bring says whether to go on.
            new = history.pending or self._next(history)
            rng = np.random.default_rng([self.setup.seed, history.answered, _STREAM])
            costs = fit.costs(np.array([new.z]), rng)  # in each draw; that of the new one comes last
            better = costs[:, -1] < costs[:, fit.row(history.samples[best].theta)] - 1.0
        return Foresight(float(better.mean()), lost_since(past))

    @property
    def foresees(self) -> bool:
        """Return whether `foresight` takes milliseconds only: nothing has to be learned for it."""
        proposed = self.history.pending is not None or self.history in self._next
        return proposed and self._models.knows(self.history.past)

    def surrogate(self, thetas: Float[np.ndarray, "m n"]) -> Float[np.ndarray, " m"]:
        """Return how good physical `thetas` are expected to be, shape (m, n), for plotting.

        The best sample has 0 and the worst 1: shape (m,), without unit. It is Ĵ/ΔĴ or, if KPIs
        explain the answers, the expected rank. The values are all 0 while nothing is known.

        Raises:
            KnobError: If `thetas` has another shape or leaves the box.
        """
        z = self.space.encode_all(thetas)
        if len(Preferences.of(self.history)) == 0:
            return np.zeros(len(z))
        with one_thread():
            fit = self._models.fit(self.history)
            if fit.kpis is None:
                learned = train(fit.data, fit.selection, self.settings)
                values, on_samples = learned(z), learned(learned.centers)
            else:
                values, on_samples = (fit.kpis.beaten_by(x, self.setup.seed) for x in (z, fit.kpis.bank.z))
        # By the samples, not by `thetas`: the same θ has the same value in every picture.
        spread = float(np.ptp(on_samples))
        return np.asarray((values - on_samples.min()) / (spread if spread > 0 else 1.0))
