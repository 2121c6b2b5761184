"""What stays the same during a study."""

from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from prefcal_agents.support.checks import integer
from prefcal_env.errors import SettingsError
from prefcal_env.knobs.space import KnobSpace

from .start import Points

SettingsT = TypeVar("SettingsT")


@dataclass(frozen=True, slots=True)
class Setup(Generic[SettingsT]):
    """Everything that an agent's proposals follow from, besides the record.

    Args:
        space: Knobs to tune.
        n_init: Number of samples of the space-filling start, 1 or more.
        seed: Seed of all randomness, 0 or more; sample i draws from `(seed, i)`.
        settings: Further settings of the agent.
        n_max: Number of experiments asked for, 2 or more, and not below `n_init`.
        start: Points of the cube that replace the first proposed samples, each of length n.

    Raises:
        SettingsError: If a value is not valid.
    """

    space: KnobSpace
    n_init: int
    seed: int
    settings: SettingsT
    n_max: int = 50
    start: Points = ()

    def __post_init__(self) -> None:
        if not isinstance(self.space, KnobSpace):
            raise SettingsError(f"space must be a KnobSpace, got {self.space!r}")
        for name, low in (("n_init", 1), ("n_max", 2), ("seed", 0)):
            value: Any = getattr(self, name)
            integer(name, value, low=low)
            object.__setattr__(self, name, int(value))
        if self.n_max < self.n_init:
            raise SettingsError(f"n_max must not be below n_init, got {self.n_max} below {self.n_init}")
