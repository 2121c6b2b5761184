"""Records of a rig: seen before they are saved, refused twice, replaced; and the θ really set."""

from dataclasses import replace

import pytest

from prefcal_app.session import Choice, Phase, actions
from prefcal_app.summary import foreseen
from prefcal_app.view import now_view, status_view
from prefcal_env.errors import RecordError, StaleError
from prefcal_env.preferences.answer import Mark
from prefcal_env.sources.rig import Rig
from prefcal_env.study import Suggested, verify
from prefcal_scenarios.scenario import KPI
from support.interviews import begin, reopened
from toy_scenario_tools import CHANNELS, csv
from toy_study import toy_scenario

TOY = toy_scenario()
RIG = replace(
    TOY,
    cost=None,
    references={},
    kpis=(KPI("highest", "highest", "m", better="lower"),),
    run=Rig(CHANNELS, (2.0,), kpis=lambda e: {"highest": float(e.x.max())}),
)


@pytest.fixture
def interview(tmp_path):
    """The first experiment is recorded, the second one is waited for."""
    interview = begin(RIG, path=tmp_path / "rig.prefcal")
    interview.do(actions.Record(0, csv(8.0)))
    return interview


def test_a_preview_shows_the_curves_and_saves_nothing(interview):
    before = interview.now()
    seen = interview.preview(actions.Record(1, csv(9.0), unsafe=True))
    assert seen.experiment.x.max() == 9.0
    assert seen.experiment.end.interrupted
    assert (seen.same, seen.retracts) == (None, 0)
    assert interview.now() == before


def test_the_file_of_the_run_before_is_refused_unless_it_is_meant(interview):
    saved_anew = csv(8.0).replace(b",", b";")
    for content in (csv(8.0), saved_anew):
        assert interview.preview(actions.Record(1, content)).same == 0
        with pytest.raises(RecordError, match="curves of experiment 1"):
            interview.do(actions.Record(1, content))
    assert sorted(interview.now().state.finished) == [0]
    assert interview.do(actions.Record(1, csv(8.0), again=True)).phase is Phase.QUESTION


def test_the_theta_that_was_dialed_is_learned_from_and_the_proposed_one_kept(interview, tmp_path):
    proposed = interview.now().pending.theta
    dialed = (1.07, 20.0, proposed[2])
    now = interview.do(actions.Record(1, csv(9.0), theta=dialed))
    assert now.state.history.samples[1].theta == pytest.approx(dialed)
    assert now.state.proposed == {1: proposed}
    assert interview.past.experiment(1).theta == pytest.approx(dialed)
    interview.do(actions.Answer(now.question.id, Choice.LEFT))
    while interview.now().phase is Phase.RUNNING:
        interview.work()
    following = interview.now()
    history = interview._driver.agent.state.history
    assert history.samples[1].theta == pytest.approx(dialed)
    interview.file.close()
    again = reopened(RIG, tmp_path / "rig.prefcal")
    assert again.now().pending == following.pending
    suggested = [r.event for r in again.file.events() if isinstance(r.event, Suggested)]
    assert suggested[1].theta == proposed
    assert verify(tmp_path / "rig.prefcal") == ()


@pytest.mark.parametrize(
    ("theta", "told"),
    [
        ((9.0, 20.0, 1.0), r"T_s.*must be in \[0.25, 1.5\] h, got 9"),
        ((0.5, 20.5, 1.0), "N_p.*integer"),
        ((0.5, 20.0), "shape"),
    ],
)
def test_a_theta_that_cannot_be_learned_from_is_refused(interview, theta, told):
    with pytest.raises(RecordError, match=told):
        interview.do(actions.Record(1, csv(9.0), theta=theta))
    assert interview.now().phase is Phase.RECORD


def test_no_theta_runs_twice_by_hand_either(interview):
    first = interview.now().state.history.samples[0].theta
    with pytest.raises(RecordError, match="experiment 1 was run with exactly the θ"):
        interview.do(actions.Record(1, csv(9.0), theta=first))


def test_a_record_that_is_not_answered_yet_is_replaced_and_its_question_put_anew(interview):
    asked = interview.do(actions.Record(1, csv(9.0))).question
    now = interview.do(actions.Record(1, csv(7.5), theta=(0.5, 20.0, 1.0)))
    with pytest.raises(StaleError):
        interview.do(actions.Answer(asked.id, Choice.LEFT))
    assert now.question.challenger.experiment.x.max() == 7.5
    assert now.state.history.samples[1].theta == pytest.approx((0.5, 20.0, 1.0))


def test_replacing_a_compared_record_retracts_its_answers_and_corrects_its_kpis(interview):
    asked = interview.do(actions.Record(1, csv(9.0), unsafe=True)).question
    interview.do(actions.Answer(asked.id, asked.choice(asked.preference(Choice.LEFT))))
    while interview.now().phase is Phase.RUNNING:
        interview.work()
    assert interview.preview(actions.Record(1, csv(7.5))).retracts == 1
    now = interview.do(actions.Record(1, csv(7.5)))
    closed = now.state.history.comparisons[1]
    assert now.phase is Phase.RECORD
    assert closed.retracted
    assert Mark.CHALLENGER_UNSAFE not in closed.answer.marks
    assert closed.answer.outcomes[0]["highest"] == 7.5
    history = interview._driver.agent.state.history
    assert [history.kpis.outcome(row)["highest"] for row in (0, 1)] == [8.0, 7.5]
    with pytest.raises(RecordError, match="compared already"):
        interview.do(actions.Record(1, csv(6.0), theta=(0.5, 20.0, 1.0)))


def answered(interview, count):
    """Record experiments and answer until so many answers are given; the next record is waited for."""
    while True:
        now = interview.now()
        if now.question is not None:
            better = now.question.left.index > now.question.right.index
            now = interview.do(actions.Answer(now.question.id, Choice.LEFT if better else Choice.RIGHT))
        elif now.phase is Phase.RUNNING:
            interview.work()
        elif len(now.state.history.lessons) == count:
            return
        else:
            index = now.pending.index
            interview.do(actions.Record(index, csv(9.0 - 0.1 * index)))


def test_before_a_run_it_is_said_what_it_can_bring_and_after_it_what_was_said(tmp_path):
    interview = begin(RIG, n_max=12, path=tmp_path / "rig.prefcal")
    answered(interview, 4)
    assert now_view(interview)["pending"]["promise"] == ""
    answered(interview, 5)
    index, chance = interview.now().pending.index, interview.known.foresight().chance
    said = foreseen(chance, index)
    assert f"experiment {index + 1} is noticeably better" in said
    assert now_view(interview)["pending"]["promise"] == said
    assert said[1:] in " ".join(status_view(interview)["outlook"]["sentences"])
    now = interview.do(actions.Record(index, csv(5.0)))
    assert now.question is not None
    assert now_view(interview)["pending"]["promise"] == ""  # it must not sway the answer
    assert said[1:] in " ".join(status_view(interview)["outlook"]["sentences"])


def test_a_page_waits_for_nothing_that_would_have_to_be_learned_again(tmp_path):
    interview = begin(RIG, n_max=12, path=tmp_path / "rig.prefcal")
    answered(interview, 5)
    said = interview.known.promise
    interview.file.close()
    again = reopened(RIG, tmp_path / "rig.prefcal")
    again._driver.has_background = True  # as with a page
    assert again.known.promise == ""
    assert again.known.foresight(learn=True) is not None
    assert again.known.promise == said
