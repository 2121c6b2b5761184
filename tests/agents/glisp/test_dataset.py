"""What a history teaches."""

import numpy as np

from prefcal_agents.glisp.selection import Dataset
from prefcal_agents.history.lessons import MOST, cube_of
from prefcal_env.preferences.answer import Answer
from prefcal_env.preferences.history import History
from support.histories import in_cube


def history_of(answers):
    """Return samples on a line, each compared with the first."""
    history = History()
    for k, answer in enumerate(answers):
        z = np.array([k / len(answers), 0.5])
        history = history.with_pending(in_cube(z)).with_answer(Answer(answer), 0 if k else None)
    return history


def test_a_data_set_is_strict_once_an_answer_says_which_is_better():
    vague = history_of([None, 0, None, 0])
    assert not Dataset.of(vague).is_strict
    clear = vague.with_follow_up(Answer(1), 3, 0)
    assert Dataset.of(clear).is_strict
    assert not Dataset.of(clear.retracted(0, follow_up=True)).is_strict


def test_of_a_long_history_a_part_is_kept_and_numbered_anew():
    history = history_of([None] + [1] * (MOST + 100))
    data = Dataset.of(history)
    assert data.history is history
    assert len(data.preferences) == MOST
    assert len(data.kept) == len(data.preferences.samples) < MOST + 101
    assert np.array_equal(data.preferences.samples, cube_of(history)[data.kept])
