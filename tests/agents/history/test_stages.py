"""What is known after each answer follows from the record, and is remembered."""

from concurrent.futures import ThreadPoolExecutor

import pytest

from prefcal_agents.lessons import Remembered, Stages
from prefcal_env.preferences.answer import Answer
from support.histories import in_cube, studied


def line(count):
    """A record of `count` samples on a line, each compared with the one before."""
    rivals = [None, *range(count)][:count]
    answers = [None, *[-1] * count][:count]
    return studied([[k / 100] for k in range(count)], answers=answers, rivals=rivals)


class Counting:
    """Stages whose knowledge is the list of all steps, and the steps that were worked out."""

    def __init__(self, most=None):
        self.steps, self.begun = [], 0
        self.stages = Stages(self.first, self.following, most)

    def first(self):
        self.begun += 1
        return ()

    def following(self, past, before, known):
        assert known == ((before.answered, len(before.follow_ups)),) * bool(before.answered) or (
            known[-1] == (before.answered, len(before.follow_ups))
        )
        self.steps.append((past.answered, len(past.follow_ups)))
        return (*known, self.steps[-1])


def test_a_step_is_an_experiment_with_its_answer_or_all_follow_ups_after_it():
    record = line(3).with_follow_up(Answer(1), 2, 0).with_follow_up(Answer(1), 1, 0)
    longer = record.with_pending(in_cube([0.9])).with_answer(Answer(1), 2)
    assert Counting().stages(longer) == ((1, 0), (2, 0), (3, 0), (3, 2), (4, 2))


def test_what_is_known_is_not_worked_out_twice():
    counting, record = Counting(), line(5)
    counting.stages(record.until(3))
    counting.stages(record)
    counting.stages(record.with_pending(in_cube([0.7])))
    counting.stages(record.until(4))
    assert counting.steps == [(k, 0) for k in range(1, 6)]


@pytest.mark.parametrize(
    "change",
    [
        lambda record: record.undone(),
        lambda record: record.retracted(2),
        lambda record: record.undone().with_pending(in_cube([0.8])).with_answer(Answer(1), 3),
        lambda record: record.with_follow_up(Answer(1), 4, 0),
        lambda record: record.with_follow_up(Answer(1), 4, 0).with_follow_up(Answer(0), 4, 1),
    ],
    ids=["undo", "retraction", "another answer", "a follow-up", "two follow-ups"],
)
def test_it_depends_on_the_record_alone_not_on_what_was_asked_before(change):
    used, record = Counting(), line(5)
    used.stages(record)
    used.stages(record.with_follow_up(Answer(-1), 3, 0))
    assert used.stages(change(record)) == Counting().stages(change(record))


def test_a_long_study_takes_one_step_for_each_answer_though_early_ones_are_forgotten():
    counting, record = Counting(), line(60)
    for count in range(61):
        counting.stages(record.until(count))
    assert counting.steps == [(k, 0) for k in range(1, 61)]
    known = counting.stages(record.until(2))  # forgotten, and worked out again
    assert known == ((1, 0), (2, 0))
    assert len(counting.steps) == 62
    assert len(counting.stages._known) <= 40


def test_of_a_long_study_ten_answers_at_once_are_a_step_and_the_rest():
    counting, record = Counting(20), line(47).with_follow_up(Answer(1), 46, 0)
    counting.stages(record)
    ends = [*range(1, 21), 30, 40, 47]
    assert counting.steps == [*[(k, 0) for k in ends], (47, 1)]
    longer = record.with_pending(in_cube([0.9])).with_answer(Answer(1), 46)
    assert counting.stages(longer) == Counting(20).stages(longer)
    assert counting.stages(longer)[-3:] == ((40, 0), (48, 0), (48, 1))


def test_several_threads_get_what_one_gets():
    counting, record = Counting(), line(30)
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda k: counting.stages(record.until(k)), [30, 20, 30, 10]))
    alone = Counting().stages(record)
    assert [found[k] == alone[:n] for k, n in enumerate((30, 20, 30, 10))] == [True] * 4


def test_a_function_of_a_record_is_computed_once_for_each_of_the_latest_records():
    asked = []
    remembered = Remembered(lambda record: asked.append(record.answered) or record.answered)
    for count in (3, 2, 3, 2, 3):
        assert remembered(line(count)) == count
    assert asked == [3, 2]
    assert line(3) in remembered
    assert line(4) not in remembered
    for count in range(5, 25):
        remembered(line(count))
    assert line(3) not in remembered  # the oldest ones are forgotten
    assert remembered(line(3)) == 3


def test_what_is_asked_for_again_stays_while_others_are_forgotten():
    remembered = Remembered(lambda record: record.answered, 2)
    for ask in (remembered, remembered.known):
        for count in (3, 4):
            remembered(line(count))
        ask(line(3))
        remembered.keep(line(5), 5)
        assert [line(count) in remembered for count in (3, 4, 5)] == [True, False, True]


def test_that_nothing_is_known_is_remembered_too():
    asked = []
    remembered = Remembered(asked.append)
    assert [remembered(line(3)), remembered(line(3))] == [None, None]
    assert len(asked) == 1


@pytest.mark.parametrize(("asked", "now", "needed"), [(35, 80, 45), (95, 95, 0), (95, 75, 5), (95, 60, 0)])
def test_what_is_worth_keeping_is_the_latest_of_all_and_every_tenth_of_the_last_forty(asked, now, needed):
    study, later = Counting(), Counting()
    study.stages(line(asked))
    kept = dict(study.stages.worth_keeping(line(max(asked, now))))
    later.stages.recalled = lambda past: kept.get(past.key)
    later.stages(line(now))
    assert len(later.steps) == needed
    assert later.begun == 0
