"""Start from the best θ of an earlier study: `prefcal calibrate SCENARIO --from STUDY`."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import KnobError, PrefcalError, SettingsError, StudyError
from prefcal_env.knobs.space import KnobSpace
from prefcal_scenarios.app.cli.studies.files import existing, open_described
from prefcal_scenarios.app.session.memory import earlier_of

from .choices import Thetas
from .options import Options

_SAME = 1e-9  # tolerance per knob, in the unit cube, for θ that differ only by rounding


@dataclass(frozen=True, slots=True)
class Taken:
    """Best θ of an earlier study, recorded in the new study, which then no longer needs the file.

    Args:
        study: Name of the earlier study, as typed.
        scenario: Name of the scenario that it calibrates.
        experiments: Number of its answered experiments.
        theta: Best θ as a physical θ of the new space, of length n.
    """

    study: str
    scenario: str
    experiments: int
    theta: tuple[float, ...]

    def as_dict(self) -> dict[str, Any]:
        """Return plain data for the configuration of the new study."""
        return {
            "study": self.study,
            "scenario": self.scenario,
            "experiments": self.experiments,
            "thetas": [list(self.theta)],
        }

    def beside(self, mine: Thetas, space: KnobSpace) -> list[Float[np.ndarray, " n"]]:
        """Return the θ in a list, which is empty if the θ is among `mine`."""
        theta = np.array(self.theta)
        z = space.encode(theta)
        known = any(np.allclose(z, space.encode(other), 0, _SAME) for other in mine)
        return [] if known else [theta]


def taken_from(options: Options, space: KnobSpace, mine: Thetas) -> Taken | None:
    """Return the best θ of the earlier study in `--from`; None without the option.

    A knob that the earlier study did not have takes its value from the first θ in `mine`.

    Args:
        options: Options of the new study.
        space: Knobs of the new study.
        mine: Other physical θ that the new study starts with, each of shape (n,).

    Raises:
        StudyError: If there is no such study, or it has no answered experiment.
        KnobError: If a knob has no value or another unit.
        SettingsError: If the constraints exclude the best θ, or no experiment is left for it.
    """
    name = options.earlier
    if name is None:
        return None
    with open_described(existing(name)) as file:
        state = file.state
    try:
        earlier = earlier_of(state)
    except PrefcalError as error:
        raise StudyError(f"nothing can be taken from study {name!r}: {error}") from error
    added = dict(zip(space.names, map(float, mine[0]), strict=True)) if len(mine) else {}
    missing = earlier.missing(space, added)
    if missing:
        raise KnobError(
            f"study {name!r} has no knobs {missing}: give their values with --start as well"
        )
    if options.n_max <= len(mine):
        raise SettingsError("every experiment has its θ: leave --from out, or increase --n-max")
    theta = earlier.start(space, added=added)
    if theta is None:
        raise SettingsError(
            f"the constraints refuse the best θ of study {name!r}: leave --from out, or give a θ "
            "that they allow with --start"
        )
    return Taken(name, str(state.configuration["name"]), state.history.answered, theta)
