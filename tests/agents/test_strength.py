"""Answers with strength, from the answer to the next proposal."""

import numpy as np
import pytest

from prefcal_agents import GLISp, minimize_by_preference
from prefcal_agents.history.lessons import Preferences
from prefcal_env.knobs.knob import Knob
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.answer import Answer
from prefcal_env.preferences.history import History
from support.histories import in_cube

SQUARE = KnobSpace([Knob("a", -1.0, 1.0), Knob("b", -1.0, 1.0)])


@pytest.mark.unchecked  # for speed
def test_answers_of_strength_one_lead_where_they_always_led():
    """To the last bit, as if there were no strengths."""

    def samples(prefer):
        return minimize_by_preference(prefer, SQUARE, agent=GLISp, n_init=5, n_max=16).samples

    plain = samples(lambda a, b: int(np.sign(a @ a - b @ b)))
    weak = samples(lambda a, b: Answer(int(np.sign(a @ a - b @ b)), strength=1))
    assert np.array_equal(plain, weak)


def test_the_strength_of_an_answer_is_its_weight():
    book = History()
    for h, strength in enumerate((1, 1, 3)):
        answer = Answer(-1 if h else None, strength=strength)
        book = book.with_pending(in_cube(np.array([0.1 * h, 0.5]))).with_answer(
            answer, book.incumbent
        )
    assert Preferences.of(book).weights.tolist() == [1, 3]
