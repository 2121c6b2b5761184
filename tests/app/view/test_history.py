import pytest

from prefcal_app.session import Choice, actions
from prefcal_app.view import asked_view, history_view
from prefcal_env.errors import StaleError
from prefcal_env.study import Noted
from support.interviews import THREE, begin, judge, proceed, until_further
from support.looks import asked, toy


def test_every_answer_is_there_in_the_order_given():
    interview, _ = asked(Choice.LEFT, Choice.CANNOT_TELL, Choice.SAME)
    answers = history_view(interview)["answers"]
    assert [a["answer"] for a in answers] == [1, 2, 3]
    assert [a["comment"] for a in answers] == ["said left", "said cannot tell", "said same"]
    assert answers[1]["winner"] == answers[2]["winner"] == "none"
    assert answers[0]["winner"] in ("new", "best")
    assert (answers[0]["challenger"], answers[0]["incumbent"]) == (2, 1)  # counted from one


def test_a_retracted_answer_stays_and_says_so_and_one_taken_back_is_gone():
    interview, _ = asked(Choice.LEFT, Choice.RIGHT)
    interview.do(actions.Retract(1))
    assert [a["retracted"] for a in history_view(interview)["answers"]] == [True, False]
    assert asked_view(interview, 1)["retracted"] is True
    interview.do(actions.Undo(interview.now().version))
    assert [a["answer"] for a in history_view(interview)["answers"]] == [1]


def test_a_repeated_question_names_the_one_that_it_asks_again():
    interview, _ = asked(*[Choice.LEFT] * 4)
    now = interview.do(actions.Repeat())
    interview.do(actions.Answer(now.question.id, Choice.RIGHT))
    proceed(interview)
    *_, last = history_view(interview)["answers"]
    assert last["repeated"] is True
    assert last["number"] <= 4
    first = next(a for a in history_view(interview)["answers"] if a["answer"] == last["answer"])
    assert (first["challenger"], first["incumbent"]) == (last["challenger"], last["incumbent"])


def test_questions_have_one_count_with_the_follow_ups_among_them():
    interview = begin(toy, n_max=9, agent=THREE)
    further = until_further(interview)
    interview.do(actions.Answer(further.id, judge(further, toy.cost)))
    proceed(interview)
    answers = history_view(interview)["answers"]
    assert [a["number"] for a in answers] == list(range(1, len(answers) + 1))
    assert [a["further"] for a in answers] == [False] * (len(answers) - 1) + [True]
    assert answers[-1]["answer"] == -1  # the number for viewing and retracting
    seen = asked_view(interview, -1)["question"]
    assert seen["further"]
    assert {seen[side]["role"] for side in ("left", "right")} == {""}


def test_remarks_are_kept_with_their_time():
    interview, _ = asked()
    interview._driver.append(Noted("the pump was noisy"))
    (note,) = history_view(interview)["notes"]
    assert note["text"] == "the pump was noisy"
    assert note["at"].startswith("2026-01-01T")


@pytest.mark.parametrize("answer", [0, 1, 99])
def test_a_question_that_is_not_closed_is_refused(answer):
    interview, _ = asked()
    with pytest.raises(StaleError):
        asked_view(interview, answer)
