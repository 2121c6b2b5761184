"""What GLISp fits after each answer: the shape of φ, a test for wrong answers, and what KPIs say."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from typing import Any, Literal, final

import numpy as np
from jaxtyping import Float, Int

from prefcal_agents.agent import Settings, Setup, choice
from prefcal_agents.lessons import MOST, Preferences, Remembered, Stages, Subset, cube_of, fill_kpis, judged
from prefcal_agents.people import (
    AFTER,
    DRAWS,
    SURE,
    Bank,
    Lessons,
    Posterior,
    Scale,
    Utilities,
    draw_on_plant,
    expected_best,
    explains,
)
from prefcal_agents.search import Penalty, Tried, random_points, step_length
from prefcal_agents.surrogate import (
    FOLDS,
    RADIAL_FUNCTIONS,
    Constraints,
    ExpectationPropagation,
    Learning,
    Shape,
    Sites,
    Surrogate,
    Validation,
    choose_epsilon,
    fit,
    margins,
    nearest,
    rescale_knob,
)
from prefcal_env.arrays import integer, number
from prefcal_env.errors import SettingsError
from prefcal_env.knobs import KnobSpace
from prefcal_env.preferences.history import History, KPIValues, contradictory

# --- Define the settings of GLISp, checked on creation, including those of the paper.

EVERY_STEP: Literal["every step"] = "every step"
EPSILONS = (0.1, 0.18, 0.32, 0.56, 1.0, 1.8, 3.2, 5.6, 10.0)
"""Multiples of `epsilon` that cross-validation chooses from, increasing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GLISpSettings(Settings):
    """Configure how GLISp chooses the next experiment. The defaults performed best in tests.

    Source: sections III and IV of the paper. Its σ, λ and number of folds are fixed: `Learning`
    and `FOLDS` of `cross_validation`.
    Deviation: the paper validates ε after 10, 20, 30 and 40 experiments and has no `rescale`,
    `margin_power`, KPIs, marks, error rate or `process`. `GLISpSettings.paper()` turns all of
    these off. Gaps with and without them: docs/benchmarks.md, rows GLISp and GLISp.paper.

    Args:
        kpis: Whether to learn what the person wants from the KPIs that come with answers, and to
            propose by them as long as they explain the answers; see `KPIFit`. Measured in
            docs/research/kpis.md.
        delta: δ of eq. acquisition, 0 or more; 0 trusts the surrogate, well above 1 explores.
        rbf: φ of eq. rbf, a key of `RADIAL_FUNCTIONS`.
        error_rate: Probability that an answer is wrong, below 0.5. It applies once answers
            contradict each other, and KPIs do not explain them; with 0, every answer counts as
            right, and nothing is asked again. Measured in
            docs/research/archive.md.
        epsilon: ε of eq. rbf before the first cross-validation, above 0, in the unit cube.
            Cross-validation chooses among its multiples, `EPSILONS`.
        validate_at: Numbers of experiments after which ε is chosen again, or "every step": before
            every proposal that is not the process's.
        rescale: Whether each cross-validation also tries a larger and a smaller scale for one
            knob in the distances; the knobs take turns.
        margin_power: Exponent with which the margin of a strict preference grows with the
            distance of its two samples; with 0 every margin is σ, as in eq. RBF-pref.
        process: Whether every second proposal, from 20 experiments on, minimizes the mean of a
            Gaussian process that follows the answers instead of eq. acquisition; see
            `PreferenceGP`. Measured in docs/research/archive.md.
        unsafe_weight: Penalty for a place that is certainly unsafe by the marks so far, in units
            of ΔĴ, 0 or more; 0 ignores the mark.
        least_safe: Minimum probability of being safe for no penalty, above 0 and below 1; it
            rises for a while after each unsafe experiment.
        questions_per_experiment: Maximum number of comparisons for each experiment, 1 or more.
            Those after the first find its place among the experiments so far or, if answers
            contradict each other, ask whether the best is really the best.

    Raises:
        SettingsError: If a value is not valid.
    """

    kpis: bool = True
    delta: float = 0.3
    rbf: str = "inverse_quadratic"
    error_rate: float = 0.1
    epsilon: float = 1.0
    validate_at: tuple[int, ...] | Literal["every step"] = EVERY_STEP
    rescale: bool = True
    margin_power: float = 1.0
    process: bool = True
    unsafe_weight: float = 30.0
    least_safe: float = 0.9
    questions_per_experiment: int = 1

    def __post_init__(self) -> None:
        for name in ("kpis", "rescale", "process"):
            if not isinstance(getattr(self, name), bool):
                raise SettingsError(f"{name} must be True or False, got {getattr(self, name)!r}")
        for name in ("delta", "error_rate", "margin_power", "unsafe_weight"):
            number(name, getattr(self, name))
        for name in ("epsilon", "least_safe"):
            number(name, getattr(self, name), strict=True)
        for name, limit in (("error_rate", 0.5), ("least_safe", 1)):
            # At an error rate of one half answers say nothing, and no model gives a probability of 1.
            if getattr(self, name) >= limit:
                raise SettingsError(f"{name} must be below {limit}, got {getattr(self, name)!r}")
        choice("rbf", self.rbf, RADIAL_FUNCTIONS)
        integer("questions_per_experiment", self.questions_per_experiment, low=1)
        counts: Any = self.validate_at
        if counts != EVERY_STEP and not isinstance(counts, tuple):
            raise SettingsError(
                f"validate_at must be {EVERY_STEP!r} or a tuple of numbers of experiments, got {counts!r}"
            )
        for count in () if counts == EVERY_STEP else counts:
            integer("each of validate_at", count, low=1)

    @classmethod
    def paper(cls) -> "GLISpSettings":
        """Return the settings of section IV of the paper.

        Deviation: in [0, 1]^n, where the authors' code has [-1, 1]^n, δ = 0.3 explores as 0.02
        would there, although eq. IDW-distance is printed the same. docs/deviations.md says what
        that changes. `Subset` applies too, in studies far longer than those of the paper.
        """
        return cls(
            kpis=False,
            validate_at=(10, 20, 30, 40),
            rescale=False,
            margin_power=0.0,
            error_rate=0.0,
            process=False,
            unsafe_weight=0.0,
        )


GLISpSetup = Setup[GLISpSettings]  # everything that stays the same during a study of GLISp


# --- What GLISp learns from KPIs and proposes by them: draws of what the person wants.

_JUDGES = 256  # number of draws that judge θ: in each, KPIs have their own values where no experiment ran
_SHOWN, _AT_ONCE = 64, 1000  # number of draws behind a drawn value, and of θ judged at once
_DOUBT = 0.5  # probability of being better than the best above which a sample is compared with it
_STREAM = 3  # stream of random numbers
_MOST = 100  # number of answers after which ten are learned from at once, so that a long study opens soon

_STEPS = 20  # number of steps from the best so far to choose from: more would trust the processes too much
_SHORTEST = 0.003  # shortest standard deviation of a step, in units of the cube: knobs have up to 250 values


@dataclass(frozen=True, eq=False, slots=True)
class KPIFit:
    """What is known about a person who judges by KPIs."""

    bank: Bank  # KPIs of all experiments, a row for each θ
    # Rows of the experiments that KPIs are modeled through, see `Subset`, shape (K,)
    kept: Int[np.ndarray, " K"]
    scale: Scale  # how KPIs are measured; without names if there is no KPI to learn from
    utilities: Utilities  # draws of what the person wants

    def row(self, theta: Sequence[float]) -> int:
        """Return the place among the kept experiments of that with a physical θ, shape (n,)."""
        return int(np.flatnonzero(self.kept == self.bank.find(theta))[0])

    def costs(
        self, z: Float[np.ndarray, "m n"], rng: np.random.Generator, draws: int = _JUDGES
    ) -> Float[np.ndarray, "d all"]:
        """Return the costs of the kept experiments, then of new θ, in each draw, shape (d, K + m).

        Args:
            z: New points of the cube, shape (m, n).
            rng: Generator of the KPIs that they may have.
            draws: Number d of draws.
        """
        some = self.utilities.take(np.arange(0, len(self.utilities), len(self.utilities) // draws))
        # In each draw θ without a run have KPIs of their own, correlated with those that ran.
        points, rows = np.vstack([self.bank.z[self.kept], z]), np.arange(len(self.kept))
        known = self.scale(self.bank, self.kept.tolist())
        return some.costs(draw_on_plant(points, None, rows, known, len(some), rng))

    def beaten_by(self, z: Float[np.ndarray, "m n"], seed: int) -> Float[np.ndarray, " m"]:
        """Return the expected share of the kept experiments that are better than new θ, (m,)."""
        found = []
        for part in np.array_split(z, len(z) // _AT_ONCE + 1):
            costs = self.costs(part, np.random.default_rng(seed), _SHOWN)
            # Within each draw: costs of two draws have no common unit.
            known, new = costs[:, : len(self.kept)], costs[:, len(self.kept) :]
            pairs = zip(np.sort(known), new, strict=True)
            found.append(np.mean([np.searchsorted(row, c) for row, c in pairs], axis=0))
        return np.concatenate(found) / len(self.kept)

    @property
    def teaches(self) -> bool:
        """Return whether there is a KPI to learn from."""
        return bool(self.scale.names)

    def explains(self, history: History) -> bool:
        """Return whether KPIs predict the answers of `history` about as well as θ does."""
        part = Subset.of(history).history
        return explains(part, Posterior.of(self.utilities, Lessons.of(self.bank, self.scale, part)))

    def find_doubted(self, history: History) -> tuple[int, int] | None:
        """Return the best sample and one that is probably better; None if there is none.

        A wrong answer, or a difference too small to notice, can have cost it the lead. A pair that
        was asked before is left out. The later sample comes first. Ten answers are needed to tell.
        """
        best = history.incumbent
        if best is None or len(history.lessons) < AFTER:
            return None
        costs = self._of_samples(history)
        doubt = np.mean(costs < costs[:, [best]], axis=0)
        # Half a run cannot be compared with a whole one, and nobody has to look at an unsafe one again.
        doubt[[best, *history.unsafe, *history.cut_short]] = 0.0
        for rival in map(int, np.argsort(-doubt, kind="stable")):
            if doubt[rival] <= _DOUBT:
                return None
            if not history.asked(best, rival):
                return max(best, rival), min(best, rival)
        return None

    def values(self, history: History) -> Float[np.ndarray, " N"]:
        """Return the expected rank of each sample among all, shape (N,), 1 is the best."""
        from scipy.stats import rankdata  # takes a third of a second to import

        return np.asarray(rankdata(self._of_samples(history), axis=1).mean(axis=0))

    def _of_samples(self, history: History) -> Float[np.ndarray, "s N"]:
        """Return the cost of each sample in each draw, shape (s, N)."""
        rows = self.bank.rows([s.theta for s in history.samples[: history.answered]])
        return self.utilities.costs(self.scale(self.bank, rows))


def kpi_fits(seed: int) -> Stages[KPIFit]:
    """Return the fits of a study, by its record; `seed` is that of all randomness."""
    return Stages(partial(_first, seed), partial(_follow, seed), _MOST)


def _first(seed: int) -> KPIFit:
    bank = Bank.of(np.zeros((0, 0)), np.zeros((0, 0)), KPIValues.of([]))
    scale = Scale.of(bank, np.arange(0))
    return KPIFit(bank, np.arange(0), scale, _draw(scale, _rng(seed, History())))


def _restore_fit(past: History, draws: bytes) -> KPIFit | None:
    """Return the fit after `past` that an earlier session kept the draws of; None if they do not fit."""
    bank, part = _experiments(past), Subset.of(past).history
    scale = Scale.of(bank, np.arange(len(bank)))
    utilities = Utilities.of_bytes(draws, len(scale.names))
    return None if utilities is None else _fit(bank, part, scale, utilities)


def _draw(scale: Scale, rng: np.random.Generator) -> Utilities:
    return Utilities.draw(scale, DRAWS, rng, mistakes=SURE)


def _follow(seed: int, past: History, before: History, fit: KPIFit) -> KPIFit:
    """Return the fit after `past`, given that after `before`, a step earlier."""
    bank, rng, utilities = _experiments(past), _rng(seed, past), fit.utilities
    scale, part = Scale.of(bank, np.arange(len(bank))), Subset.of(past).history
    if scale.names != fit.scale.names:  # a KPI was always the same before: begin again
        before, utilities = History(), _draw(scale, rng)
    # An unsafe run teaches even without an answer: it is worse than all others.
    if scale.names and (past.lessons or past.unsafe):
        old = Lessons.of(bank, scale, Subset.of(before).history)
        new = Lessons.of(bank, scale, part)
        utilities = Posterior.of(utilities, old).update(new, scale, rng, SURE).utilities
    return _fit(bank, part, scale, utilities)


def _fit(bank: Bank, part: History, scale: Scale, utilities: Utilities) -> KPIFit:
    # Processes cost the cube of their points: only what the memory keeps enters them.
    return KPIFit(bank, np.unique(bank.rows([s.theta for s in part.samples])), scale, utilities)


def _experiments(history: History) -> Bank:
    """Return the KPIs of all experiments; see `fill_kpis`."""
    z = cube_of(history)
    thetas = np.array([s.theta for s in history.samples[: history.answered]], dtype=float)
    return Bank.of(z, thetas.reshape(z.shape), fill_kpis(history))


def _rng(seed: int, past: History) -> np.random.Generator:
    return np.random.default_rng([seed, past.answered, len(past.follow_ups), _STREAM])


def most_promising(
    setup: GLISpSetup, history: History, fit: KPIFit, penalty: Penalty | None, rng: np.random.Generator
) -> Float[np.ndarray, " n"]:
    """Return the point of the cube to run next, shape (n,): the best one for `expected_best`.

    GLISp, rule 3.

    Source: Z. J. Lin et al., "Preference exploration for efficient Bayesian optimization with
    multiple outcomes" (2022): a process for each KPI, draws of what the person wants.
    Deviation: draws follow `Utilities`, and the choice is that of `Screening`. The θ to choose from
    are a few steps from the best one, whose length is that of an evolution strategy: processes
    through a few dozen experiments predict the effect of friction, delays and stages badly, so that
    the best of hundreds of θ is the one about which they are most wrong (docs/research/kpis.md).

    Args:
        setup: Knobs to tune, and how many experiments the start has.
        fit: What is known about the person.
        penalty: Penalty for places that are likely unsafe; those with one come last.
        rng: Generator of the θ to choose from, and of the draws.
    """
    space, best = setup.space, history.samples[history.incumbent or 0]
    length = max(step_length(history, setup.n_init), _SHORTEST)
    points = _steps(space, np.array(best.z), length, rng)
    risk = np.zeros(len(points)) if penalty is None else penalty(points)
    fine = np.atleast_1d(space.allows(space.decode_all(points))) & (risk == 0.0)
    if not fine.all():  # random θ take their place, or a best θ at an unsafe place would hold all steps there
        others = space.snap_all(random_points(space, int(np.count_nonzero(~fine)), rng))
        points = np.vstack([points[fine], others])
        risk = np.zeros(len(points)) if penalty is None else penalty(points)
    value = expected_best(fit.costs(points, rng), fit.row(best.theta))[len(fit.kept) :]
    # Risk first: a promising θ that is likely unsafe comes after all that are not.
    ranked = points[np.lexsort((-value, risk))]
    tried = Tried(space, history)
    found = tried.first_new(ranked)
    return tried.fresh(ranked[0], rng) if found is None else found


def _steps(
    space: KnobSpace, best: Float[np.ndarray, " n"], length: float, rng: np.random.Generator
) -> Float[np.ndarray, "s n"]:
    """Return normal steps from the best θ, shape (s, n)."""
    low, high = space.corners
    return space.snap_all(np.clip(best + length * rng.standard_normal((_STEPS, len(space))), low, high))


# --- Test whether some answers are wrong, and choose the shape of φ that suits such answers.

MANY = 100
"""Number of experiments or comparisons from which on choosing the shape of φ is slow and hardly
changes it."""
ALMOST_SURE = 0.003
"""Error rate of a person who is hardly ever wrong. With 0, possibly no surrogate would fit."""
WINDOW = 10
"""Number of tests to average, since a cost that jumps looks like mistakes for a while. With a
single test, calibrators of the reactor who are never wrong often counted as noisy, which cost
experiments."""
_ENOUGH = 1.0  # minimum gain in log probability that counts as a difference, in nats
_EPSILONS = (0.32, 0.56, 1.0, 1.8, 3.2, 5.6)


@dataclass(frozen=True, slots=True)
class NoiseTest:
    """Result of comparing two explanations of the answers: some are wrong, or none are."""

    shape: Shape  # shape of φ that predicts the answers of a fallible person best
    evidence: float  # mean of the latest log likelihood ratios (nats); above 0 speaks for mistakes

    @property
    def suspects(self) -> bool:
        """Return whether mistakes are much more likely than none."""
        return self.evidence > _ENOUGH


def evidence_of_mistakes(preferences: Preferences, shape: Shape, error_rate: float) -> float:
    """Return the log likelihood ratio (nats) of a fallible person to one who is never wrong.

    Each answer is predicted from all others.
    """
    if not np.any(preferences.b):
        return 0.0
    # Both explanations with the same φ: another width would be a third explanation.
    constraints = rows_of(preferences, shape)
    fallible = ExpectationPropagation.of(constraints, error_rate)
    sure = ExpectationPropagation.of(constraints, ALMOST_SURE, fallible.sites)
    return fallible.predicted - sure.predicted


def choose_shape(
    preferences: Preferences, shape: Shape, error_rate: float, *, answered: int, first: bool
) -> Shape:
    """Return the shape next to `shape` with which a fallible person's answers are predicted best.

    ε moves to a neighbor (with `first` anywhere), and the scale of one knob by a factor of 2 (the
    knobs take turns, by the number of experiments `answered`).
    """
    if not np.any(preferences.b) or len(preferences) > MANY:
        return shape

    start: Sites | None = None

    def score(shape: Shape) -> float:
        nonlocal start  # each fit starts from the last sites, which saves a third of the time
        fit = ExpectationPropagation.of(rows_of(preferences, shape), error_rate, start)
        start = fit.sites
        return fit.predicted

    # A neighbor at most: each candidate is a fit, and one answer hardly moves the best width.
    candidates = _EPSILONS if first else nearest(_EPSILONS, shape.epsilon, 1)
    best, epsilon = max((score(replace(shape, epsilon=x)), x) for x in candidates)
    turn = answered % len(shape.scales)
    suited = replace(shape, epsilon=epsilon)
    return rescale_knob(suited, best, turn, lambda changed: (changed, score(changed)))


def rows_of(preferences: Preferences, shape: Shape) -> Constraints:
    """Return comparisons as signs of rows · β."""
    features = shape.basis(preferences.samples, preferences.samples)
    return Constraints.of(preferences, features, np.ones(len(preferences.b)))


# --- Select the models of GLISp after each experiment (shapes of φ, noise test), and train Ĵ.

FEW = 20  # number of experiments before the process takes turns
_TESTED = 5  # number of experiments between two tests of whether KPIs explain the answers
SELDOM = 10  # number of experiments between two validations, or two noise tests, from then on
_SHAPE_AT = 5  # of ten; noise tests are at 0, so no proposal waits for both


@dataclass(frozen=True, slots=True)
class Dataset:
    """The training data in a history."""

    history: History  # all samples and answers
    # Numbers of the samples that models are trained on, increasing, shape (K,); see `Subset`
    kept: Int[np.ndarray, " K"]
    preferences: Preferences  # comparisons of these samples

    @classmethod
    def of(cls, history: History) -> "Dataset":
        """Extract what `history` teaches."""
        memory = Subset.of(history)
        return cls(history, memory.kept, Preferences.of(memory.history))

    @property
    def is_strict(self) -> bool:
        """Return whether some answer says which of two samples is better."""
        return bool(np.any(self.preferences.b))


@dataclass(frozen=True, slots=True)
class Selection:
    """Selected settings of the models after a number of experiments."""

    shape: Shape  # shape of φ, chosen by cross-validation
    noise: NoiseTest | None  # result of the noise test; None while there are too few answers
    # Whether answers are treated as possibly wrong. This takes two things: some contradict each other, and
    # the noise test suspects mistakes. A suspicion alone only leads to a question, since a cost that jumps
    # looks like mistakes, too.
    is_noisy: bool


@dataclass(frozen=True, slots=True)
class Fit:
    """What GLISp has learned from a history: the data and selections to train its models with."""

    data: Dataset  # training data in the history
    selection: Selection  # selected settings of the models
    # What is known about a person who judges by KPIs; None if they do not explain the answers, or are not
    # used
    kpis: KPIFit | None


@dataclass(frozen=True, slots=True, eq=False)
class _Shapes:
    """What is chosen after a number of experiments: φ by cross-validation, and for a fallible person.

    `tested` is `suited` at the latest noise test. `tests` return the evidence of the latest ones, the
    last one first, once it is needed, since a study that is opened needs few of them.
    """

    shape: Shape
    suited: Shape
    tested: Shape | None = None
    tests: tuple[Callable[[], float], ...] = ()


@dataclass(frozen=True, slots=True)
class KeptShapes:
    """Fields of `_Shapes` as they are kept between sessions: tests as their evidence."""

    shape: Shape
    suited: Shape
    tested: Shape | None
    evidence: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Learned:
    """What takes long to learn, to keep it between sessions: all by the key of its record."""

    draws: dict[bytes, bytes] = field(default_factory=dict)  # numbers of `Utilities`
    shapes: dict[bytes, KeptShapes] = field(default_factory=dict)  # chosen shapes of φ


@final
class ModelSelection:
    """Selections after each number of experiments, each starting from the one before.

    They follow from the history alone, and copies of an agent share them: memory only saves time.
    """

    def __init__(self, setup: GLISpSetup) -> None:
        self.setup, settings, alike = setup, setup.settings, (1.0,) * len(setup.space)
        self._settings, self._n_init, self._seed = settings, setup.n_init, setup.seed
        self._learning = Learning(margin_power=settings.margin_power)
        self._candidates: Sequence[float] = tuple(settings.epsilon * factor for factor in EPSILONS)
        first = _Shapes(Shape(settings.epsilon, alike, settings.rbf), Shape(1.0, alike, settings.rbf))
        self._stages = Stages(lambda: first, self._follow, whole=True)
        self._kpi_fits = kpi_fits(setup.seed) if settings.kpis else None
        self.dataset = Remembered(Dataset.of)
        """Training data in a history."""
        self.after = Remembered(self._selection)
        """What is selected after a history."""
        self._explained = Remembered(self._explains)

    def remember(self, history: History) -> Learned:
        """Return what later sessions can recall of `history`."""
        found = Learned()
        if self._kpi_fits is not None:
            for key, fit in self._kpi_fits.worth_keeping(judged(history)):
                found.draws[key] = fit.utilities.to_bytes()
        for key, stage in self._stages.worth_keeping(history):
            evidence = tuple(test() for test in stage.tests)
            found.shapes[key] = KeptShapes(stage.shape, stage.suited, stage.tested, evidence)
        return found

    def recall(self, learned: Learned) -> None:
        """Use what an earlier session learned, where the record is still the same."""

        def stage(past: History) -> _Shapes | None:
            kept = learned.shapes.get(past.key)
            if kept is None:
                return None
            tests = tuple(partial(float, evidence) for evidence in kept.evidence)
            return _Shapes(kept.shape, kept.suited, kept.tested, tests)

        def fit(past: History) -> KPIFit | None:
            draws = learned.draws.get(past.key)
            return None if draws is None else _restore_fit(past, draws)

        self._stages.recalled = stage
        if self._kpi_fits is not None:
            self._kpi_fits.recalled = fit

    def fit(self, history: History) -> Fit:
        """Return what is learned from `history`."""
        return Fit(self.dataset(history), self.after(history), self.kpi_fit(history))

    def kpi_fit(self, history: History) -> KPIFit | None:
        """Return what KPIs teach after `history`; None if they do not explain the answers."""
        if self._kpi_fits is None or not history.kpis.names:
            return None
        history = judged(history)
        fit = self._kpi_fits(history)
        if not fit.teaches or not history.lessons:
            return None
        then = history.until(history.answered - history.answered % _TESTED)
        return fit if self._explained(then) else None

    def knows(self, history: History) -> bool:
        """Return whether what KPIs teach after `history` is remembered, so that it takes no time."""
        return self._kpi_fits is None or judged(history) in self._kpi_fits

    def _explains(self, history: History) -> bool:
        """Return whether KPIs explain the answers of `history`."""
        return self._kpi_fits is None or self._kpi_fits(history).explains(history)

    def _selection(self, history: History) -> Selection:
        stage = self._stages(history)
        if stage.tested is None:
            return Selection(stage.shape, None, is_noisy=False)
        noise = NoiseTest(stage.tested, float(np.mean([test() for test in stage.tests])))
        # A cost that jumps looks like mistakes, too: only a contradiction proves one.
        noisy = noise.suspects and contradictory(history.verdicts())
        return Selection(stage.shape, noise, noisy)

    def _follow(self, past: History, before: History, stage: _Shapes) -> _Shapes:
        """Return what is chosen after `past`, given that after one experiment less."""
        count, rate = past.answered, self._settings.error_rate
        validates = self._is_validated(count)
        # In long studies, a noise test runs every ten experiments, and its shape is settled.
        settled = count > MANY and len(past.lessons) > MANY and count % SELDOM
        fallible = rate and count >= self._n_init
        if not validates and (settled or not fallible):
            return stage
        data = self.dataset(past)
        shape = self._validate(data, stage.shape) if validates else stage.shape
        if not fallible:
            return replace(stage, shape=shape)
        known, first = data.preferences, count == self._n_init
        suited = choose_shape(known, stage.suited, rate, answered=count, first=first)
        if count > MANY and count % SELDOM:
            return replace(stage, shape=shape, suited=suited)
        test: Callable[[], float] = cache(partial(evidence_of_mistakes, known, suited, rate))
        tests = (test, *stage.tests[: WINDOW - 1])
        return _Shapes(shape, suited, suited if data.is_strict else None, tests)

    def _is_validated(self, count: int) -> bool:
        """Return whether the shape is chosen again after `count` experiments.

        "every step" leaves out the turns of the process. Beyond `MOST` experiments the shape
        stays, because some of the answers that it was chosen by are no longer used.
        """
        at = self._settings.validate_at
        if at != EVERY_STEP:
            return count in at
        if count < self._n_init:
            return False
        if count > MANY:
            return count <= MOST and count % SELDOM == _SHAPE_AT
        return not (self._settings.process and is_process_turn(count, self._n_init))

    def _validate(self, data: Dataset, shape: Shape) -> Shape:
        """Return the better shape that cross-validation finds next to `shape`."""
        comparisons, count = len(data.preferences), data.history.answered
        if comparisons < FOLDS:
            return shape
        # A stream of its own (1), so that dealing folds does not change what is proposed.
        rng = np.random.default_rng([self._seed, count, 1])
        validation = Validation.deal(data.preferences, self._learning, rng)
        candidates, reach = self._candidates, 1
        if comparisons > MANY:  # ε hardly changes any more, and each try takes tens of milliseconds
            candidates, reach = nearest(candidates, shape.epsilon, 1), 0
        shape, score = choose_epsilon(validation, shape, candidates)
        if not self._settings.rescale:
            return shape

        def judge(rescaled: Shape) -> tuple[Shape, float]:
            return choose_epsilon(validation, rescaled, around)

        around = nearest(candidates, shape.epsilon, reach)
        return rescale_knob(shape, score, self._validations(count) % len(shape.scales), judge)

    def _validations(self, count: int) -> int:
        """Return about how many validations there have been: none at the process's turns."""
        if count > MANY:
            return count // SELDOM
        turns = process_turns(count, self._n_init) if self._settings.process else 0
        return count - turns


def is_process_turn(answered: int, n_init: int) -> bool:
    """Return whether the process makes the proposal after `answered` experiments.

    Source: none; the paper minimizes one acquisition at every step.
    Deviation: one kind of proposal keeps returning to the same place when it is wrong, so from
    `FEW` experiments on every second proposal is the process's. Before that the process settles
    too soon on one of many valleys.

    Args:
        answered: Number of answered experiments, `n_init` or more.
        n_init: Number of experiments in the initial design.
    """
    since = answered - max(n_init, FEW)
    return since >= 0 and since % 2 == 1


def process_turns(answered: int, n_init: int) -> int:
    """Return how many proposals before the one after `answered` experiments were the process's."""
    return max(0, answered - max(n_init, FEW)) // 2


def train(data: Dataset, selection: Selection, settings: GLISpSettings) -> Surrogate:
    """Return Ĵ, trained on `data` with the selected shape and weights: GLISp, rule 4.

    Source: eq. QP-pref.
    Deviation: if answers may be wrong (`is_noisy`), Ĵ need not reproduce all; see
    `ExpectationPropagation`.
    """
    if selection.is_noisy:
        assert selection.noise is not None
        shape, posterior = selection.noise.shape, trust(data, selection, settings.error_rate)
        return Surrogate(data.preferences.samples, posterior.mean, shape)
    preferences, shape = data.preferences, selection.shape
    margin = margins(preferences, settings.margin_power)
    features = shape.basis(preferences.samples, preferences.samples)
    constraints = Constraints.of(preferences, features, margin)
    v = fit(constraints, Learning(margin_power=settings.margin_power))
    return Surrogate(preferences.samples, v, shape)


def trust(data: Dataset, selection: Selection, error_rate: float) -> ExpectationPropagation:
    """Return the posterior of β if each answer is wrong with probability `error_rate`."""
    assert selection.noise is not None
    rows = rows_of(data.preferences, selection.noise.shape)
    return ExpectationPropagation.of(rows, error_rate)
