"""An interview whose agent simulates unseen: nothing waits for it, and a restart asks the same."""

import threading
import time
from dataclasses import replace
from functools import partial

import pytest

from prefcal_agents.screening.agent import Screening
from prefcal_app.session import Background, Choice, Interview, Phase, actions
from prefcal_app.session.driver import LIKELIEST
from prefcal_app.simulating import Simulator
from prefcal_app.summary import others_unbeaten
from prefcal_app.view.end import why_view
from prefcal_env.errors import ScenarioError
from prefcal_env.preferences.answer import Answer, Preference
from prefcal_env.study import StudyFile
from support.interviews import answer_all, begin, clock, judge, proceed, reopened, worked
from support.processes import wait_until
from support.unseen import cost, unseen

AGENT = partial(Screening, n_simulated=40)
OPPOSITE = {Choice.LEFT: Choice.RIGHT, Choice.RIGHT: Choice.LEFT, Choice.SAME: Choice.SAME}


def started(path=None, n_max=5, ahead=False, seed=0, agent=AGENT, stops=False):
    return begin(unseen, n_max=n_max, agent=agent, path=path, ahead=ahead, seed=seed, stops=stops)


def asked(now):
    question = now.question
    return question.id, question.challenger.experiment.theta.tolist(), question.incumbent.index


def test_a_study_without_prefetching_is_the_same_as_one_with_it():
    plain, ahead = started(), started(ahead=True)
    now, same = proceed(plain), worked(ahead)
    while now.phase is not Phase.OVER:
        assert asked(now)[1:] == asked(same)[1:]
        assert now.simulated.simulated == same.simulated.simulated
        for interview, there in ((plain, now), (ahead, same)):
            interview.do(actions.Answer(there.question.id, judge(there.question, cost)))
        now, same = proceed(plain), worked(ahead)
    assert same.phase is Phase.OVER
    assert now.state.history == same.state.history


def test_the_likeliest_answers_are_prepared_and_followed_by_the_next_question_without_work():
    interview = started(ahead=True)
    now = worked(interview)
    assert len(interview._driver.thoughts.prefetch._screened) == LIKELIEST
    now = interview.do(actions.Answer(now.question.id, Choice.LEFT))
    assert now.phase is Phase.QUESTION
    assert interview.known.screened() is not None


def test_a_restarted_study_asks_the_identical_question_at_once(tmp_path):
    path = tmp_path / "mine.prefcal"
    interview = started(path)
    for _ in range(2):
        now = proceed(interview)
        interview.do(actions.Answer(now.question.id, judge(now.question, cost)))
    now = proceed(interview)
    before = asked(now), interview.known.screened()
    interview.file.close()
    again = reopened(unseen, path)
    assert asked(again.now()) == before[0]
    assert again.known.screened() is None
    assert again.now().simulated.simulated == 0
    again._runs_ahead = True
    version = again.now().version
    now = worked(again)
    assert asked(now) == before[0]
    assert now.version > version  # pages look again
    assert again.known.screened().bank.thetas.tolist() == before[1].bank.thetas.tolist()
    assert again.known.findings.reason == before[1].findings.reason
    answer_all(again, lambda number: None)
    assert again.now().phase is Phase.OVER


def test_what_the_agent_holds_for_the_best_is_the_best_of_the_record_too(tmp_path, monkeypatch):
    """Someone who now and then means the opposite, and an agent that is quick to think so."""
    monkeypatch.setattr("prefcal_agents.people._DOUBT", 0.5)
    monkeypatch.setattr("prefcal_agents.people._LOOSE", 1.0)  # whoever answers
    path, leads = tmp_path / "mine.prefcal", 0
    interview = started(path, n_max=12, seed=1, agent=partial(Screening, n_simulated=150))
    now = proceed(interview)
    while now.phase is not Phase.OVER:
        assert now.question.incumbent.index == now.incumbent == now.state.history.incumbent
        held = now.incumbent != now.state.history.by_answers
        leads += held
        assert ("probably a slip" in why_view(interview, now)[0]) == held
        meant = judge(now.question, cost)
        slip = now.state.history.answered in (4, 7)
        interview.do(actions.Answer(now.question.id, OPPOSITE[meant] if slip else meant))
        now = proceed(interview)
    assert leads >= 1
    assert now.incumbent != now.state.history.by_answers
    best, winner = now.incumbent + 1, now.state.history.by_answers + 1
    assert f"Experiment {best} is the best so far, though {winner} won" in others_unbeaten(now.state.history)
    interview.file.close()
    again = reopened(unseen, path).now()
    assert again.state.history == now.state.history
    assert again.incumbent == now.incumbent


def judged_often(interview, answers=5):
    """Enough answers for the agent to hold another one than the winner for the best."""
    for _ in range(answers):
        now = proceed(interview)
        interview.do(actions.Answer(now.question.id, judge(now.question, cost)))
    proceed(interview)
    return interview


def test_nothing_is_simulated_for_a_retraction_or_an_answer_after_a_restart(tmp_path):
    """The lock is held meanwhile, and who simulates may wait for it."""
    path = tmp_path / "mine.prefcal"
    interview = judged_often(started(path, n_max=9))
    count = interview._driver.thoughts.simulator.count
    assert interview.do(actions.Retract(3)).phase is Phase.QUESTION
    assert interview._driver.thoughts.simulator.count == count
    interview.file.close()
    again = reopened(unseen, path)
    again.do(actions.Answer(again.now().question.id, Choice.LEFT))
    assert again.now().phase is Phase.RUNNING
    assert again._driver.thoughts.simulator.count == 0


def test_an_answer_is_about_the_pair_on_show_though_the_agent_would_now_show_another(tmp_path, monkeypatch):
    path = tmp_path / "mine.prefcal"
    with monkeypatch.context() as earlier:
        earlier.setattr(Screening, "_leader", lambda self, history: None)
        interview = judged_often(started(path, n_max=9))
    rival = interview.now().question.incumbent.index
    interview.file.close()
    monkeypatch.setattr(Screening, "_leader", lambda self, history: int(rival == 0))
    again = reopened(unseen, path)
    again.do(actions.Answer(again.now().question.id, Choice.LEFT))
    told = again._driver.agent.history.comparisons[-1]
    assert told.incumbent == again.file.state.history.comparisons[-1].incumbent == rival
    assert proceed(again).question.incumbent.index == int(rival == 0)


class Slow:
    """The runs of a scenario, each of which waits until it may go on."""

    def __init__(self):
        self.gate = threading.Event()
        self.gate.set()
        self.waiting = threading.Event()

    def __call__(self, theta, seed=0):
        if not self.gate.is_set():
            self.waiting.set()
            self.gate.wait(20)
        return unseen.run(theta, seed)


@pytest.fixture
def slow():
    """A scenario that can be held up, and what holds it."""
    run = Slow()
    yield replace(unseen, run=run), run
    run.gate.set()


def test_a_request_is_answered_while_it_simulates(slow):
    scenario, run = slow
    interview = begin(scenario, n_max=5, agent=AGENT)
    run.gate.clear()
    with Background(interview):
        assert run.waiting.wait(20)
        begun = time.monotonic()
        assert interview.now().phase is Phase.RUNNING
        assert interview.known.screened() is None
        assert interview.now().simulated.simulated == 0
        assert time.monotonic() - begun < 1.0
        run.gate.set()
        wait_until(lambda: interview.now().phase is Phase.QUESTION)


@pytest.fixture
def held(slow, tmp_path):
    """A restarted interview that simulates what the first likely answer leads to, held up."""
    scenario, run = slow
    first = begin(scenario, n_max=5, agent=AGENT, path=tmp_path / "mine.prefcal")
    proceed(first)
    first.file.close()
    interview = reopened(scenario, tmp_path / "mine.prefcal")
    interview._runs_ahead = interview._driver.thoughts.prefetch.silent = True
    run.gate.clear()
    attempt = threading.Thread(target=interview.work)
    attempt.start()
    assert run.waiting.wait(20)

    def go_on():
        run.gate.set()
        attempt.join(20)
        assert not attempt.is_alive()

    return interview, go_on


def test_an_answer_does_not_wait_for_simulations_for_another_answer(held):
    interview, go_on = held
    interview.do(actions.Give(interview.now().question.id, Answer(Preference.INCUMBENT)))
    go_on()
    assert interview._driver.thoughts.simulator.count <= 1  # the one that was running
    assert interview.now().phase is Phase.RUNNING
    assert proceed(interview).phase is Phase.QUESTION


def test_simulations_for_the_answer_that_is_given_are_used(held):
    interview, go_on = held
    interview.do(actions.Give(interview.now().question.id, Answer(Preference.CHALLENGER)))
    go_on()
    assert interview._driver.thoughts.simulator.count > 1
    assert not interview._driver.study.must_think
    assert interview.known.screened() is not None, "before anything else is worked out"
    assert proceed(interview).phase is Phase.QUESTION


def test_closing_gives_up_the_simulations(held):
    interview, go_on = held
    interview.close()
    go_on()
    assert interview._driver.thoughts.simulator.count <= 1


def test_a_simulator_of_processes_is_closed_by_whoever_made_it(tmp_path):
    with Simulator(unseen, jobs=1) as simulator:
        one = started(tmp_path / "one.prefcal")
        one.file.close()
        study = StudyFile.open(tmp_path / "one.prefcal", clock=clock())
        interview = Interview(unseen, study, ahead=False, simulator=simulator)
        here = started()
        assert asked(proceed(interview)) == asked(proceed(here))
        interview.close()
        assert simulator.count == here._driver.thoughts.simulator.count


@pytest.fixture
def enough(monkeypatch):
    """Agents that have enough after three answers."""
    monkeypatch.setattr(Screening, "has_enough", lambda agent, history: len(history.lessons) >= 3)


def tried(interview):
    return [sample.theta for sample in interview.now().state.history.samples]


def shown(interview):
    """θ that were shown by the end."""
    return tried(interview)[: interview.now().state.history.answered]


@pytest.mark.parametrize("ahead", [False, True])
def test_it_ends_when_the_agent_has_enough_and_goes_on_with_the_same_questions(enough, ahead):
    whole, early = started(n_max=7), started(n_max=7, stops=True, ahead=ahead)
    for interview in (whole, early):
        answer_all(interview, lambda number: None)
    assert whole.now().state.ended == "all compared"
    now = worked(early)
    assert (now.phase, now.state.ended) == (Phase.OVER, "little is left to gain")
    assert shown(early) == shown(whole)[:4]
    assert early.known.screened() is not None, "what it ended by is known"
    assert early.known.outlook is not None
    early.do(actions.GoOn())
    answer_all(early, lambda number: None)
    assert early.now().state.ended == "all compared", "it does not end early again"
    assert shown(early) == shown(whole)


def test_an_undo_after_such_an_end_opens_its_last_question_again(enough, tmp_path):
    interview = started(tmp_path / "a.prefcal", n_max=7, stops=True)
    answer_all(interview, lambda number: None)
    last = shown(interview)[-1]
    interview.do(actions.Undo(interview.now().version))
    now = proceed(interview)
    assert now.phase is Phase.QUESTION
    assert tuple(now.question.challenger.experiment.theta) == last
    interview.do(actions.Answer(now.question.id, judge(now.question, cost)))
    assert proceed(interview).state.ended == "little is left to gain"
    interview.file.close()
    assert reopened(unseen, tmp_path / "a.prefcal").now().phase is Phase.OVER


def test_an_open_question_stays_open_though_the_agent_has_enough(monkeypatch):
    interview = started(n_max=7, stops=True)
    question = proceed(interview).question
    monkeypatch.setattr(Screening, "has_enough", lambda agent, history: True)
    assert proceed(interview).question == question
    interview.do(actions.Answer(question.id, judge(question, cost)))
    assert proceed(interview).phase is Phase.OVER


@pytest.mark.parametrize("asked", ["for a θ", "again"])
def test_a_person_who_asks_for_something_gets_it_though_the_agent_has_enough(monkeypatch, asked):
    """As in a study from before agents could have enough."""
    interview = started(n_max=7, stops=True)
    for _ in range(3):
        question = proceed(interview).question
        interview.do(actions.Answer(question.id, judge(question, cost)))
    assert proceed(interview).phase is Phase.QUESTION
    monkeypatch.setattr(Screening, "has_enough", lambda agent, history: len(history.lessons) == 3)
    if asked == "again":
        question = interview.do(actions.Repeat()).question
        interview.do(actions.Answer(question.id, judge(question, cost)))
    else:
        interview.do(actions.AskFor((0.31, 0.47)))
    now = proceed(interview)
    assert now.phase is Phase.QUESTION
    if asked != "again":
        assert tuple(now.question.challenger.experiment.theta) == (0.31, 0.47)


def test_an_error_of_the_simulations_is_a_problem_that_can_be_tried_again(monkeypatch):
    def fail(thetas):
        raise ScenarioError("no process can load the scenario")

    interview = started()
    with monkeypatch.context() as broken:
        broken.setattr(interview._driver.thoughts.simulator, "_here", fail)
        interview.work()
    assert interview.now().phase is Phase.FAILED
    assert "no process can load" in interview.now().problem
    interview.do(actions.Retry())
    assert proceed(interview).phase is Phase.QUESTION
