"""The interview on the toy scenario: answers, marks, undo, retraction, repeats and the end."""

import threading
from dataclasses import replace

import pytest

from prefcal_agents import GLIS, GLISp
from prefcal_app.session import Choice, Phase, actions, unattended
from prefcal_env.errors import StaleError, StudyError
from prefcal_env.preferences.answer import Mark, Preference
from prefcal_env.study import Answered, StudyFile
from support.interviews import THREE, begin, proceed, reopened, worked
from toy_study import toy_scenario

LEFT, RIGHT, SAME, CANNOT_TELL = Choice


@pytest.fixture
def interview(toy):
    return begin(toy)


def test_what_is_read_while_nobody_takes_a_step_belongs_together(interview):
    proceed(interview)
    held = interview.now().state.history.answered
    answering = threading.Thread(target=lambda: answer(interview, LEFT))
    with interview.past.still():
        before = interview.past.comparisons()
        answering.start()
        answering.join(0.3)
        assert len(interview.past.comparisons()) == len(before) == held
        assert interview.now().state.history.answered == held
    answering.join(10)
    assert len(interview.past.comparisons()) == held + 1


def judge(question):
    """A choice that follows the toy's latent cost."""
    difference = toy_scenario().cost(question.left.experiment) - toy_scenario().cost(
        question.right.experiment
    )
    return LEFT if difference < 0 else RIGHT if difference > 0 else SAME


def answer(interview, choice=None):
    now = proceed(interview)
    return interview.do(actions.Answer(now.question.id, choice or judge(now.question)))


@pytest.mark.parametrize("choice", Choice)
def test_a_choice_by_side_becomes_the_preference_it_means(interview, choice):
    question = proceed(interview).question
    interview.do(actions.Answer(question.id, choice, comment="so", blind=True))
    closed = interview.now().state.history.comparisons[1]
    expected = {SAME: Preference.TIE, CANNOT_TELL: None}
    side = question.left if choice is LEFT else question.right
    won = Preference.CHALLENGER if side.challenger else Preference.INCUMBENT
    assert closed.answer.preference is expected.get(choice, won)
    assert (closed.comment, closed.blind) == ("so", True)
    assert question.choice(closed.answer.preference) is choice


def test_the_sides_are_randomized_recorded_and_the_same_again(toy):
    sides = []
    for _ in range(2):
        interview = begin(toy, n_max=12)
        while (now := proceed(interview)).phase is Phase.QUESTION:
            interview.do(actions.Answer(now.question.id, judge(now.question)))
        sides.append([c.challenger_left for c in interview.now().state.history.comparisons[1:]])
    assert sides[0] == sides[1]
    assert {True, False} == set(sides[0])


def test_two_tabs_answer_at_once_and_one_of_them_is_told(interview):
    question = proceed(interview).question
    barrier, outcomes = threading.Barrier(2), []

    def tab():
        barrier.wait()
        try:
            interview.do(actions.Answer(question.id, LEFT))
            outcomes.append("recorded")
        except StaleError:
            outcomes.append("told")

    threads = [threading.Thread(target=tab) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(outcomes) == ["recorded", "told"]
    assert interview.now().state.history.answered == 2


def test_marks_stay_with_the_experiment_and_go_into_the_answer(interview):
    question = proceed(interview).question
    side = "left" if question.left.challenger else "right"
    for mark, on in [("good enough", True), ("unsafe", True), ("good enough", True)]:
        now = interview.do(actions.Mark(question.id, side, mark, on))
        assert now.question.challenger.marks == {mark}  # one takes the other away
    now = interview.do(actions.Mark(question.id, side, "good enough", False))
    assert now.question.challenger.marks == frozenset()
    interview.do(actions.Mark(question.id, side, "unsafe", True))
    assert now.question.id == question.id
    interview.do(actions.Answer(question.id, LEFT))
    assert interview.now().state.history.comparisons[1].answer.marks == (Mark.CHALLENGER_UNSAFE,)
    assert interview.now().state.marks[1] == {"unsafe"}


def test_a_mark_that_does_not_exist_is_refused(interview):
    question = proceed(interview).question
    with pytest.raises(StudyError, match="a mark is one of"):
        interview.do(actions.Mark(question.id, "left", "lovely", True))


def test_undo_opens_the_same_question_again_with_the_same_sides(interview):
    first = proceed(interview).question
    answer(interview)
    proceed(interview)
    interview.do(actions.Undo(interview.now().version))
    again = proceed(interview).question
    assert again.id != first.id
    assert (again.left.index, again.right.index) == (first.left.index, first.right.index)
    assert again.left.experiment == first.left.experiment


def test_a_late_undo_from_another_tab_takes_nothing_back(interview):
    answer(interview)
    seen = proceed(interview).version
    answer(interview)
    proceed(interview)
    with pytest.raises(StaleError, match="since you looked"):
        interview.do(actions.Undo(seen))


def test_a_retracted_answer_stays_on_record_and_teaches_nothing(interview):
    for _ in range(5):
        answer(interview)
    proceed(interview)
    before = interview.now()
    interview.do(actions.Retract(1))
    now = interview.now()
    assert now.state.history.comparisons[1].retracted
    assert [s.theta for s in now.state.history.samples] == [s.theta for s in before.state.history.samples]
    with pytest.raises(StaleError, match="retracted already"):
        interview.do(actions.Retract(1))
    assert interview.past.comparisons()[1].answer.preference is None


def test_a_retraction_changes_the_incumbent_of_the_open_question(interview):
    question = proceed(interview).question
    interview.do(actions.Answer(question.id, LEFT if question.left.challenger else RIGHT))
    assert proceed(interview).question.incumbent.index == 1
    interview.do(actions.Retract(1))
    assert proceed(interview).question.incumbent.index == 0


@pytest.mark.parametrize("number", [0, 2, -1])
def test_there_is_no_such_answer_to_retract(interview, number):
    answer(interview)
    proceed(interview)
    with pytest.raises(StaleError, match=r"there is no answer"):
        interview.do(actions.Retract(number))


def test_a_repeated_question_swaps_the_sides_and_teaches_nothing(interview):
    first = proceed(interview).question
    interview.do(actions.Answer(first.id, LEFT))
    for _ in range(3):
        answer(interview)
    open_before = proceed(interview).question
    interview.do(actions.Repeat())
    again = interview.now().question
    original = interview.past.asked(again.challenger.index)
    assert again.repeats == original.id
    assert (again.left.index, again.right.index) == (original.right.index, original.left.index)
    closed = interview.now().state.history.answered
    interview.do(actions.Answer(again.id, again.choice(original.preference(judge(original)))))
    now = proceed(interview)
    assert now.state.history.answered == closed
    assert now.question.challenger.index == open_before.challenger.index
    assert interview.known.consistency.repeated == 1


def test_the_study_is_over_when_all_is_compared_and_can_be_given_more(interview):
    while proceed(interview).phase is Phase.QUESTION:
        answer(interview)
    now = interview.now()
    assert (now.phase, now.state.ended) == (Phase.OVER, "all compared")
    assert now.state.history.answered == 6
    with pytest.raises(StaleError, match="say how many more"):
        interview.do(actions.GoOn())
    interview.do(actions.GoOn(2))
    for _ in range(2):
        answer(interview)
    assert proceed(interview).phase is Phase.OVER
    assert len(interview.now().state.finished) == 8


def test_a_person_ends_it_because_the_best_is_good_enough(interview):
    question = proceed(interview).question
    interview.do(actions.Mark(question.id, "left", "good enough", True))
    interview.do(actions.Answer(question.id, LEFT))
    proceed(interview)
    interview.do(actions.Finish())
    assert interview.now().state.ended == "good enough"
    interview.do(actions.GoOn())
    assert proceed(interview).phase is Phase.QUESTION
    interview.do(actions.Finish())
    with pytest.raises(StaleError, match="ended already"):
        interview.do(actions.Finish())


def test_a_run_that_raises_is_shown_tried_again_or_counted_as_failed(toy):
    broken = [True]

    def run(theta, seed=0):
        if broken[0]:
            raise OSError("the pump does not answer")
        return toy.run(theta, seed)

    interview = begin(replace(toy, run=run))
    now = proceed(interview)
    assert now.phase is Phase.FAILED
    assert "the pump does not answer" in now.problem
    broken[0] = False
    interview.do(actions.Retry())
    assert proceed(interview).phase is Phase.QUESTION
    broken[0] = True
    answer(interview)
    assert proceed(interview).phase is Phase.FAILED
    interview.do(actions.Fail(2, "pump"))
    now = interview.now()
    assert now.question.challenger.experiment.end.interrupted
    assert len(now.question.challenger.experiment.t) == 0
    assert "pump" in now.state.notes[-1][1]


def test_a_study_resumes_with_the_identical_next_question(toy, tmp_path):
    path = tmp_path / "mine.prefcal"
    whole = begin(toy, n_max=9)
    part = begin(toy, n_max=9, path=path)
    for interview in (whole, part):
        for _ in range(5):
            answer(interview)
        proceed(interview)
    part.file.close()
    resumed = reopened(toy, path)
    assert resumed.now().question.id == whole.now().question.id
    while proceed(whole).phase is Phase.QUESTION:
        proceed(resumed)
        a, b = whole.now().question, resumed.now().question
        assert a.left.experiment == b.left.experiment
        assert a.right.experiment == b.right.experiment
        answer(whole)
        answer(resumed)
    assert proceed(resumed).phase is Phase.OVER


@pytest.mark.parametrize("agent", [GLISp, THREE])
def test_running_ahead_changes_nothing_but_the_waiting(toy, agent):
    questions = []
    for ahead in (False, True):
        interview = begin(toy, n_max=9, ahead=ahead, agent=agent)
        thetas = []
        while (now := proceed(interview)).phase is Phase.QUESTION:
            worked(interview)
            now = interview.do(actions.Answer(now.question.id, judge(now.question)))
            if ahead and now.phase is not Phase.OVER:
                assert now.phase is Phase.QUESTION  # nothing was left to compute
            thetas.append(proceed(interview).state.history.samples[-1].theta)
        questions.append(thetas)
    assert questions[0] == questions[1]


def test_a_full_disk_after_an_answer_is_a_problem_to_be_tried_again(interview, monkeypatch):
    question = proceed(interview).question
    append = StudyFile.append

    def full(self, *events):
        if not isinstance(events[0], Answered):
            raise StudyError("the disk is full")
        return append(self, *events)

    monkeypatch.setattr(StudyFile, "append", full)
    interview.do(actions.Answer(question.id, LEFT))
    now = proceed(interview)
    assert (now.phase, now.problem) == (Phase.FAILED, "the disk is full")
    assert now.state.history.answered == 2
    monkeypatch.undo()
    interview.do(actions.Retry())
    assert proceed(interview).phase is Phase.QUESTION


def test_a_full_disk_at_an_answer_leaves_the_question_open(interview, monkeypatch):
    question = proceed(interview).question

    def full(self, *events):
        raise StudyError("the disk is full")

    monkeypatch.setattr(StudyFile, "append", full)
    with pytest.raises(StudyError, match="the disk is full"):
        interview.do(actions.Answer(question.id, LEFT))
    assert interview.now().question.id == question.id
    monkeypatch.undo()
    interview.do(actions.Answer(question.id, LEFT))
    assert interview.now().state.history.answered == 2


def test_a_run_without_a_record_has_no_score_and_loses(toy):
    def run(theta, seed=0):
        if theta[0] < 0.8:
            raise RuntimeError("the pump is off")
        return toy.run(theta)

    interview = begin(replace(toy, run=run), agent=GLIS)
    while interview.now().phase is not Phase.OVER:
        now = proceed(interview)
        if now.phase is Phase.FAILED:
            interview.do(actions.Fail(now.pending.index))
    state = interview.now().state
    scores = [c.answer.value for c in state.history.comparisons]
    assert None in scores
    assert state.history.samples[interview.now().incumbent].theta[0] >= 0.8
    assert interview.past.comparisons()[-1].winner_index == interview.now().incumbent


def test_without_a_person_a_theta_whose_run_raises_has_failed_and_the_study_goes_on(toy):
    """What happens at some θ is data; code that has never given an experiment is mended first."""

    def run(theta, seed=0):
        if theta[0] < 0.8:
            raise RuntimeError("the pump is off")
        return toy.run(theta)

    interview, said = begin(replace(toy, run=run), agent=GLIS), []
    list(unattended(interview, None, failed=said.append))
    state = interview.now().state
    low = [k for k, s in enumerate(state.history.samples) if s.theta[0] < 0.8]
    assert low
    assert [c.challenger for c in state.history.comparisons if c.answer.value is None] == low
    assert [words.split(" (")[0] for words in said] == [
        f"Experiment {index + 1} failed: RuntimeError: the pump is off" for index in low
    ]
    broken = begin(replace(toy, run=lambda theta, seed=0: run(theta * 0)), agent=GLIS)
    with pytest.raises(RuntimeError, match="the pump is off"):
        list(unattended(broken, None))


@pytest.mark.parametrize("choice", Choice)
def test_every_verdict_is_foreseen(toy, choice):
    interview = begin(toy, n_max=9, ahead=True)
    question = worked(interview).question
    answered = interview.do(actions.Answer(question.id, choice))
    assert answered.phase is Phase.QUESTION  # nothing had to be computed first


def test_the_comment_comes_back_with_the_answer_that_is_taken_back(interview):
    question = proceed(interview).question
    assert interview.do(actions.Answer(question.id, Choice.LEFT, comment="it swings")).draft == ""
    now = interview.do(actions.Undo(proceed(interview).version))
    assert now.draft == "it swings"
    assert interview.do(actions.Answer(now.question.id, Choice.LEFT)).draft == ""
