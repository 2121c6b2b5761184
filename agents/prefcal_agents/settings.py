"""The settings of GLISp, checked at birth; the paper's are one call away."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Any, Literal

from prefcal_env.errors import SettingsError

from .checks import choice, integer, number
from .fitting import Learning
from .minimise import Minimiser, multistart, particle_swarm
from .rbf import RADIAL_FUNCTIONS
from .surrogate import Shape

EVERY_STEP: Literal["every step"] = "every step"
MINIMISERS: dict[str, Minimiser] = {
    "multistart": multistart,
    "particle_swarm": particle_swarm,
}

_BEFORE = {"outcome_scales": (0.0,), "expected_improvement": False, "process": False}
"""What a state that does not name these settings was saved with."""
_GONE = {"kernel": False, "trust_region": 0.0}
_GONE_WITH_THEM = ("kernel_epsilons", "trend")


@dataclass(frozen=True, slots=True, kw_only=True)
class GLISpSettings:
    """What GLISp does between two answers. The defaults are those measured best.

    Source: sections III and IV of the paper.
    Deviation: the paper validates ε after 10, 20, 30 and 40 experiments and has no `rescale`,
    `margin_power` or `process`. `GLISpSettings.paper()` turns all of these off.
    Gaps with and without them: docs/benchmarks.md, rows GLISp and GLISp.paper.

    Args:
        expected_improvement: Whether, where KPIs count, eq. acquisition gives way to the expected
            improvement on a Gaussian process through the values that Ĵ has at the samples.
            Measured in docs/research/improvement.md.
        delta: δ of eq. acquisition, 0 or more; 0 trusts the surrogate, well above 1 explores.
        rbf: φ of eq. rbf, a key of `RADIAL_FUNCTIONS`.
        sigma: σ of eq. QP-pref, above 0.
        lam: λ of eq. QP-pref, 0 or more; the QP divided by σ has λσ, so 1 at σ = 1e-6 keeps all
            preferences that can be kept.
        error_rate: Chance that an answer is wrong, below 0.5, that is reckoned with once answers
            contradict each other; 0: never. Measured in docs/research/noise.md.
        epsilon: ε of eq. rbf before the first cross-validation, above 0, in the unit cube.
        epsilons: Multiples of `epsilon` among which cross-validation chooses, increasing.
        folds: K of the cross-validation, 2 or more.
        validate_at: Numbers of experiments after which ε is chosen anew, or "every step", which is
            every one at which the surrogate has a turn.
        rescale: Whether each cross-validation also tries whether one knob (they take turns)
            should count more or less in the distances.
        margin_power: How the margin of a strict preference grows with the distance of its two
            samples; 0: it is σ for all, as in eq. RBF-pref.
        strong_margins: Whether the strength of a preference multiplies its margin; if not, it is
            only its weight c_h.
        process: Whether every second proposal, from 20 experiments on, minimises the mean of a
            Gaussian process that follows the answers, in place of eq. acquisition; see
            `PreferenceProcess`. Measured in docs/research/process.md.
        outcome_scales: By how much the KPIs that come with the answers may count beside θ, 0 or
            more, increasing; cross-validation chooses. (0,) leaves them out.
        unsafe_weight: What a place costs that is surely unsafe by the marks so far, in units of
            ΔĴ, 0 or more; 0 leaves that mark out.
        least_safe: Chance of being safe, above 0 and below 1, from which on a place costs
            nothing; it is raised for a while after each unsafe experiment.
        good_weight: What a place costs that is surely not good enough, as `unsafe_weight`.
        minimiser: Of eq. xNp1: "multistart" or "particle_swarm".
        questions_per_experiment: Most comparisons for each experiment, 1 or more; those beyond
            the first place it among the experiments that have run, or ask whether the best is
            really the best where answers contradict each other.

    Raises:
        SettingsError: an impossible value.
    """

    expected_improvement: bool = True
    delta: float = 0.3
    rbf: str = "inverse_quadratic"
    sigma: float = 1e-6
    lam: float = 1.0
    error_rate: float = 0.1
    epsilon: float = 1.0
    epsilons: tuple[float, ...] = (0.1, 0.18, 0.32, 0.56, 1.0, 1.8, 3.2, 5.6, 10.0)
    folds: int = 3
    validate_at: tuple[int, ...] | Literal["every step"] = EVERY_STEP
    rescale: bool = True
    margin_power: float = 1.0
    strong_margins: bool = True
    process: bool = True
    outcome_scales: tuple[float, ...] = (0.0, 0.3, 1.0, 3.0, 10.0)
    unsafe_weight: float = 30.0
    least_safe: float = 0.9
    good_weight: float = 0.1
    minimiser: str = "multistart"
    questions_per_experiment: int = 1

    def __post_init__(self) -> None:
        _flag("expected_improvement", self.expected_improvement)
        number("delta", self.delta)
        choice("rbf", self.rbf, RADIAL_FUNCTIONS)
        number("sigma", self.sigma, strict=True)
        number("lam", self.lam)
        number("error_rate", self.error_rate)
        if self.error_rate >= 0.5:
            raise SettingsError(f"error_rate must be below 0.5, got {self.error_rate!r}")
        number("epsilon", self.epsilon, strict=True)
        integer("folds", self.folds, low=2)
        _flag("rescale", self.rescale)
        _flag("strong_margins", self.strong_margins)
        number("margin_power", self.margin_power)
        number("unsafe_weight", self.unsafe_weight)
        number("least_safe", self.least_safe, strict=True)
        if self.least_safe >= 1:
            raise SettingsError(f"least_safe must be below 1, got {self.least_safe!r}")
        number("good_weight", self.good_weight)
        _flag("process", self.process)
        choice("minimiser", self.minimiser, MINIMISERS)
        integer("questions_per_experiment", self.questions_per_experiment, low=1)
        _increasing("epsilons", self.epsilons, strict=True)
        _increasing("outcome_scales", self.outcome_scales, strict=False)
        if self.validate_at != EVERY_STEP:
            _counts("validate_at", self.validate_at)

    @classmethod
    def paper(cls) -> "GLISpSettings":
        """The settings of section IV of the paper.

        Deviation: in [0, 1]^n, where the authors' code has [-1, 1]^n, δ = 0.3 explores as 0.02
        would there, while eq. IDW-distance is printed alike. docs/deviations.md has what it
        changes. That of `Memory`, too, in studies far longer than those of the paper.
        """
        return cls(
            expected_improvement=False,
            validate_at=(10, 20, 30, 40),
            rescale=False,
            margin_power=0.0,
            error_rate=0.0,
            strong_margins=False,
            process=False,
            outcome_scales=(0.0,),
            unsafe_weight=0.0,
            good_weight=0.0,
            minimiser="particle_swarm",
        )

    @property
    def learning(self) -> Learning:
        """How the weights of the surrogate are learned."""
        return Learning(self.sigma, self.lam, self.margin_power, self.strong_margins)

    def shape(self, n: int) -> Shape:
        """Shape of φ for `n` knobs before the first cross-validation."""
        return Shape(self.epsilon, (1.0,) * n, self.rbf)

    @property
    def candidates(self) -> Sequence[float]:
        """Values of ε among which cross-validation chooses, increasing."""
        return tuple(self.epsilon * factor for factor in self.epsilons)

    def pairs(self) -> tuple[tuple[str, Any], ...]:
        """Name and value of every setting, for an `AgentState`."""
        return tuple((f.name, getattr(self, f.name)) for f in fields(self))

    @classmethod
    def of(cls, pairs: tuple[tuple[str, Any], ...]) -> "GLISpSettings":
        """Read what `pairs` gave; a setting that is missing has its default.

        Without `outcome_scales`, `expected_improvement` or `process` it is of a time before these
        came: they are left out, so that the study goes on as it began. The former `soften` is
        `error_rate` now; 1 was off. The former `kernel` and `trust_region` are gone.

        Raises:
            SettingsError: an unknown setting, an impossible value, or one that is gone.
        """
        given = dict(pairs)
        if given.pop("soften", None) == 1.0:
            given.setdefault("error_rate", 0.0)
        for name, off in _GONE.items():
            if given.pop(name, off) != off:
                raise SettingsError(f"GLISp has no {name} any more, which this state has turned on")
        for name in _GONE_WITH_THEM:
            given.pop(name, None)
        unknown = set(given) - {f.name for f in fields(cls)}
        if unknown:
            raise SettingsError(f"GLISp has no settings called {sorted(unknown)}")
        return cls(**{**_BEFORE, **given})


def _flag(name: str, value: Any) -> None:
    if not isinstance(value, bool):
        raise SettingsError(f"{name} must be True or False, got {value!r}")


def _increasing(name: str, values: Any, *, strict: bool) -> None:
    if not isinstance(values, tuple) or not values:
        raise SettingsError(f"{name} must be a tuple of one or more numbers, got {values!r}")
    for value in values:
        number(f"each of {name}", value, strict=strict)
    if any(a >= b for a, b in pairwise(values)):
        raise SettingsError(f"{name} must increase, got {values!r}")


def _counts(name: str, values: Any) -> None:
    if not isinstance(values, tuple):
        raise SettingsError(
            f"{name} must be {EVERY_STEP!r} or a tuple of numbers of experiments, got {values!r}"
        )
    for value in values:
        integer(f"each of {name}", value, low=1)
