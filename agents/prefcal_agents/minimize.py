"""Minimize by preference in five lines: all you need is a function that compares."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from prefcal_agents.glisp.agent import GLISp
from prefcal_agents.space.start import Start
from prefcal_agents.support.checks import integer
from prefcal_env.errors import SettingsError
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.answer import Agent, Answer, Preference
from prefcal_env.preferences.loop import ask_and_tell

Theta = Float[np.ndarray, " n"]
Prefer = Callable[[Theta, Theta], Answer | Preference | int | None]


@runtime_checkable
class AgentFactory(Protocol):
    """A callable that makes an agent: `GLISp`, `RandomSearch`, or a partial of one."""

    def __call__(self, space: KnobSpace, *, n_init: int, n_max: int, seed: int) -> Agent:
        """Create an agent for one study."""


@dataclass(frozen=True, slots=True, eq=False)
class Minimum:
    """The result of a study.

    Args:
        best: Best θ, physical, shape (n,).
        samples: All θ in the order tried, physical, shape (N, n).
        answers: N - 1 answers; answer h compares sample h + 1 with the best one before it.
    """

    best: Float[np.ndarray, " n"]
    samples: Float[np.ndarray, "N n"]
    answers: tuple[Answer, ...]

    def __post_init__(self) -> None:
        for array in (self.best, self.samples):
            array.setflags(write=False)


def minimize_by_preference(
    prefer: Prefer,
    space: KnobSpace,
    *,
    agent: AgentFactory = GLISp,
    n_init: int | None = None,
    n_max: int = 50,
    seed: int = 0,
    start: Start | None = None,
) -> Minimum:
    """Find the θ that `prefer` likes best, in `n_max` experiments.

    They take n_max - 1 comparisons, unless the agent asks several for each experiment.

    Args:
        prefer: Function `prefer(a, b)` of two θ, physical, shape (n,), that returns -1 if a is
            better, 1 if b is, 0 if they are equally good, None if it cannot tell, or an `Answer`.
        space: Space to search.
        agent: Class of the agent.
        n_init: Number of space-filling experiments before learning starts; min(10, n_max // 2) if
            None.
        n_max: Number of experiments, 2 or more.
        seed: Seed of all randomness.
        start: Physical θ to start from, shape (n,), or several; the agent must accept `start`.

    Raises:
        SettingsError: If a count or the seed is not valid.
        KnobError: If a θ of `start` is outside the space.
        PreferenceError: If `prefer` returned something else.
    """
    if not callable(prefer):
        raise SettingsError(f"prefer must be a function of two θ, got {prefer!r}")
    integer("n_max", n_max, low=2)
    if n_init is None:
        n_init = min(10, n_max // 2)
    warm: dict[str, Any] = {} if start is None else {"start": start}
    study = agent(space, n_init=n_init, n_max=n_max, seed=seed, **warm)
    steps = list(ask_and_tell(study, lambda theta: theta, partial(_answer, prefer)))
    samples = [step.challenger for step in steps if not step.query.further]
    answers = tuple(step.answer for step in steps if step.answer is not None)
    return Minimum(np.array(study.best), np.array(samples), answers)


def _answer(prefer: Prefer, new: Theta, old: Theta | None) -> Answer | None:
    """Ask `prefer`. It gets copies, since it may write into them."""
    return None if old is None else Answer.of(prefer(new.copy(), old.copy()))
