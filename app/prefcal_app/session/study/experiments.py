"""Read the experiments of a study by index, as questions show them."""

from collections import OrderedDict
from dataclasses import dataclass, field, replace
from weakref import WeakValueDictionary

import numpy as np

from prefcal_env.errors import StudyError
from prefcal_env.experiments.experiment import Channels, End, Experiment
from prefcal_env.preferences.answer import Answer, Preference, Query, Suggestion
from prefcal_env.preferences.history import Comparison
from prefcal_env.preferences.kpis import Outcome
from prefcal_env.preferences.loop import Comparison as Compared
from prefcal_env.study import Shown, State, StudyFile
from prefcal_scenarios.kpis import outcome
from prefcal_scenarios.scenario import Scenario

from .question import Question, Side

_KEPT = 32
"""Number of recent experiments to keep in memory; a trajectory can take a megabyte."""


@dataclass(slots=True)
class ExperimentStore:
    """Store that reads experiments from the study file when they are shown.

    It keeps the most recent ones, and any that other code still holds. Of all others it keeps only
    what takes little memory: their KPIs and how they ended.
    """

    scenario: Scenario
    study: StudyFile
    _held: WeakValueDictionary[int, Experiment] = field(default_factory=WeakValueDictionary)
    _last: OrderedDict[int, Experiment] = field(default_factory=OrderedDict)
    _outcomes: dict[int, Outcome] = field(default_factory=dict)
    _ends: dict[int, End] = field(default_factory=dict)
    _without_kpis: set[int] = field(default_factory=set)

    def experiment(self, index: int) -> Experiment:
        """Return experiment number `index`, from 0. Raises StudyError if there is none."""
        seq = self._event(index)
        experiment = self._held.get(seq)
        if experiment is None:
            experiment = self._held[seq] = self._read(seq, index)
        self._last[seq] = experiment
        self._last.move_to_end(seq)
        while len(self._last) > _KEPT:
            self._last.popitem(last=False)
        return experiment

    def first_measured(self) -> Experiment | None:
        """Return the first experiment that has KPIs; None if there is none yet."""
        for index in sorted(set(self.study.state.finished) - self._without_kpis):
            experiment = self.experiment(index)
            if experiment.kpis:
                return experiment
            self._without_kpis.add(index)
        return None

    def end(self, index: int) -> End:
        """Return how experiment `index`, from 0, ended. Raises StudyError if there is none."""
        seq = self._event(index)
        if seq not in self._ends:
            self._ends[seq] = self.study.end(seq)
        return self._ends[seq]

    def outcomes(self, challenger: int, incumbent: int | None) -> tuple[Outcome, Outcome | None]:
        """Return what the agent can learn from two experiments besides their θ."""
        rival = None if incumbent is None else self._outcome(incumbent)
        return self._outcome(challenger), rival

    def scored(self, index: int) -> tuple[int | None, Answer]:
        """Return the best so far, and experiment `index` compared with it by the scenario's cost.

        It stands in for a question if the agent is told scores. The agent learns the score alone;
        the preference is for readers of the record. An experiment without a record has no score,
        nor has one that was cut short, and an abstention instead of a preference.
        """
        best, value = self.study.state.history.incumbent, self._score(index)
        if best is None:
            return None, Answer(None, value=value)
        rival = self._score(best)
        if value is None:
            return best, Answer(None)
        if rival is None:  # anything is better than a best without a score
            return best, Answer(Preference.CHALLENGER, value=value)
        return best, Answer(Preference(int(np.sign(value - rival))), value=value)

    def _score(self, index: int) -> float | None:
        experiment, cost = self.experiment(index), self.scenario.cost
        assert cost is not None, "refused before the study was begun"
        whole = len(experiment.t) and experiment.end is not End.CUT_SHORT
        value = float(cost(experiment)) if whole else np.nan
        return value if np.isfinite(value) else None

    def _event(self, index: int) -> int:
        finished = self.study.state.finished
        if index not in finished:
            raise StudyError(f"the study has no experiment {index + 1}")
        return finished[index]

    def _read(self, seq: int, index: int) -> Experiment:
        experiment = self.study.experiment(seq)
        theta = self.study.state.history.samples[index].theta
        if len(experiment.theta) == len(theta):
            return experiment
        return replace(experiment, theta=np.array(theta))  # knobs were added since

    def _outcome(self, index: int) -> Outcome:
        seq = self._event(index)
        if seq not in self._outcomes:
            self._outcomes[seq] = outcome(self.scenario, self.experiment(index))
        return self._outcomes[seq]

    def failed(self, index: int) -> Experiment:
        """Return an experiment without a record, for sample `index`, whose run failed."""
        theta = np.array(self.study.state.history.samples[index].theta)
        known = self.study.state.finished
        declared = self.scenario.source.channels or Channels((), (), ())
        channels = self.experiment(min(known)).channels if known else declared
        n_x, n_u, n_y = len(channels.x), len(channels.u), len(channels.y)
        measured = {(c.name, c.unit) for c in channels.y} - {(c.name, c.unit) for c in channels.x}
        none = np.zeros(0)
        return Experiment(
            theta=theta,
            t=none,
            x=np.zeros((0, n_x)),
            u=np.zeros((0, n_u)),
            t_control=none,
            u_control=np.zeros((0, n_u)),
            y_ref=np.zeros((0, n_y)),
            iterations=np.zeros(0, dtype=np.int64),
            solve_time=none,
            solved=np.zeros(0, dtype=bool),
            channels=channels,
            end=End.FAILED,
            y=np.zeros((0, n_y)) if measured else None,
        )

    def question(self, id_: int, number: int, shown: Shown) -> Question:
        """Return the question of the event `shown`, with the current marks."""
        pair, left = (shown.challenger, shown.incumbent), shown.challenger_left
        marks = self.study.state.marks
        new, old = (
            Side(index, self.experiment(index), index == pair[0], marks.get(index, frozenset()))
            for index in pair
        )
        sides = (new, old) if left else (old, new)
        return Question(id_, number, *sides, shown.repeats)

    def asked(self, closed: Comparison) -> Question:
        """Return an answered question as it was shown."""
        if closed.incumbent is None:
            raise StudyError("the first experiment was not compared with anything")
        left = closed.challenger_left is not False
        shown = Shown(closed.challenger, closed.incumbent, left, None)
        # Nobody was asked if the agent learns from scores: the question has the id of the answer.
        question = self.question(closed.question or closed.seq, closed.challenger, shown)
        return replace(question, further=closed.after is not None)

    def comparison(self, index: int) -> Compared:
        """Return comparison number `index`, from 0; a retracted answer becomes an abstention."""
        return self.compared(self.study.state.history.comparisons[index])

    def compared(self, closed: Comparison) -> Compared:
        """Return the experiments and the answer; a retracted answer becomes an abstention."""
        state, index, rival = self.study.state, closed.challenger, closed.incumbent
        return Compared(
            Query(_suggestion(state, index), None if rival is None else _suggestion(state, rival)),
            _abstained(closed.answer) if closed.retracted else closed.answer,
            self.experiment(index),
            None if rival is None else self.experiment(rival),
        )


def _abstained(answer: Answer) -> Answer:
    return Answer(None, marks=answer.marks, automatic=answer.automatic)


def _suggestion(state: State, index: int) -> Suggestion:
    return Suggestion(index, np.array(state.history.samples[index].theta))
