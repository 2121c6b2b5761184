"""Configure the overtaking: another road, other traffic, another steering limit."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from prefcal_env.envs.overtake import OvertakeOptions
from prefcal_env.errors import SettingsError
from prefcal_env.mpc import EstimatorSettings
from prefcal_scenarios.scenario import Scenario

from . import wording as words
from .controller import PAPER, STEERING_LIMITS, Fixed
from .scenes import Scenes


@dataclass(frozen=True, slots=True)
class Study:
    """A configuration: the scene, and the settings of the study.

    Args:
        options: Options of the scene.
        fixed: MPC settings that are not tuned.
        scenes: Number of seeded scenes that each θ drives; the worst counts.
    """

    options: OvertakeOptions
    fixed: Fixed
    scenes: int

    @classmethod
    def of(cls, config: Mapping[str, Any], scenes: int) -> "Study":
        """Create it from plain data: `OvertakeOptions.of`, "scenes" and "steering_limit".

        Raises:
            SettingsError: If a key is unknown or a value has the wrong type.
        """
        scene = dict(config)
        count = scene.pop("scenes", scenes)
        if not isinstance(count, int) or isinstance(count, bool) or not 1 <= count <= 1000:
            raise SettingsError(f"scenes must be a whole number in [1, 1000], got {count!r}")
        limit = scene.pop("steering_limit", None)
        if limit is not None and limit not in STEERING_LIMITS:
            raise SettingsError(
                f"steering_limit must be one of {sorted(STEERING_LIMITS)}, got {limit!r}"
            )
        fixed = PAPER if limit is None else STEERING_LIMITS[limit]
        return cls(OvertakeOptions.of(scene), fixed, count)


def configured(
    scenario: Scenario,
    estimator: EstimatorSettings | None,
    scenes: int,
    config: Mapping[str, Any],
) -> Scenario:
    """Return `scenario` in the scene of `config`, in `scenes` seeded scenes unless it says more."""
    study = Study.of(config, scenes)
    made = Scenes((study.options,) * study.scenes, estimator, study.fixed).of(scenario)
    again = partial(configured, scenario, estimator, scenes)
    return replace(made, brief=words.CONFIGURED, configured=again)
