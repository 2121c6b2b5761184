"""What a study that was cut off at an unlucky instant asks when it is taken up again."""

from prefcal_app.session import Choice, actions
from prefcal_env.study import Retracted
from support.interviews import begin, proceed, reopened
from toy_study import toy_scenario


def test_a_retraction_that_was_cut_off_asks_about_the_incumbent_that_stands(tmp_path):
    path = tmp_path / "mine.prefcal"
    interview = begin(toy_scenario(), path=path)
    first = proceed(interview).question
    interview.do(actions.Answer(first.id, Choice.LEFT if first.left.challenger else Choice.RIGHT))
    assert proceed(interview).question.incumbent.index == 1
    interview.file.append(Retracted(1))  # and killed before the next question
    interview.file.close()

    question = (now := reopened(toy_scenario(), path).now()).question
    assert (question.challenger.index, question.incumbent.index) == (2, now.incumbent) == (2, 0)
