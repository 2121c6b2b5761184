"""Hold the content of a report: a study's comparisons, and what follows from them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import inf
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_app.session.study.now import GOOD_ENOUGH
from prefcal_app.session.study.study import ENOUGH
from prefcal_app.summary.counts import VERDICTS as VERDICTS
from prefcal_app.summary.outlook import Outlook
from prefcal_app.view.end import FIRST
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.own_line import in_words, located
from prefcal_env.preferences.loop import Comparison
from prefcal_scenarios.scenario import KPI, Scenario

Surrogate = Callable[[Float[np.ndarray, "m n"]], Float[np.ndarray, " m"]]
"""Learned latent cost of m physical θ; lower is better, only the order has a meaning."""


@dataclass(frozen=True, slots=True)
class Trial:
    """Experiment number `index`, from 0, and its cost; None if the scenario has no cost."""

    index: int
    experiment: Experiment
    cost: float | None

    @property
    def number(self) -> int:
        """Return the number as people count, from 1."""
        return self.index + 1


@dataclass(frozen=True)
class StudyRecord:
    """Study, complete or not, ready to be shown.

    Args:
        scenario: Calibrated scenario.
        source: Name that loads the scenario again.
        comparisons: Comparisons in the order of the answers.
        held: Index of the best experiment after each of `comparisons`; see `History.incumbents`.
        references: Experiments of the scenario's reference θ, by name.
        settings: Settings that the study was started with, by name, for people.
        agent_settings: All settings of the agent, by name.
        n_init: Number of experiments before anything was learned.
        n_max: Number of planned experiments.
        command: Command line that repeats the study.
        surrogate: Learned cost; None if the agent learns nothing.
        trust: How well a weighted sum of the KPIs predicts answers; empty if unknown.
        ended: Why the study ended, see `prefcal_env.study.Ended`; empty while it has not.
        answered: Comparisons whose answers stand, in order, including follow-up comparisons; None
            for all of `comparisons` but the first experiment's.
        waiting: Experiments that ran and are not compared yet, by index.
        judged: Whether the answers follow the scenario's cost; otherwise, the cost is not shown.
        outlook: Whether to continue; None if unknown.
        study: Name of the study; empty if it is not kept.
        dates: Times of the study's first and last event.
        baseline: What the first experiment is, with which the result is compared; see `baseline_of`.
        fingerprint: Fingerprint of the scenario's files; empty if unknown.
        digest: SHA-256 of the study file, in hexadecimal digits; empty if there is none.
    """

    scenario: Scenario
    source: str
    comparisons: tuple[Comparison, ...]
    held: tuple[int, ...]
    references: Mapping[str, Experiment] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    agent_settings: Mapping[str, Any] = field(default_factory=dict)
    n_init: int = 10
    n_max: int = 50
    command: str = ""
    surrogate: Surrogate | None = None
    trust: str = ""
    ended: str = ""
    answered: tuple[Comparison, ...] | None = None
    waiting: Mapping[int, Experiment] = field(default_factory=dict)
    judged: bool = True
    outlook: Outlook | None = None
    study: str = ""
    dates: tuple[str, ...] = ()
    baseline: str = FIRST
    fingerprint: str = ""
    digest: str = ""

    @cached_property
    def trials(self) -> tuple[Trial, ...]:
        """Return every experiment once, in the order tried."""
        experiments: dict[int, Experiment] = dict(self.waiting)
        for c in self.comparisons:
            if c.query.incumbent is not None and c.incumbent is not None:
                experiments.setdefault(c.query.incumbent.index, c.incumbent)
            experiments.setdefault(c.query.challenger.index, c.challenger)
        return tuple(Trial(i, e, self.cost(e)) for i, e in sorted(experiments.items()))

    def costed(self) -> tuple["StudyRecord", str]:
        """Return this record, without costs if the scenario's fails, and then how it failed."""
        try:
            self.trials, self.reference_costs  # noqa: B018  # both compute all costs
        except Exception as error:  # the user's code can raise anything
            scenario = replace(self.scenario, cost=None)
            return replace(self, scenario=scenario), in_words(located(error))
        return self, ""

    @property
    def before(self) -> Trial:
        """Return the first trial, with which the result is compared."""
        return self.trials[0]

    @property
    def origin(self) -> dict[str, str]:
        """Return who answered, when, and for what scenario, by label.

        A study that a program can repeat has no dates, so that it gives equal reports.
        """
        by = "a person" if self.by_a_person else str(self.settings.get("calibrator", "a program"))
        minutes = [at[:16].replace("T", " ") for at in self.dates if self.by_a_person]
        when = " to ".join(dict.fromkeys(minutes))
        found = {
            "study": self.study,
            "answered by": "" if self.scored else by,
            "when (UTC)": when,
            "fingerprint of the scenario": self.fingerprint,
        }
        return {label: text for label, text in found.items() if text}

    @cached_property
    def thetas(self) -> Float[np.ndarray, "N n"]:
        """Return the θ of every trial, physical, shape (N, n)."""
        return np.array([t.experiment.theta for t in self.trials]).reshape(-1, len(self.scenario.space))

    @property
    def asked(self) -> tuple[Comparison, ...]:
        """Return the comparisons whose answers stand, in the order given."""
        if self.answered is not None:
            return self.answered
        return tuple(c for c in self.comparisons if c.incumbent is not None)

    @property
    def questions(self) -> int:
        """Return the number of questions that the calibrator answered."""
        return 0 if self.scored else len(self.asked)

    @property
    def by_a_person(self) -> bool:
        """Return whether a person compared."""
        return self.settings.get("calibrator") == "human"

    @property
    def shows_cost(self) -> bool:
        """Return whether to show the cost: there is one, and the answers follow it."""
        return self.scenario.cost is not None and self.judged

    @property
    def scored(self) -> bool:
        """Return whether the agent learned from scores, without comparisons."""
        return any(c.answer.value is not None for c in self.comparisons)

    @property
    def stopped(self) -> bool:
        """Return whether the study ended before its planned number of experiments, with more to gain."""
        return self.is_shorter and self.ended != ENOUGH

    @property
    def partial(self) -> bool:
        """Return whether the study was left before anyone said that the best is good enough."""
        return self.stopped and self.ended != GOOD_ENOUGH

    @property
    def is_shorter(self) -> bool:
        """Return whether fewer experiments were compared than planned at most."""
        return len(self.comparisons) < self.n_max

    @cached_property
    def best(self) -> Trial | None:
        """Return the best experiment; None before the first."""
        return self.incumbents[-1] if self.comparisons else None

    @cached_property
    def incumbents(self) -> tuple[Trial, ...]:
        """Return the best trial after each comparison."""
        by_index = {t.index: t for t in self.trials}
        return tuple(by_index[index] for index in self.held)

    @cached_property
    def reference_costs(self) -> dict[str, float]:
        """Return the cost of each reference; empty if the scenario has no cost."""
        costs = {name: self.cost(e) for name, e in self.references.items()}
        return {name: cost for name, cost in costs.items() if cost is not None}

    @cached_property
    def compared_with(self) -> dict[str, Experiment]:
        """Return the baseline, then the references; equal θ once, under all of their names."""
        runs = {self.baseline: self.before.experiment}
        runs |= {name: e for name, e in self.references.items() if name not in runs}
        names: dict[tuple[float, ...], list[str]] = {}
        for name, experiment in runs.items():
            names.setdefault(tuple(experiment.theta.tolist()), []).append(name)
        return {" and ".join(same): runs[same[0]] for same in names.values()}

    @property
    def kpis(self) -> tuple[KPI, ...]:
        """Return the scenario's KPIs without the index itself, which is shown as the cost."""
        return self.scenario.shown_kpis

    def read(self, kpi: KPI) -> Float[np.ndarray, " N"]:
        """Return the KPI of every trial as people read it; NaN where it is unknown."""
        return np.array([kpi.read(t.experiment.kpis.get(kpi.name, np.nan)) for t in self.trials])

    def cost(self, experiment: Experiment) -> float | None:
        """Return the latent cost of an experiment; None if the scenario has none.

        It is infinite for a run without a record.
        """
        if self.scenario.cost is None:
            return None
        return float(self.scenario.cost(experiment)) if len(experiment.t) else inf

    def verdict_counts(self) -> dict[str, int]:
        """Return the number of answers for each verdict, by its text."""
        given = [c.answer.preference for c in self.asked]
        return {words: given.count(verdict) for verdict, words in VERDICTS.items()}
