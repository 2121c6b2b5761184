"""Define the settings of GLIS, checked on creation."""

from dataclasses import dataclass

from prefcal_agents.models.interpolant import POSITIVE_DEFINITE
from prefcal_agents.support.checks import Settings, choice, number
from prefcal_env.errors import SettingsError


@dataclass(frozen=True, slots=True, kw_only=True)
class GLISSettings(Settings):
    """Configure how GLIS chooses the next experiment.

    Source: Bemporad 2020, sections 3 and 4.
    Deviation: α and δ are smaller than 0.8 and 0.5, which waste experiments far from the best
    (median of 6 seeds after 50 experiments: hartman6 0.08 against 0.20, camel 2e-5 against 6e-5,
    branin 3e-4 against 2e-3). ε is chosen at every step by leave-one-out errors, not fixed.
    Scores far above the median are capped (`ceiling`): an interrupted run costs a thousand times
    as much as a good one, and an interpolant through both cannot tell good ones apart
    (CSTR, median of 8 seeds: 0.695 with a ceiling of 2, 0.718 without).

    Args:
        alpha: Weight α of the IDW deviation, 0 or more; larger explores more.
        delta: Weight δ of the distance from all samples, 0 or more; larger explores more.
        rbf: Name of φ, one of `POSITIVE_DEFINITE`.
        epsilons: Values of ε to choose from, above 0, for the box scaled to [-1, 1].
        ceiling: A score counts as at most this many times (median - best) above the median.

    Raises:
        SettingsError: If a value is not valid.
    """

    alpha: float = 0.4
    delta: float = 0.2
    rbf: str = "inverse_quadratic"
    epsilons: tuple[float, ...] = (0.1, 0.18, 0.32, 0.56, 1.0, 1.8, 3.2)
    ceiling: float = 2.0

    def __post_init__(self) -> None:
        number("alpha", self.alpha)
        number("delta", self.delta)
        choice("rbf", self.rbf, POSITIVE_DEFINITE)
        number("ceiling", self.ceiling, strict=True)
        if not isinstance(self.epsilons, tuple) or not self.epsilons:
            raise SettingsError(f"epsilons must be a tuple of numbers, got {self.epsilons!r}")
        for epsilon in self.epsilons:
            number("each of epsilons", epsilon, strict=True)
