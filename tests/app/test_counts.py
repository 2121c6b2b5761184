"""One number, one word: every place that counts experiments and comparisons says the same."""

import io
import json
import re
from dataclasses import replace
from functools import partial

import pytest
from rich.console import Console

from prefcal_agents import Screening
from prefcal_app.cli.options import Options
from prefcal_app.cli.result import as_json, record_of
from prefcal_app.cli.studies.files import summary
from prefcal_app.report.export import best_as_json
from prefcal_app.report.record import comparisons_as_csv
from prefcal_app.report.write import page
from prefcal_app.session import Choice, actions
from prefcal_app.session.study import ENOUGH
from prefcal_app.summary import Planned
from prefcal_app.terminal.showing import show_status
from prefcal_app.view import now_view, status_view
from prefcal_app.view.end import map_view
from support.interviews import THREE, begin, judge, proceed, until_further, worked
from support.screened import screening, simulated
from toy_study import TOY, toy_scenario

OPTIONS = Options(TOY, n_max=9, n_init=3)


@pytest.fixture(scope="module")
def interview():
    """A study with further comparisons, a retracted one, a repeat and an open question."""
    made = begin(toy_scenario(), n_max=9, agent=THREE)
    for _ in range(2):
        question = until_further(made)
        made.do(actions.Answer(question.id, judge(question, made.scenario.cost)))
    for _ in range(2):
        question = proceed(made).question
        made.do(actions.Answer(question.id, judge(question, made.scenario.cost)))
    made.do(actions.Retract(2))
    proceed(made)
    question = made.do(actions.Repeat()).question
    made.do(actions.Answer(question.id, judge(question, made.scenario.cost)))
    question = proceed(made).question
    while question.further:  # until an experiment waits for its first comparison
        made.do(actions.Answer(question.id, judge(question, made.scenario.cost)))
        question = proceed(made).question
    return made


@pytest.fixture(scope="module")
def record(interview):
    return record_of(interview, OPTIONS, {})


@pytest.fixture
def told(record, tmp_path):
    """What `prefcal report --json` says."""
    return json.loads(as_json(record, OPTIONS, tmp_path))


def test_the_study_has_all_that_could_be_counted_differently(interview):
    state = interview.now().state
    assert state.history.follow_ups
    assert state.history.repeats
    assert any(c.retracted for c in state.history.comparisons)
    assert len(state.finished) == state.history.answered + 1


def test_experiments_are_those_that_ran(interview, record, told):
    ran = len(interview.now().state.finished)
    assert interview.known.counts.experiments == len(record.trials) == told["experiments"] == ran
    assert json.loads(best_as_json(record))["experiments"] == ran
    assert now_view(interview)["progress"]["experiments"] == ran
    assert len(status_view(interview)["tried"]["experiments"]) == ran
    assert summary(interview.now().state)["experiments"] == ran
    assert f"{ran} experiments" in page(record, [])
    assert f"after {ran} of 9 experiments" in page(record, [])
    assert f"{ran} of 9 experiments" in said(interview)


def test_what_ran_ahead_of_the_last_answer_and_was_never_shown_does_not_count(monkeypatch):
    monkeypatch.setattr(Screening, "has_enough", lambda agent, history: len(history.lessons) >= 2)
    agent = partial(Screening, n_simulated=40)
    made = begin(simulated, n_max=6, agent=agent, ahead=True, stops=True)
    for _ in range(2):
        made.do(actions.Answer(worked(made).question.id, Choice.LEFT))
    state = worked(made).state
    assert state.ended == ENOUGH
    assert (len(state.finished), state.history.answered) == (4, 3)
    record = record_of(made, OPTIONS, {})
    assert made.known.counts.experiments == len(record.trials) == made.known.simulated.shown == 3
    numbers = {point["number"] for point in map_view(made)["points"]}
    assert numbers == {None, 1, 2, 3}
    assert len(status_view(made)["tried"]["experiments"]) == summary(state)["experiments"] == 3
    assert "3 experiments, 2 comparisons" in page(record, [])


def test_what_was_shown_and_not_answered_counts():
    made = begin(toy_scenario(), n_max=6, agent=THREE)
    made.do(actions.Answer(proceed(made).question.id, Choice.LEFT))
    proceed(made)
    made.do(actions.Finish())
    assert made.known.counts.experiments == len(record_of(made, OPTIONS, {}).trials) == 3


def test_comparisons_are_the_answers_that_stand(interview, record, told):
    state = interview.now().state
    asked = [c for c in (*state.history.comparisons[1:], *state.history.follow_ups) if not c.retracted]
    count = len(asked)
    assert interview.known.counts.comparisons == record.questions == told["questions"] == count
    assert sum(told["verdicts"].values()) == count
    assert told["verdicts"] == record.verdict_counts()
    assert list(told["verdicts"].values()) == list(interview.known.counts.verdicts.values())
    assert now_view(interview)["progress"]["given"] == count
    assert summary(state)["answers"] == count
    assert f"{count} comparisons" in page(record, [])
    assert f"{count} comparisons" in said(interview)
    rows = re.findall(r"^\d+,", comparisons_as_csv(record), re.MULTILINE)
    assert len(rows) == count


def test_the_best_is_the_same_everywhere(interview, record, told):
    best = interview.now().incumbent
    theta = interview.scenario.space.named(interview.past.experiment(best).theta)
    assert record.best.index == best
    assert told["best"] == theta
    assert json.loads(best_as_json(record))["experiment"] == best + 1
    assert status_view(interview)["best"]["number"] == best + 1
    assert f"best so far, experiment {best + 1}:" in said(interview)


def test_the_report_never_says_which_is_best_by_itself(interview, record):
    now = interview.now()
    assert [t.index for t in record.incumbents[:-1]] == list(now.state.history.incumbents()[:-1])
    other = replace(now, incumbent=0 if now.incumbent else 1)
    assert record_of_now(interview, other).best.index == other.incumbent


def record_of_now(interview, now):
    class Fixed:
        def __getattr__(self, name):
            return getattr(interview, name)

        def now(self):
            return now

    return record_of(Fixed(), OPTIONS, {})


def said(interview):
    console = Console(record=True, width=200, file=io.StringIO())
    show_status(now_view(interview), status_view(interview), console)
    return console.export_text()


def test_the_promised_number_of_questions_is_reached_and_never_passed():
    study = screening(n_max=6)
    proceed(study)
    numbers = []
    while (question := proceed(study).question) is not None:
        view = now_view(study)["progress"]
        numbers.append(study.known.planned.answered + 1)
        assert view["text"] == f"question {len(numbers)} of 5"
        study.do(actions.Answer(question.id, Choice.LEFT if len(numbers) % 3 else Choice.RIGHT))
    assert numbers == [1, 2, 3, 4, 5]
    assert now_view(study)["progress"]["text"] == "5 questions answered"


@pytest.mark.parametrize(
    ("planned", "said"),
    [
        (Planned(1, 1), "1 question answered"),
        (Planned(0, 1), "0 of 1 question answered"),
        (Planned(1, 5), "1 of 5 questions answered"),
    ],
)
def test_one_question_is_not_plural(planned, said):
    assert planned.place(over=True, further=False) == said


def test_follow_ups_are_called_so_and_do_not_count():
    study = begin(toy_scenario(), n_max=9, agent=THREE)
    until_further(study)
    planned = study.known.planned
    assert planned.total == 8
    assert now_view(study)["progress"]["text"] == f"follow-up question, after {planned.answered} of 8"
