"""A study says what is to do from its record alone: no file, no run and no clock is needed."""

from dataclasses import replace

from prefcal_agents import GLISp
from prefcal_app.session import Choice, actions
from prefcal_app.session.study import Ask, Moment, Settle, Study, Write
from prefcal_env.preferences.history import History, Lead
from prefcal_env.study import Answered, Created, Ended, Finished, Led
from prefcal_env.study.fold import begin as created
from prefcal_env.study.fold import step
from support.interviews import answer_all, begin, judge, proceed
from toy_study import toy_scenario

TOY = toy_scenario()


def in_memory(agent, state, answers):
    """Drive a study in memory with answers by number; return its last state and what it said."""
    said, seq = [], 1
    while (todo := Study(agent, state).next()) is not Moment.OVER:
        said.append(type(todo))
        match todo:
            case Write(event):
                events = [event]
            case Settle(index):
                events = [Answered(None, index, None, answers[index])]
            case Moment.RUN:
                events = [Finished(len(state.finished))]
            case Ask(shown):
                given = answers[shown.challenger]
                events = [shown, Answered(seq + 1, shown.challenger, shown.incumbent, given)]
        for event in events:
            seq += 1
            state = step(state, seq, "", event)
    return state, said


def test_a_study_in_memory_tries_what_one_with_a_file_tries():
    interview = begin(TOY, n_max=8)
    answer_all(interview, lambda number: None)
    there = interview.file.state
    agent = GLISp(TOY.space, n_init=3, n_max=8, seed=0)
    begun = created(1, "", Created(dict(there.configuration)))
    state, said = in_memory(agent, begun, [c.answer for c in there.history.comparisons])
    assert agent.history == History(), "the agent is only asked"
    assert state.ended == there.ended == "all compared"
    assert [s.theta for s in state.history.samples] == [s.theta for s in there.history.samples]
    assert state.history.incumbent == there.history.incumbent
    assert {Ask, Settle, Moment, Write} == set(said)


def test_an_answer_makes_another_study_and_changes_none():
    interview = begin(TOY, n_max=6)
    question = proceed(interview).question
    study = interview._driver.study
    asked = study.next()
    assert asked == Ask(study.state.open[1])
    assert not study.is_overtaken
    interview.do(actions.Answer(question.id, judge(question, TOY.cost)))
    assert study.next() == asked
    assert interview._driver.study.next() != asked


def test_an_unsafe_run_never_leads_whatever_the_agent_says():
    interview = begin(TOY, n_max=6)
    question = proceed(interview).question
    interview.do(actions.Mark(question.id, "left", "unsafe", on=True))
    question = proceed(interview).question
    interview.do(actions.Answer(question.id, Choice.RIGHT))
    proceed(interview)
    study = interview._driver.study
    unsafe, safe = question.left.index, question.right.index
    for leader, before, led in ((unsafe, safe, False), (safe, unsafe, True)):
        history, strategy = study.state.history, study.strategy.copy()
        history = replace(history, leads=(Lead(before, history.given),))
        turn = strategy.turn(history)._replace(best=leader)
        strategy.turn = lambda _, turn=turn: turn
        other = replace(study, strategy=strategy, state=replace(study.state, history=history))
        assert (other.next() == Write(Led(leader))) is led


def test_an_ended_study_asks_nothing_whatever_the_agent_would():
    interview = begin(TOY, n_max=6)
    question = proceed(interview).question
    interview.do(actions.Answer(question.id, Choice.LEFT))
    study = interview._driver.study
    assert study.next() is not Moment.OVER
    assert study.feed(Ended("stopped"), replace(study.state, ended="stopped")).next() is Moment.OVER
