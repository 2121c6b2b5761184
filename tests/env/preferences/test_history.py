"""The record of a study: rules that the agent and the study file share."""

from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefcal_env import Answer, Knob, KnobSpace, Mark
from prefcal_env.errors import KnobError, ProtocolError
from prefcal_env.preferences.answer import Outcome
from prefcal_env.preferences.history import Comparison, History, Sample
from support.histories import in_cube

SPACE = KnobSpace([Knob("a", 1.0, 100.0, "s", scale="log10"), Knob("b", 0, 8, integer=True)])
UNSAFE = Mark.CHALLENGER_UNSAFE


def told(*answers):
    """Each new sample met the best so far."""
    history = History()
    for h, answer in enumerate(answers):
        history = history.with_pending(in_cube([h / 50, 0.5]))
        history = history.with_answer(Answer.of(answer), history.incumbent)
    return history


def after(steps):
    """Take the steps (name, number) that are possible, in order; each history on the way."""
    history = told(None)
    yield history
    for kind, number in steps:
        count = history.answered
        if kind == "tell":
            history = history.with_pending(in_cube([count / 50, 0.5]))
            history = history.with_answer(Answer((-1, 0, 1, None)[number % 4]), history.incumbent)
        elif kind == "unsafe":
            history = history.with_pending(in_cube([count / 50, 0.5]))
            mark = (UNSAFE, Mark.INCUMBENT_UNSAFE)[number % 2]
            history = history.with_answer(Answer(1, marks=(mark,)), history.incumbent)
        elif kind == "follow up" and count > 1:
            first = 1 + number % (count - 1)
            history = history.with_follow_up(Answer((-1, 0, 1)[number % 3]), first, first - 1)
        elif kind == "lead":
            history = history.with_best(number % count)
        elif kind == "propose":
            history = history.with_pending(in_cube([number / 100, 1.0]))
        elif kind == "undo" and count > 1:
            history = history.undone()
        elif kind == "retract" and not history.comparisons[number % count].retracted:
            history = history.retracted(number % count)
        yield history


STEPS = st.lists(
    st.tuples(
        st.sampled_from(["tell", "unsafe", "follow up", "lead", "propose", "undo", "retract"]),
        st.integers(0, 99),
    ),
    max_size=25,
)


@given(STEPS)
def test_answers_and_samples_stay_in_step_in_any_order_of_changes(steps):
    for history in after(steps):
        assert [c.challenger for c in history.comparisons] == list(range(history.answered))
        assert history.answered <= len(history.samples) <= history.answered + 1
        assert all(c.after <= history.answered for c in history.follow_ups)
        assert all(max(c.challenger, c.incumbent) < c.after for c in history.follow_ups)
        assert len(history.in_order()) == len(history.comparisons) + len(history.follow_ups)


@given(STEPS)
def test_undo_takes_back_exactly_what_was_told_last(steps):
    *_, history = after(steps)
    settled = history.with_pending(in_cube([0.9, 0.9]))
    assert settled.with_answer(Answer(-1), history.incumbent).undone() == settled
    if history.answered > 1:
        kept = replace(history, samples=history.samples[: history.answered])
        assert kept.with_follow_up(Answer(0), 1, 0).undone() == kept


@given(STEPS)
def test_the_best_after_each_answer_is_the_best_of_the_record_until_then(steps):
    *_, history = after(steps)
    assert len(history.incumbents()) == history.answered
    assert history.incumbents()[-1] == history.incumbent
    assert history.by_answers == history.unbeaten()[0]
    alone = replace(history, leads=())
    until = [history.until(count).incumbent for count in range(1, history.answered + 1)]
    assert alone.incumbents() == tuple(until)


def kept(**changes):
    """A record of two samples and one answer with circumstances, changed."""
    samples = tuple(Sample((z,), (z,)) for z in (0.1, 0.2, 0.3))
    first = Comparison(0, None, Answer(None, outcomes=({"a": 1.0}, None)), seq=4)
    second = Comparison(1, 0, Answer(1), seq=8, at="noon", question=7, comment="slow")
    return History(samples, (first, replace(second, **changes)))


def test_the_key_of_a_record_does_not_depend_on_circumstances():
    without = kept(seq=0, at="", question=None, comment="", challenger_left=True, blind=True)
    again = kept().recorded(Comparison(1, 0, Answer(0), repeats=7))
    assert {kept().key, without.key, again.key, kept(answer=Answer(1, strength=1.0)).key} == {kept().key}


def test_the_key_of_a_record_depends_on_all_that_agents_go_by():
    others = [
        kept(retracted=True),
        kept(after=2),
        kept(incumbent=None),
        *(kept(answer=a) for a in (Answer(-1), Answer(1, strength=2.0), Answer(1, value=0.5))),
        kept(answer=Answer(1, marks=(Mark.INCUMBENT_UNSAFE,))),
        kept(answer=Answer(1, marks=(Mark.INCUMBENT_UNSAFE,), automatic=(Mark.INCUMBENT_UNSAFE,))),
        kept(answer=Answer(1, outcomes=({"a": -1.0}, None))),
        kept(answer=Answer(1, outcomes=({"a": -2.0}, None))),  # Python's hash of both is the same
        kept(answer=Answer(1, outcomes=({"a": np.inf}, None))),
        kept().with_best(1),
        kept().with_follow_up(Answer(0), 1, 0),
        kept().with_another(in_cube([0.4])),
        kept().with_pending(in_cube([0.4])),
        kept().until(1),
    ]
    assert len({kept().key, *(other.key for other in others)}) == len(others) + 1
    # The key names them one by one: a new field of an answer must be added to it and above.
    told = {"preference", "strength", "marks", "outcomes", "value", "automatic"}
    assert {field.name for field in fields(Answer)} == told


def test_the_kpis_of_samples_are_one_table_with_what_was_told_first():
    def answer(preference, new, old):
        return Answer(preference, outcomes=(new, old))

    history = History()
    for told in (
        answer(None, {}, None),
        answer(1, {"b": np.inf, "a": 1.0}, {"a": 3.0}),
        answer(1, None, {"a": 9.0}),
        Answer(-1),
    ):
        history = history.with_pending(in_cube([history.answered / 50])).with_answer(told, 0)
    history = history.with_pending(in_cube([0.5])).retracted(1)
    assert history.kpis.names == ("a", "b")
    told = [[3.0, np.nan], [1.0, np.inf], [np.nan, np.nan], [np.nan, np.nan]]
    assert np.array_equal(history.kpis.values, told, equal_nan=True)
    assert history.kpis.outcome(0) == {"a": 3.0}
    assert history.kpis.outcome(2) is None
    assert History().kpis.values.shape == (0, 0)
    assert not history.kpis.values.flags.writeable, "all agents of the record share it"


@given(STEPS)
def test_what_is_held_for_the_best_stands_until_the_next_answer(steps):
    *_, history = after(steps)
    for index in range(history.answered):
        held = history.with_best(index)
        assert held.incumbent == index or index in history.unsafe
        assert held.by_answers == history.by_answers
        after_it = held.with_pending(in_cube([0.9, 0.9])).with_answer(Answer(None), held.incumbent)
        assert after_it.incumbent == after_it.by_answers
        assert after_it.incumbents()[-2] == held.incumbent
        assert after_it.undone().incumbent == held.incumbent


def test_a_retracted_answer_takes_back_what_was_held_for_the_best():
    history = told(None, 1, 1).with_best(2)
    assert (history.incumbent, history.by_answers) == (2, 0)
    assert history.retracted(1).incumbent == 0
    later = history.with_pending(in_cube([0.9, 0.9])).with_answer(Answer(1), 2)
    assert later.retracted(3).incumbents()[2] == 2
    assert later.retracted(1).incumbents()[2] == 0


@given(STEPS)
def test_a_retracted_answer_says_nothing_about_the_best(steps):
    *_, history = after(steps)
    for c in history.comparisons:
        if not c.retracted:
            history = history.retracted(c.challenger)
    for k, c in enumerate(history.follow_ups):
        if not c.retracted:
            history = history.retracted(k, follow_up=True)
    assert history.verdicts() == ()
    assert history.incumbent == 0


def test_undo_drops_a_sample_that_was_proposed_after_the_answer():
    history = told(None, 1).with_pending(in_cube([0.9, 0.9]))
    assert history.undone().samples == history.samples[:2]
    assert history.undone().pending == history.samples[1]


def test_undo_keeps_what_was_pending_before_the_answer_and_drops_what_was_proposed_since():
    waiting = told(None).with_another(in_cube([0.2])).with_another(in_cube([0.3]))
    assert waiting.waits
    asked = waiting.with_answer(Answer(-1), 0)
    assert not asked.waits, "what waits was proposed before this answer"
    later = asked.with_another(in_cube([0.4]))
    assert later.waits
    assert later.undone() == waiting


def test_an_empty_history_has_no_best_and_nothing_to_undo():
    assert History().incumbent is None
    assert History().unbeaten() == ()
    with pytest.raises(ProtocolError, match="no answer to undo"):
        History().undone()


@pytest.mark.parametrize("index", [-1, 3, True, "1"])
def test_an_answer_that_does_not_exist_cannot_be_retracted(index):
    with pytest.raises(ProtocolError, match="answer"):
        told(None, 1, 1).retracted(index)
    with pytest.raises(ProtocolError, match="answer"):
        told(None, 1, 1).retracted(0, follow_up=True)


def test_an_answer_is_retracted_once():
    with pytest.raises(ProtocolError, match="answer 1 is retracted already"):
        told(None, 1).retracted(1).retracted(1)


def test_the_lowest_score_is_the_best_where_nothing_was_compared():
    history = told(*(Answer(None, value=v) for v in (3.0, 1.0, 1.0, 2.0))).scores_alone()
    assert history.incumbent == 1
    assert history.incumbents() == (0, 1, 1, 1)
    assert history.retracted(1).incumbent == 2
    assert history.retracted(1).incumbents() == (0, 0, 2, 2)


def test_an_answer_goes_where_it_belongs():
    history = told(None, -1, -1)
    again = history.recorded(Comparison(1, 0, Answer(1), repeats=7))
    assert (again.comparisons, again.follow_ups) == (history.comparisons, ())
    assert again.repeats[0].repeats == 7
    later = again.recorded(Comparison(2, 0, Answer(1)))
    assert later.follow_ups == (Comparison(2, 0, Answer(1), after=3),)
    assert later.asked(0, 2)
    assert not history.asked(0, 2)


def test_unsafe_marks_count_unless_they_are_retracted():
    answer = Answer(-1, marks=(UNSAFE,), automatic=(UNSAFE,))
    history = told(None, Answer(1, marks=(Mark.INCUMBENT_UNSAFE,)), answer)
    assert history.unsafe == {0, 2}
    assert history.interrupted == {2}
    assert history.retracted(2).interrupted == frozenset()
    mark = (Mark.INCUMBENT_UNSAFE,)
    further = history.with_follow_up(Answer(1, marks=mark, automatic=mark), 2, 1)
    assert further.interrupted == {1, 2}
    assert further.undone().interrupted == {2}


def test_the_right_record_replaces_kpis_and_marks_and_retracts_the_verdict():
    known = (Outcome({"k": 1.0}), Outcome({"k": 2.0}))
    history = told(None, -1, Answer(-1, marks=(UNSAFE,), outcomes=known))
    right = history.corrected(2, Outcome({"k": 5.0}), unsafe=False)
    assert right.comparisons[:2] == history.comparisons[:2]
    assert right.comparisons[2].retracted
    assert right.comparisons[2].answer.marks == ()
    assert right.comparisons[2].answer.outcomes == ({"k": 5.0}, {"k": 2.0})
    assert history.corrected(2, None, unsafe=True).comparisons[2].answer.automatic == (UNSAFE,)


def test_a_sample_keeps_its_theta_in_another_space():
    sample = Sample.of(SPACE, np.array([0.5, 0.25]))
    assert sample.theta == pytest.approx((10.0, 2.0))
    wider = KnobSpace([Knob("a", 1.0, 10_000.0, "s", scale="log10"), SPACE.knobs[1]])
    history = History((sample,)).moved(SPACE, wider)
    assert history.samples[0].theta == sample.theta
    assert history.samples[0].z == pytest.approx((0.25, 0.25))
    assert History((sample,)).moved(SPACE, SPACE).samples == (sample,)
    with pytest.raises(KnobError):
        History((sample,)).moved(SPACE, KnobSpace([Knob("a", 1.0, 5.0, "s", scale="log10")]))
