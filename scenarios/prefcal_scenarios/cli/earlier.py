"""What a new study takes over from an earlier one: `prefcal calibrate SCENARIO --from STUDY`."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import KnobError, PrefcalError, SettingsError, StudyError
from prefcal_env.knobs import KnobSpace
from prefcal_scenarios.cli.choices import Thetas
from prefcal_scenarios.cli.options import Options
from prefcal_scenarios.cli.study_files import existing, open_described
from prefcal_scenarios.interview.memory import earlier_of

_SAME = 1e-9  # distance along a knob, in the unit cube, of two θ that differ by rounding


@dataclass(frozen=True, slots=True)
class Taken:
    """What was taken over, and from where; the new study records it, and needs no more.

    Args:
        study: Name of the earlier study, as it was given.
        scenario: What that one calibrates.
        experiments: How many of its experiments are answered.
        thetas: Physical θ of the new space, the best one first, each of length n.
    """

    study: str
    scenario: str
    experiments: int
    thetas: tuple[tuple[float, ...], ...]

    def as_dict(self) -> dict[str, Any]:
        """Plain data, for the configuration of the new study."""
        return asdict(self)

    def beside(self, mine: Thetas, space: KnobSpace) -> list[Float[np.ndarray, " n"]]:
        """Its θ that are not among `mine`."""
        begun = [space.encode(theta) for theta in mine]
        return [
            np.array(theta)
            for theta in self.thetas
            if not any(np.allclose(space.encode(np.array(theta)), z, 0, _SAME) for z in begun)
        ]


def taken_from(options: Options, space: KnobSpace, mine: Thetas) -> Taken | None:
    """What the options take over from an earlier study; None if nothing was asked for.

    A knob that the earlier study did not have takes the value of the first θ of `mine`.

    Args:
        options: Of the new study.
        space: Of the new study.
        mine: θ that it begins with in any case, physical, each of shape (n,).

    Raises:
        StudyError: there is no such study, or it has no answered experiment.
        KnobError: a knob without a value, or in another unit.
        SettingsError: the constraints refuse every θ, or there is no experiment left for one.
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
            f"study {name!r} has no knobs {missing}: give --start as well, whose values they take"
        )
    if options.n_max <= len(mine):
        raise SettingsError("every experiment has its θ: leave --from out, or give more --n-max")
    thetas = earlier.start(space, added=added)
    if not thetas:
        raise SettingsError(f"the constraints refuse every best θ of study {name!r}")
    return Taken(name, str(state.configuration["name"]), len(state.closed), thetas)
