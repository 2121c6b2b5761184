"""The agent Screening: simulate many θ unseen, show those that the answers leave undecided."""

from contextlib import suppress
from dataclasses import dataclass
from math import ceil
from typing import ClassVar, Self, final

import msgspec
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import expit, logit, logsumexp

from prefcal_agents.agent import Pair, Setup, one_thread
from prefcal_agents.glisp.agent import propose
from prefcal_agents.glisp.fits import GLISpSettings, Learned, ModelSelection
from prefcal_agents.lessons import Remembered
from prefcal_agents.people import (
    AFTER,
    Bank,
    Posterior,
    Utilities,
    expected_best,
    notice_chance,
    overtaking,
    worth,
)
from prefcal_agents.search import Tried
from prefcal_env.knobs import KnobSpace
from prefcal_env.preferences.history import History, lost_since

from .bank import Growth, KeptStage, Simulating, Simulations, Stage

# --- What can be said of a result: how many θ are noticeably better, for people unlike the draws, too.
#
# The draws' own shares are too sure about people who judge by something that no draw looks at. So what
# they say, and how the answers went, enters a formula that was fitted to simulated people of eleven
# kinds, and checked on other loops and people (docs/research/certificate.md).

FROM = 2
"""Number of answers from which on something can be said."""
PROBABILITY = 0.95
"""How probably fewer θ are better than is said."""
LEAST = 0.01
"""Smallest share that is said."""
MOST = 1000
"""Largest number of random experiments that is said: 8,192 tell little of more."""
ENOUGH_AFTER, ENOUGH_SHARE, ENOUGH_CHANCE = (6, 8), 0.1, 0.5
"""Numbers of answers after which a study can end, and the largest share and chance with which it does.

Source: none. Of the rules that ask ten questions at most, one that keeps nine tenths of what ten
answers are worth. There are two looks, since each one can end a study by mistake.
"""
_BY_CHANCE = -1.1  # mean log probability of an answer, in nats, if each of the three is as likely: log(1/3)
_SHARE = (1.583, 0.382, -0.177, -0.169, 0.615, -0.364)
"""Coefficients of log10 of the share: a constant, then of what `Evidence.terms` returns.

Source: none. An ordinal logistic regression of how many random θ are noticeably better, at 99 %:
above what is promised, so that it holds for each kind of people by itself and for new ones.
"""
_AT, _STEP = 0.01, 0.544
"""Chance of being exceeded for which the constant of the share is, and by how many decades the share
falls where the logit of that chance is larger by 1, by the same regression."""
_INTERVAL = (0.05, 0.5, 0.95)
"""Chances of being exceeded, by that regression, of the shares that numbers of experiments follow from."""
_CHANCE = (0.2, 0.93)
"""Coefficients of the logit of the chance: a constant, and how much the logit of the draws' counts.

Source: none. A logistic regression on five loops and eleven kinds of people.
"""
_ADDED = 0.001  # what is added to shares before their logarithm
_QUANTILE = 0.9  # quantile over the draws of the share of the θ that fill the space
_AT_ONCE = 200  # number of θ that are compared with the result at a time, which bounds the memory
_SURE = 0.98  # largest chance that is believed; 1 minus it is the smallest


@dataclass(frozen=True, slots=True)
class Evidence:
    """What draws and answers say of a result.

    Args:
        answers: Number of answers, 1 or more.
        better: Share of the simulated θ that are noticeably better than the result, the mean over
            the draws.
        wide: Share of those θ that fill the space which are, exceeded by a tenth of the draws.
        held: How far the result has held against challengers since it won: the sum of -log(1 - p),
            where p is the chance that each would win, by the draws and all other answers.
        predicted: Mean logarithm of the probability of each answer by all others, in nats.
        explained: Whether KPIs predict the answers about as well as θ does, see `explains`.
        chance: Share of the draws to which the most promising θ is noticeably better.
        promising: The most promising θ of those that were not shown, physical.
        spread: Number of simulated θ that fill the space.
    """

    answers: int
    better: float
    wide: float
    held: float
    predicted: float
    explained: bool
    chance: float
    promising: tuple[float, ...]
    spread: int

    @property
    def terms(self) -> tuple[float, ...]:
        """Return the numbers in which the logarithm of the share is linear."""
        better, wide = np.log10(np.array([self.better, self.wide]) + _ADDED).tolist()
        return better, float(np.log(self.answers)), self.held, wide, self.predicted


@dataclass(frozen=True, slots=True)
class Certificate:
    """What can be said of a result, so that it holds for people who are not the learner's own.

    Args:
        share: Share of random θ of which fewer are noticeably better than the result, 0.01 to 1;
            None if the answers do not follow from the KPIs.
        probability: Probability that this is true.
        chance: Chance that the most promising θ is noticeably better than the result; None if the
            answers do not follow from the KPIs.
        promising: The most promising θ of those that were not shown, physical.
        experiments: Number of random experiments whose best one is as good as the result: the lower
            end of a 90 % interval for people of all kinds together, the median, and the upper end,
            1 to 1000, which stands for more, too. None if the answers do not follow from the KPIs.
        enough: Whether so little is left that a study can end, after 6 and 8 answers.
        by_knobs: Whether nothing is stated since θ predicts the answers better than the KPIs do.
    """

    share: float | None
    probability: float
    chance: float | None
    promising: tuple[float, ...]
    experiments: tuple[float, float, float] | None = None
    enough: bool = False
    by_knobs: bool = False

    @property
    def explained(self) -> bool:
        """Return whether the answers follow from the KPIs: otherwise no number is stated."""
        return self.share is not None

    @classmethod
    def of(cls, found: Evidence) -> Self:
        """Return what can be said by the evidence (Screening, rule 12).

        Nothing can if the draws predict each answer from the others no better than by chance, or
        if θ predicts them better.
        """
        # Then the draws are of somebody else, and so would be all numbers that follow from them.
        if found.predicted < _BY_CHANCE or not found.explained:
            return cls(None, PROBABILITY, None, found.promising, by_knobs=not found.explained)
        constant, *slopes = _SHARE
        size = constant + float(np.dot(slopes, found.terms))
        # If s of all θ are better, no θ of N is with probability (1 - s)^N: a few cannot show a small share.
        unseen = 1 - (1 - PROBABILITY) ** (1 / found.spread)
        most = MOST
        if unseen > LEAST:
            size, most = max(size, np.log10(unseen)), found.spread
        # Rounded up: fewer θ are better than is said, never more.
        share = ceil(100 * np.clip(10.0 ** min(size, 0.0), LEAST, 1.0)) / 100
        constant, slope = _CHANCE
        # The logit of 0 or 1 is infinite, and a few hundred draws cannot tell either from nearly so.
        believed = np.clip(found.chance, 1.0 - _SURE, _SURE)
        chance = float(expit(constant + slope * logit(believed)))
        enough = found.answers in ENOUGH_AFTER and share <= ENOUGH_SHARE and chance <= ENOUGH_CHANCE
        return cls(share, PROBABILITY, chance, found.promising, _experiments(size, most), enough)


def _experiments(size: float, most: int) -> tuple[float, float, float]:
    """Return the `experiments` of a certificate, `most` at most, given log10 of the share that is said.

    The best of N random experiments is as good as the result if N find something noticeably better
    with probability 1/2: (1 - s)^N = 1/2, with s the share of all θ that are better.
    """
    logs = size + _STEP * (logit(_AT) - logit(_INTERVAL))
    numbers = np.log(2) / -np.log1p(-np.minimum(10.0**logs, 0.5))
    low, middle, high = np.clip(numbers, 1, most).tolist()
    return low, middle, high


def evidence(stage: Stage, best: int, history: History, given: Posterior, *, explained: bool) -> Evidence:
    """Return what draws and answers say of row `best` of the bank.

    Args:
        stage: What is known after `history`.
        best: Row of the result.
        history: Samples and answers, one answer or more.
        given: What the draws of the stage say of these answers.
        explained: As in `Evidence`.
    """
    draws = stage.utilities.some(len(stage.costs))
    better = _better(draws, stage.logs, best) & ~stage.bank.hopeless
    chances = better.mean(axis=0)
    # Only what was not shown yet can be the most promising one.
    chances[stage.bank.rows([sample.theta for sample in history.samples[: history.answered]])] = 0.0
    row = int(np.argmax(chances))
    held, predicted = _foretell(given, draws, history)
    return Evidence(
        answers=len(history.lessons),
        better=float(better.mean()),
        wide=float(np.quantile(better[:, stage.spread].mean(axis=1), _QUANTILE)),
        held=held,
        predicted=predicted,
        explained=explained,
        chance=float(chances[row]),
        promising=tuple(stage.bank.thetas[row].tolist()),
        spread=len(stage.spread),
    )


def _better(draws: Utilities, logs: Float[np.ndarray, "m k"], best: int) -> Bool[np.ndarray, "s m"]:
    """Return to which draws each θ is noticeably better than row `best`, shape (s, m).

    The two are compared as people compare them. Costs, which order all θ at once, count the steps
    of an order from the best value, which splits differences that nobody notices.
    """
    found = np.zeros((len(draws), len(logs)), dtype=np.bool_)
    for rows in np.array_split(np.arange(len(logs)), -(-len(logs) // _AT_ONCE)):
        levels = draws.levels(logs[np.append(rows, best)])
        each = np.arange(len(rows))
        found[:, rows] = draws.gain(draws.differences(levels, each, np.full(len(rows), len(rows)))) > 1.0
    return found


def _foretell(given: Posterior, draws: Utilities, history: History) -> tuple[float, float]:
    """Return `held` and `predicted` of `Evidence` by some of the draws that are given the answers.

    Source: A. E. Gelfand, D. K. Dey, H. Chang, "Model determination using predictive
    distributions" (1992): draws given all answers tell one of them by the others, if each draw
    counts by the inverse of the probability that it gives to that answer.
    """
    count = len(history.lessons)  # those that marks make are no answers
    every = slice(None, None, len(given.utilities) // len(draws))  # as `Utilities.some`
    logs = given.logs[every, :count]
    inverse = logsumexp(-logs, axis=0)
    lost = np.arange(count - lost_since(history), count)
    # Importance weights of the posterior without each answer: 1 over the probability of that answer.
    shares, told = np.exp(-logs[:, lost] - inverse[lost]), given.lessons.take(lost)
    gain = draws.gain(told.differences(draws))
    of_challenger = np.where(told.tie, gain, -gain)  # where it did not win
    chance = np.sum(shares * notice_chance(of_challenger), axis=0)
    held = -np.log1p(-np.minimum(chance, _SURE)).sum()
    return float(held), float(np.mean(np.log(len(logs)) - inverse))


# --- Which simulated θ is worth showing, and whether any still is.

_CLEAR = (0.1, 0.25)
"""Smallest difference that is clear: a share of the larger value, and one of the middle half of
all good simulations."""
LOOK = 60
"""Number of θ for which two answers are looked ahead."""
_OPEN = 4
"""Where the simulation is rough, every fourth θ is one that people with any wishes might prefer to
all shown: a few answers between θ that are poor in the same way can teach a wrong preference."""
_ALIKE = 0.005  # experiments whose KPIs differ by less than this share look alike

_LAST = 5  # number of last questions of a robust study that show what holds, if anything does
_STALLED = 5  # number of challengers lost in a row after which every second one is proposed without KPIs
_UNTIL, _EVERY = 30, 4
"""Until so many answers, every fourth such proposal fills the space, as the start of GLISp does."""


@final
class Screening(Simulating):
    """Simulate many θ unseen, learn the person's utility from KPIs, and show few experiments.

    Arguments and errors are those of `Simulating`. n_max experiments take n_max - 1 comparisons:
    nothing is asked twice. Differences of KPIs that people cannot read, by the `reading` of
    `simulate`, are none.
    """

    version: ClassVar[int] = 7

    def _prepare(self) -> None:
        self._evidences = Remembered(self._evidence_after)

    # What people and programs look at.

    @property
    def bank(self) -> Bank:
        """Return the simulated θ that the open query was chosen from; it simulates if needed."""
        return self.stage(self.history).bank

    @property
    def due(self) -> int:
        """Return the number of θ that are simulated by the time of the open query."""
        return 0 if self._simulations is None else self.growth.due(self.history)

    @property
    def evidence(self) -> Evidence | None:
        """Return what draws and answers say of the best θ so far; it simulates if needed.

        None before the second answer, and where experiments measured other KPIs than those
        simulated, on which no certificate was measured.
        """
        return self._evidences(self.history.past)

    def _evidence_after(self, history: History) -> Evidence | None:
        best = self.turn(history).best
        if best is None or len(history.lessons) < FROM:
            return None
        growth = self.growth
        stage = growth.stage(history)
        # The formula was fitted to exact simulations: with a twin, the draws' share means something else.
        row = None if stage.rough else _row(stage.bank, np.array(history.samples[best].theta))
        if row is None:
            return None
        # The numbers of given candidates mean nothing, so that what they predict is chance.
        numbered = growth.simulations.candidates is not None
        explained = numbered or growth.explains(history)
        return evidence(stage, row, history, growth.posterior(history), explained=explained)

    @property
    def certificate(self) -> Certificate | None:
        """Return what can be said of the best θ so far; None where there is no `evidence`."""
        found = self.evidence
        return None if found is None else Certificate.of(found)

    def stage(self, history: History) -> Stage:
        """Return what is known after `history`, which is remembered; it simulates if needed."""
        return self.growth.stage(history)

    @property
    def growth(self) -> Growth:
        """Return the stages of the study and the draws of all its records. Raises as `simulations`."""
        setup, most = self.setup, int(self.setup.settings.n_simulated)
        return self.simulations.learn_once(Growth, setup.space, most, setup.seed, setup.settings.taste)

    def remember(self, history: History) -> bytes:
        """Return the latest stages up to `history` and shapes of φ, which take long to learn."""
        with one_thread():
            kept = self.growth.worth_keeping(history), self._beyond.models.remember(history)
            return msgspec.msgpack.encode(kept)

    def recall(self, learned: bytes) -> None:
        """Use what `remember` of the same settings returned, as far as record and KPIs are the same."""
        with suppress(msgspec.MsgspecError):  # of another version: all is learned anew
            stages, shapes = msgspec.msgpack.decode(learned, type=tuple[dict[bytes, KeptStage], Learned])
            self.growth.recall(stages)
            self._beyond.models.recall(shapes)

    @property
    def _beyond(self) -> "BeyondKPIs":
        return self.simulations.learn_once(BeyondKPIs, self.space, self.setup.seed)

    def _holds(self, bank: Bank, row: int) -> bool:
        """Return whether a row holds; see `Simulations.held`."""
        return bool(self.simulations.held(bank, np.array([row]))[0])

    # What the agent does.

    def _leader(self, history: History) -> int | None:
        """Return the sample of the largest worth that is probably better than the answers' best.

        Screening, rule 9.

        One wrong answer can cost the best experiment its place. All answers and the KPIs together
        give it back without a question, unless the person hardly follows the KPIs: then what won
        stays. In a robust study the best one that holds takes the place of one that does not; if none
        holds, the best of those that keep the limits in most perturbed runs, beyond chance.
        """
        best = history.by_answers
        if best is None or len(history.lessons) < 2 or self._simulations is None:
            return None
        stage = self.stage(history)
        rows = stage.bank.rows([s.theta for s in history.samples[: history.answered]])
        better = np.mean(stage.costs[:, rows] < stage.costs[:, rows[best], None] - 1.0, axis=0)
        loose = float(stage.utilities.loose.mean())
        if self.simulations.holds is not None:
            held = self.simulations.held(stage.bank, rows)
            if not held.any():
                held = self.simulations.steadiest(stage.bank, rows) > 0
            better = better * held
            if not held[best]:
                # All that hold are rivals, for any person; the one with the largest worth leads.
                better, loose = held.astype(float), 0.0
        rivals = overtaking(better, loose, history) > 0
        if not rivals.any():
            return None
        value = np.where(rivals, self.growth.worth(history.past)[:, rows].mean(axis=0), -np.inf)
        return int(np.argmax(value))

    def has_enough(self, history: History) -> bool:
        """Return whether little is left by the certificate, and the best misses no objective and holds."""
        past = history.past
        found, best = self._evidences(past), self.turn(past).best
        if found is None or best is None or not Certificate.of(found).enough:
            return False
        bank = self.stage(past).bank
        row = bank.find(np.array(past.samples[best].theta))
        return (
            self._holds(bank, row) and not self.simulations.reading.missed(bank.names, bank.kpis[[row]]).any()
        )

    def question(self, history: History) -> Pair | None:
        """Return None: nothing is asked twice."""
        return None

    def propose(self, history: History) -> Float[np.ndarray, " n"]:
        """Return the simulated point that the answers leave most undecided, or one beyond KPIs."""
        growth, best = self.growth, history.incumbent
        stage, rng = growth.stage(history), np.random.default_rng([self.setup.seed, history.answered])
        tried = Tried(self.space, history)
        if growth.simulations.candidates is None and without_kpis(history, stage, growth):
            beyond = tried.fresh(self._beyond.propose(history, stage), rng)
            # It is new to the simulations, so it may fail or never arrive: then the draws choose.
            if growth.works(beyond, stage.bank):
                return beyond
        if stage.rough and history.answered % _OPEN == 0:
            found = _open_minded(stage, history, rng)
            if found is not None:
                return tried.fresh(stage.bank.z[found], rng)
        row = None if best is None else stage.bank.find(history.samples[best].theta)
        allowed = ~(stage.bank.hopeless | _look_alike(stage, history))
        if row is None or not history.lessons:
            value = expected_best(stage.costs, row)
            # 1000 exceeds any number of objectives: look-alikes come last, whatever the others miss.
            poor = self._poor_beginning(stage, row) + 1000 * ~allowed
            order = np.lexsort([-value, poor])
        else:
            value = now_and_next(stage.costs, growth.worth(history.past), row, allowed)
            order = np.argsort(-value, kind="stable")
        if self.simulations.holds is not None:
            order = self._robust_first(stage, order, allowed, history)
        z = tried.first_new(stage.bank.z[order])
        return tried.fresh(stage.bank.z[0], rng) if z is None else z

    def _robust_first(
        self, stage: Stage, order: Int[np.ndarray, " m"], allowed: Bool[np.ndarray, " m"], history: History
    ) -> Int[np.ndarray, " m"]:
        """Return rows in order behind the first that holds.

        It is one of those that promise most, and one that never reaches something, which holds easily,
        only if it promises more than all others: if there is none, one that does not hold teaches
        more. The last questions look at all θ, those of the largest worth first, and if none holds,
        at those that keep the limits in most perturbed runs.
        """
        most, rest = np.split(order[allowed[order]], [LOOK])
        last = self.n_max - history.answered <= _LAST
        if last:
            by_worth = np.argsort(-self.growth.worth(history.past).mean(axis=0)[rest], kind="stable")
            most = np.append(most, rest[by_worth])
        else:
            finite = np.isfinite(stage.bank.kpis).all(axis=1)
            most = most[finite[most] | (most == order[0])]
        for row in most:
            if self._holds(stage.bank, row):
                return np.append(row, order[order != row])
        steady = most[self.simulations.steadiest(stage.bank, most) > 0] if last else most[:0]
        return np.append(steady, order[~np.isin(order, steady)])

    def _poor_beginning(self, stage: Stage, row: int | None) -> Int[np.ndarray, " m"]:
        """Return how little each θ suits the first comparison, 0 is best, shape (m,).

        People begin with two experiments that meet the objectives, and differ clearly.
        """
        names, kpis = stage.bank.names, stage.bank.kpis
        missed = self.simulations.reading.missed(names, kpis)
        if row is None:
            return np.asarray(2 * missed)
        return np.asarray(2 * missed + ~clearly_apart(kpis, missed == missed.min(), row))


def now_and_next(
    costs: Float[np.ndarray, "s m"],
    found: Float[np.ndarray, "s m"],
    best: int,
    allowed: Bool[np.ndarray, " m"],
) -> Float[np.ndarray, " m"]:
    """Return the mean of what is expected after this answer and after the next one, shape (m,).

    Screening, rule 8.

    What is expected is the worth of the best one; the next question is the best one for each of the
    three answers. Without the first half, a question that leads nowhere could come before a good
    one. Only the θ that promise most by one answer are looked at; others are worth -inf.

    Source: J. González, M. Osborne, N. Lawrence, "GLASSES: relieving the myopia of Bayesian
    optimisation" (2016).
    Deviation: two answers ahead, not all; and the mean, since a person may stop after each.

    Args:
        costs: Cost of each θ in each draw, shape (s, m).
        found: Their `worth`.
        best: Row of the best one so far.
        allowed: θ that may be shown, shape (m,).
    """
    kept = _kept(costs, found, best)
    now = np.where(_telling(costs, kept, best, allowed), kept.mean(axis=0), -np.inf)
    value = np.full(len(now), -np.inf)
    for row in np.argsort(-now, kind="stable")[: min(LOOK, np.count_nonzero(np.isfinite(now)))]:
        # Draws split by what they would answer, without mistakes: what each group would ask next is its best
        # one.
        won, lost = (sign * (costs[:, best] - costs[:, row]) > 1.0 for sign in (1, -1))
        after = [_kept(costs[won], found[won], row), kept[lost], kept[~won & ~lost]]
        then = sum(each[:, allowed].sum(axis=0).max() for each in after) / len(costs)
        value[row] = (now[row] + then) / 2
    return value


def _telling(
    costs: Float[np.ndarray, "s m"],
    kept: Float[np.ndarray, "s m"],
    best: int,
    allowed: Bool[np.ndarray, " m"],
) -> Bool[np.ndarray, " m"]:
    """Return `allowed` without likely ties, if what is left promises enough, shape (m,)."""
    gain = kept.mean(axis=0) - kept[:, best].mean()
    clear = allowed & (np.mean(np.abs(costs - costs[:, [best]]) <= 1.0, axis=0) <= 0.4)
    # Waiting more strictly left 16 % ties, and cost a tenth of the worth: docs/research/screening.md.
    enough = gain[clear].max(initial=0.0) > 0.2 * gain[allowed].max(initial=0.0)
    return clear if enough else allowed


def _kept(
    costs: Float[np.ndarray, "s m"], found: Float[np.ndarray, "s m"], best: int
) -> Float[np.ndarray, "s m"]:
    """Return the worth of the one that is kept if each θ is compared with the best, (s, m)."""
    noticed = costs < costs[:, [best]] - 1.0
    return np.asarray(np.where(noticed, found, found[:, [best]]))


def clearly_apart(
    kpis: Float[np.ndarray, "m k"], good: Bool[np.ndarray, " m"], row: int
) -> Bool[np.ndarray, " m"]:
    """Return which experiments differ clearly from one of them in some KPI, shape (m,).

    Args:
        kpis: KPIs as people read them, shape (m, k).
        good: Experiments that tell which differences are usual, shape (m,).
        row: Row of the experiment.
    """
    apart = np.zeros(len(kpis), dtype=np.bool_)
    for values in kpis.T:
        known = values[good & np.isfinite(values)]
        if not len(known) or not np.isfinite(values[row]):
            continue
        larger = np.maximum(np.abs(values), abs(values[row]))
        with np.errstate(invalid="ignore", over="ignore"):  # infinite, or nearly so
            usual = float(np.subtract(*np.percentile(known, [75, 25])))
            least = np.maximum(_CLEAR[0] * larger, _CLEAR[1] * usual)
            apart |= (usual > 0) & (np.abs(values - values[row]) >= least)
    return apart


def _open_minded(stage: Stage, history: History, rng: np.random.Generator) -> int | None:
    """Return the row that people with any wishes might prefer to all that was shown.

    It is one of those that fill the space: near the leaders, all are good or poor in the same way.
    None if all that the simulation does not refuse were shown.
    """
    shown = stage.bank.rows([sample.theta for sample in history.samples[: history.answered]])
    rest = np.setdiff1d(stage.spread[~stage.bank.hopeless[stage.spread]], shown)
    if not len(rest):
        return None
    rows = np.concatenate([shown, rest]).astype(np.int64)
    found = worth(Utilities.draw(stage.scale, len(stage.costs), rng).costs(stage.logs[rows]))
    # Over draws before any answer, since a few answers about a rough simulation can all be beside the point.
    best = found[:, : len(shown)].max(axis=1, keepdims=True)
    gain = np.maximum(found[:, len(shown) :] - best, 0.0)
    return int(rest[np.argmax(gain.mean(axis=0))])


def _look_alike(stage: Stage, history: History) -> Bool[np.ndarray, " m"]:
    """Return which θ have the KPIs of one that was shown, shape (m,): a person sees nothing new."""
    logs, shown = stage.logs, stage.bank.rows([s.theta for s in history.samples[: history.answered]])
    if not stage.scale.names:
        return np.full(len(logs), len(shown) > 0)
    alike, order = np.zeros(len(logs), dtype=np.bool_), np.argsort(logs[:, 0], kind="stable")
    # Each is compared with those that are near it in the first KPI: of a long study, with all takes longer.
    first, own = logs[order, 0], logs[shown, 0]
    begin, end = first.searchsorted(own - 2 * _ALIKE), first.searchsorted(own + 2 * _ALIKE, side="right")
    for row, rows in zip(shown.tolist(), map(order.__getitem__, map(slice, begin, end)), strict=True):
        near = logs[rows]
        # In logarithms a difference is a share. Equal infinite values differ by 0: their difference is not
        # taken.
        apart = np.abs(np.subtract(near, logs[row], where=near != logs[row], out=np.zeros(near.shape)))
        alike[rows] |= apart.max(axis=1) < _ALIKE
    return alike


def _row(bank: Bank, theta: Float[np.ndarray, " n"]) -> int | None:
    """Return the row of θ in the bank; None if it is not there, since a person asked for it."""
    try:
        return bank.find(theta)
    except KeyError:
        return None


def without_kpis(history: History, stage: Stage, growth: Growth) -> bool:
    """Return whether the next θ is proposed without KPIs (Screening, rule 10)."""
    if stage.bank.hopeless[stage.spread].all():
        return False
    return is_stalled(history) or not growth.explains(history.past)


def is_stalled(history: History) -> bool:
    """Return whether it is the turn of a proposal without KPIs, since those with them all lost."""
    lessons = history.lessons
    lost = lost_since(history) >= _STALLED
    strict = any(c.answer.preference for c in lessons)
    return len(lessons) >= AFTER and len(lessons) % 2 == 1 and lost and strict


class BeyondKPIs:
    """Proposals from answers and θ alone; what its `models` remember only saves time."""

    def __init__(self, simulations: Simulations, space: KnobSpace, seed: int) -> None:
        # As if its start were the answers that came before it takes over.
        self.models = ModelSelection(Setup(space, AFTER, seed, GLISpSettings(kpis=False)))

    def propose(self, history: History, stage: Stage) -> Float[np.ndarray, " n"]:
        """Return the next point of the cube, shape (n,)."""
        count = len(history.lessons)
        if count < _UNTIL and count % _EVERY == _EVERY - 1:
            rows = stage.spread[~stage.bank.hopeless[stage.spread]]
            return np.asarray(stage.bank.z[rows[count % len(rows)]])
        return propose(self.models.setup, self.models.fit(history))
