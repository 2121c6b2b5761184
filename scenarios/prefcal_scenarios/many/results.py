"""What remains of one experiment of many: its KPIs, or why there are none."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.experiments.experiment import End, Experiment, FrozenMapping


@dataclass(frozen=True, eq=False, slots=True)
class Simulated:
    """An experiment without its trajectories.

    Args:
        theta: Controller parameters that ran, physical, shape (n,).
        end: Why the run ended.
        kpis: Key performance indicators by name; the scenario knows their units.
        solved: Whether the controller's problem was solved in every step.
    """

    theta: Float[np.ndarray, " n"]
    end: End
    kpis: Mapping[str, float]
    solved: bool

    def __post_init__(self) -> None:
        object.__setattr__(self, "theta", _frozen(self.theta))
        object.__setattr__(self, "kpis", FrozenMapping(self.kpis))

    def __reduce__(self) -> tuple[Any, ...]:  # unpickled arrays could be written to
        return type(self), (self.theta, self.end, dict(self.kpis), self.solved)

    @classmethod
    def of(cls, experiment: Experiment) -> "Simulated":
        """Return what remains of `experiment`."""
        kpis = {name: float(value) for name, value in experiment.kpis.items()}
        runs = experiment.runs or (experiment,)
        return cls(experiment.theta, experiment.end, kpis, all(bool(r.solved.all()) for r in runs))


@dataclass(frozen=True, eq=False, slots=True)
class FailedRun:
    """A run that produced no experiment. Like an experiment, it has θ, an end and KPIs (none).

    Args:
        theta: Controller parameters, physical, shape (n,).
        why: "raised" if the code raised an error, "died" if its process ended, "late" if it took
            too long.
        words: Message for people that says what happened.
        trace: Traceback of the code; empty if there is none.
    """

    theta: Float[np.ndarray, " n"]
    why: str
    words: str
    trace: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "theta", _frozen(self.theta))

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.theta, self.why, self.words, self.trace)

    @property
    def end(self) -> End:
        """Return `End.FAILED`."""
        return End.FAILED

    @property
    def kpis(self) -> Mapping[str, float]:
        """Return no KPIs."""
        return FrozenMapping()

    @property
    def solved(self) -> bool:
        """Return False: no step is known to be solved."""
        return False


Result = Simulated | Experiment | FailedRun
"""What `simulate_many` returns for one θ; an `Experiment` only if trajectories are wanted."""


def _frozen(theta: Any) -> Float[np.ndarray, " n"]:
    copy = np.array(theta, dtype=float)
    copy.setflags(write=False)
    return copy
