"""What a report is made of: a study's comparisons, and what follows from them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from math import inf

import numpy as np
from jaxtyping import Float

from prefcal_env.experiment import Experiment
from prefcal_env.preference import Answer, Preference
from prefcal_env.study import Comparison
from prefcal_scenarios.report.minded import Minded
from prefcal_scenarios.scenario import KPI, Scenario

Surrogate = Callable[[Float[np.ndarray, "m n"]], Float[np.ndarray, " m"]]
"""Learned latent cost of m physical θ; lower is better, only the order has a meaning."""

VERDICTS: Mapping[Preference | None, str] = {
    Preference.CHALLENGER: "new better",
    Preference.TIE: "as good",
    Preference.INCUMBENT: "best stays",
    None: "can't tell",
}
"""How a verdict reads, in the order in which people see the counts."""
_MUCH: Mapping[Preference | None, str] = {
    Preference.CHALLENGER: "new much better",
    Preference.INCUMBENT: "best stays, much better",
}


def verdict_text(answer: Answer) -> str:
    """How an answer reads, with its strength."""
    if answer.much_better:
        return _MUCH[answer.preference]
    return VERDICTS[answer.preference]


@dataclass(frozen=True, slots=True)
class Trial:
    """Experiment number `index` (from 0) and its cost; None where the scenario has no cost."""

    index: int
    experiment: Experiment
    cost: float | None

    @property
    def number(self) -> int:
        """Number as people count, from 1."""
        return self.index + 1


@dataclass(frozen=True)
class Record:
    """A study, complete or not, ready to be shown.

    Args:
        scenario: What was calibrated.
        source: The name that loads the scenario again.
        comparisons: In the order of the answers.
        references: Experiments of the scenario's reference θ, by name.
        settings: What the study was started with, name to value, for people.
        n_init: Number of experiments before anything was learned.
        n_max: Number of experiments that were planned.
        command: One command line that repeats the study.
        surrogate: What the agent has learned; None if it learns nothing.
        minded: What the calibrator seems to care about; None where nothing can be said.
        good_enough: Whether it was ended early because the best is good enough.
        further: Answers about two experiments that had both been compared before.
        advice: What further experiments would be expected to gain, in words; empty if not known.
        believed_best: Index of the best experiment, as the agent believes; None: the winner along
            the answers.
    """

    scenario: Scenario
    source: str
    comparisons: tuple[Comparison, ...]
    references: Mapping[str, Experiment] = field(default_factory=dict)
    settings: Mapping[str, str | int | float] = field(default_factory=dict)
    n_init: int = 10
    n_max: int = 50
    command: str = ""
    surrogate: Surrogate | None = None
    minded: Minded | None = None
    good_enough: bool = False
    further: tuple[Answer, ...] = ()
    advice: str = ""
    believed_best: int | None = None

    @cached_property
    def trials(self) -> tuple[Trial, ...]:
        """Every experiment once, in the order tried."""
        experiments: dict[int, Experiment] = {}
        for c in self.comparisons:
            if c.query.incumbent is not None and c.incumbent is not None:
                experiments.setdefault(c.query.incumbent.index, c.incumbent)
            experiments.setdefault(c.query.challenger.index, c.challenger)
        return tuple(Trial(i, e, self.cost(e)) for i, e in sorted(experiments.items()))

    @cached_property
    def thetas(self) -> Float[np.ndarray, "N n"]:
        """θ of every trial, physical, shape (N, n)."""
        return np.array([t.experiment.theta for t in self.trials]).reshape(
            -1, len(self.scenario.space)
        )

    @property
    def asked(self) -> tuple[Comparison, ...]:
        """The comparisons that the calibrator was asked: all but the first experiment's."""
        return tuple(c for c in self.comparisons if c.incumbent is not None)

    @property
    def questions(self) -> int:
        """How many questions the calibrator answered."""
        return 0 if self.scored else len(self.asked) + len(self.further)

    @property
    def scored(self) -> bool:
        """Whether the agent was told scores, and nobody compared anything."""
        return any(c.answer.value is not None for c in self.comparisons)

    @property
    def stopped(self) -> bool:
        """Whether the study ended before its planned number of experiments."""
        return len(self.comparisons) < self.n_max

    @cached_property
    def best(self) -> Trial | None:
        """The incumbent after the last comparison; None before any experiment."""
        return self.incumbents[-1] if self.comparisons else None

    @cached_property
    def incumbents(self) -> tuple[Trial, ...]:
        """The best trial after each comparison."""
        by_index = {t.index: t for t in self.trials}
        winner, winners = 0, []
        for c in self.comparisons:
            # Along the answers that stand: a retracted one is an abstention here, and whoever
            # had won by it may be the incumbent of later questions.
            if c.incumbent is None or c.answer.preference is Preference.CHALLENGER:
                winner = c.query.challenger.index
            winners.append(by_index[winner])
        if winners and self.believed_best is not None:
            winners[-1] = by_index[self.believed_best]
        return tuple(winners)

    @cached_property
    def reference_costs(self) -> dict[str, float]:
        """Cost of each reference, where the scenario has one."""
        costs = {name: self.cost(e) for name, e in self.references.items()}
        return {name: cost for name, cost in costs.items() if cost is not None}

    @property
    def kpis(self) -> tuple[KPI, ...]:
        """The scenario's KPIs, without the index itself: it is shown as the cost."""
        if self.scenario.cost is None:
            return self.scenario.kpis
        return tuple(k for k in self.scenario.kpis if k.name != "index")

    def cost(self, experiment: Experiment) -> float | None:
        """Latent cost of an experiment; None where the scenario has none.

        Infinite for a run without a record: nobody's cost can be asked of that.
        """
        if self.scenario.cost is None:
            return None
        return float(self.scenario.cost(experiment)) if len(experiment.t) else inf

    def verdict_counts(self) -> dict[str, int]:
        """How often each verdict was given, in words."""
        given = [a.preference for a in (*(c.answer for c in self.asked), *self.further)]
        return {words: given.count(verdict) for verdict, words in VERDICTS.items()}
