"""Minimize by preference in five lines: all you need is a function that compares."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from inspect import Parameter, signature
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from prefcal_agents.glisp.agent import GLISp
from prefcal_agents.screening.agent import Screening
from prefcal_env.arrays import integer
from prefcal_env.errors import SettingsError, SimulationError
from prefcal_env.knobs import KnobSpace
from prefcal_env.preferences.answer import Agent, Answer, Executor, Preference, ask_and_tell

from .agent import Start
from .people import Bank
from .screening.bank import Simulate

Theta = Float[np.ndarray, " n"]
Prefer = Callable[[Any, Any], Answer | Preference | int | None]

_SHOWN, _SHOWN_SCREENED = 50, 11  # default number of experiments to compare: without and with `simulate`


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
        samples: All θ in the order compared, physical, shape (N, n).
        answers: All answers in the order given: each sample but the first against the best one
            before it, and pairs that were asked about besides.
        simulated: θ that were simulated and their KPIs, among them all samples; None if nothing was
            simulated.
        knobs: Names of the knobs with their units, as headings of `to_frame`.
    """

    best: Float[np.ndarray, " n"]
    samples: Float[np.ndarray, "N n"]
    answers: tuple[Answer, ...]
    simulated: Bank | None = None
    knobs: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for array in (self.best, self.samples):
            array.setflags(write=False)

    def to_frame(self) -> Any:
        """Return the samples as a pandas DataFrame, one a row; a column marks the best."""
        import pandas as pd

        count = self.samples.shape[1]
        names = self.knobs or tuple(f"θ{i + 1}" for i in range(count))
        index = pd.RangeIndex(1, len(self.samples) + 1, name="experiment")
        frame = pd.DataFrame(self.samples, columns=list(names), index=index)
        return frame.assign(best=(self.samples == self.best).all(axis=1))

    def _repr_html_(self) -> str:
        """Return the best θ and all samples, for notebooks."""
        best = ", ".join(f"{value:.4g}" for value in self.best)
        words = f"Best θ = ({best}) after {len(self.samples)} experiments"
        table = self.to_frame().to_html(max_rows=60, float_format=lambda value: f"{value:.4g}")
        return f"<div><p>{words}, {len(self.answers)} answers</p>{table}</div>"


def minimize_by_preference(
    prefer: Prefer,
    space: KnobSpace,
    *,
    run: Callable[[Theta], Any] | None = None,
    at_once: int = 1,
    executor: Executor | None = None,
    simulate: Simulate | None = None,
    twin: Simulate | None = None,
    n_simulated: int = 1000,
    agent: AgentFactory | None = None,
    n_init: int | None = None,
    n_max: int | None = None,
    seed: int = 0,
    start: Start | None = None,
) -> Minimum:
    """Find the θ that `prefer` likes best, in `n_max` experiments.

    They take n_max - 1 comparisons, and some more if the agent asks about a pair again or compares
    an experiment with several others. If you can simulate, give `simulate`: then many θ are
    simulated unseen, and `prefer` compares only the few that its earlier answers leave undecided.
    If you only have a rough model of the plant, give it as `twin`, and let `prefer` run the plant
    and return an `Answer` whose `outcomes` are the measured KPIs: the model is corrected by them.

    Args:
        prefer: Function `prefer(a, b)` of two θ, physical, shape (n,), that returns -1 if a is
            better, 1 if b is, 0 if they are equally good, None if it cannot tell, or an `Answer`.
        space: Space to search.
        run: Function that runs the experiment of a θ, once each; `prefer` then compares what it
            returns. None if `prefer` compares the θ themselves.
        at_once: Number of experiments that `run` runs at the same time, 1 or more: for simulators
            that take minutes.
        executor: Executor that runs them, see `ask_and_tell`; threads if None.
        simulate: Function of one θ that returns KPIs by name, lower is better; None, an exception,
            or only NaN for a simulation that failed. An attribute `many` runs several at once; see
            `prefcal_agents.screening.bank`.
        twin: The same for a rough model of what `prefer` compares.
        n_simulated: Number of θ to simulate, used only with `simulate` or `twin`.
        agent: Class of the agent; `Screening` with one of these, else `GLISp`, if None.
        n_init: Number of space-filling experiments before learning starts; if None,
            min(10, n_max // 2), or 1 with `simulate` or `twin`.
        n_max: Number of experiments to compare, 2 or more; if None, 11 with `simulate` or `twin`,
            else 50.
        seed: Seed of all randomness.
        start: Physical θ to start from, shape (n,), or several; the agent must accept `start`.

    Raises:
        SettingsError: If a count or the seed is not valid, the agent takes no `simulate`, or both
            `simulate` and `twin` are given.
        SimulationError: If `simulate` or `twin` works for no θ, returns something else than KPIs,
            or has no KPI of the names in the `outcomes` of an answer.
        KnobError: If a θ of `start` is outside the space.
        PreferenceError: If `prefer` returned something else.
        RunError: If the worker of an experiment died twice, or a pool of processes broke.
    """
    if not callable(prefer):
        raise SettingsError(f"prefer must be a function of two θ, got {prefer!r}")
    if simulate is not None and twin is not None:
        raise SettingsError("give either simulate or twin, not both")
    simulate = twin if simulate is None else simulate
    _check_at_once(at_once, executor, runs=run is not None, simulates=simulate is not None)
    if n_max is None:
        n_max = _SHOWN if simulate is None else _SHOWN_SCREENED
    integer("n_max", n_max, low=2)
    if n_init is None:
        n_init = min(10, n_max // 2) if simulate is None else 1
    options: dict[str, Any] = {} if start is None else {"start": start}
    if simulate is not None:
        options |= {"simulate": simulate, "n_simulated": n_simulated}
    make = _maker(agent, simulates=simulate is not None)
    study = make(space, n_init=n_init, n_max=n_max, seed=seed, **options)
    answer = partial(_answer, prefer, None if twin is None else study)
    steps = list(ask_and_tell(study, run or np.copy, answer, at_once=at_once, executor=executor))
    samples = [step.query.challenger.theta for step in steps if not step.query.further]
    answers = tuple(step.answer for step in steps if step.answer is not None)
    bank = getattr(study, "bank", None)
    simulated = bank if isinstance(bank, Bank) else None
    knobs = tuple(f"{k.name} [{k.unit}]" if k.unit not in ("", "-") else k.name for k in space)
    return Minimum(np.array(study.best), np.array(samples), answers, simulated, knobs)


def _check_at_once(at_once: int, executor: Executor | None, *, runs: bool, simulates: bool) -> None:
    if not runs and (at_once != 1 or executor is not None):
        raise SettingsError("nothing runs at once without run, the function of an experiment")
    if simulates and at_once != 1:
        raise SettingsError(f"with simulate or twin, at_once must be 1, got {at_once!r}")


def _maker(agent: AgentFactory | None, *, simulates: bool) -> AgentFactory:
    """Return what makes the agent. Raises SettingsError if it cannot simulate but should."""
    if agent is None:
        return Screening if simulates else GLISp
    if simulates:
        takes = signature(agent).parameters
        # Here, since a TypeError from the constructor would not say that `simulate` is the reason.
        anything = any(p.kind is Parameter.VAR_KEYWORD for p in takes.values())
        if not anything and not {"simulate", "n_simulated"} <= set(takes):
            name = getattr(agent, "__name__", repr(agent))
            raise SettingsError(f"the agent {name} takes no simulate: leave one of the two out")
    return agent


def _answer(prefer: Prefer, told: Agent | None, new: Any, old: Any) -> Answer | None:
    """Ask `prefer`, and check what it tells `told`, an agent with a twin, of the plant.

    It gets copies of θ, since it may write into them.
    """
    if old is None:
        return None
    copies = (np.copy(side) if isinstance(side, np.ndarray) else side for side in (new, old))
    answer = Answer.of(prefer(*copies))
    bank = getattr(told, "bank", None)
    known = set(bank.names) if isinstance(bank, Bank) else set()
    # Without a common name the twin is never corrected, and nobody would notice.
    measured = {name for kpis in answer.outcomes or () for name in kpis or ()}
    if known and measured and not known & measured:
        raise SimulationError(
            "the twin and the answers must have KPIs of the same names, got "
            f"{', '.join(sorted(known))} simulated and {', '.join(sorted(measured))} measured"
        )
    return answer
