"""Define the settings of GLISp, checked on creation, including those of the paper."""

from dataclasses import dataclass
from typing import Any, Literal

from prefcal_agents.models.rbf import RADIAL_FUNCTIONS
from prefcal_agents.space.setup import Setup
from prefcal_agents.support.checks import Settings, choice, integer, number
from prefcal_env.errors import SettingsError

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
            _flag(name, getattr(self, name))
        for name in ("delta", "error_rate", "margin_power", "unsafe_weight"):
            number(name, getattr(self, name))
        for name in ("epsilon", "least_safe"):
            number(name, getattr(self, name), strict=True)
        for name, limit in (("error_rate", 0.5), ("least_safe", 1)):
            if getattr(self, name) >= limit:
                raise SettingsError(f"{name} must be below {limit}, got {getattr(self, name)!r}")
        choice("rbf", self.rbf, RADIAL_FUNCTIONS)
        integer("questions_per_experiment", self.questions_per_experiment, low=1)
        if self.validate_at != EVERY_STEP:
            _counts("validate_at", self.validate_at)

    @classmethod
    def paper(cls) -> "GLISpSettings":
        """Return the settings of section IV of the paper.

        Deviation: in [0, 1]^n, where the authors' code has [-1, 1]^n, δ = 0.3 explores as 0.02
        would there, although eq. IDW-distance is printed the same. docs/deviations.md says what
        that changes. `Memory` applies too, in studies far longer than those of the paper.
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


GLISpSetup = Setup[GLISpSettings]
"""Everything that stays the same during a study of GLISp."""


def _flag(name: str, value: Any) -> None:
    if not isinstance(value, bool):
        raise SettingsError(f"{name} must be True or False, got {value!r}")


def _counts(name: str, values: Any) -> None:
    if not isinstance(values, tuple):
        raise SettingsError(
            f"{name} must be {EVERY_STEP!r} or a tuple of numbers of experiments, got {values!r}"
        )
    for value in values:
        integer(f"each of {name}", value, low=1)
