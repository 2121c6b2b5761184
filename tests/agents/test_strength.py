"""Answers with strength, from the answer to the next proposal."""

import numpy as np
import pytest

from prefcal_agents import GLISp, GLISpSettings, minimize_by_preference
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.preference import Answer, Strength

SQUARE = KnobSpace([Knob("a", -1.0, 1.0), Knob("b", -1.0, 1.0)])


def samples(much_above, settings=None, n_max=16):
    """Where GLISp goes on a bowl, told "much better" above a difference."""

    def prefer(a, b):
        difference = float(a @ a - b @ b)
        much = abs(difference) > much_above
        strength = Strength.MUCH_BETTER if much else Strength.BETTER
        return Answer(int(np.sign(difference)), strength=strength)

    return minimize_by_preference(
        prefer,
        SQUARE,
        agent=lambda space, **counts: GLISp(space, settings=settings, **counts),
        n_init=5,
        n_max=n_max,
    ).samples


@pytest.mark.unchecked  # for speed
def test_answers_of_strength_one_lead_where_they_always_led():
    """To the last bit, as if there were no strengths."""
    plain = minimize_by_preference(
        lambda a, b: int(np.sign(a @ a - b @ b)), SQUARE, n_init=5, n_max=16
    ).samples
    assert np.array_equal(samples(np.inf), plain)
    assert np.array_equal(samples(np.inf, GLISpSettings(strong_margins=False)), plain)


@pytest.mark.unchecked
def test_a_strong_answer_moves_what_comes_next():
    weak, strong = samples(np.inf), samples(0.5)
    assert np.array_equal(weak[:5], strong[:5])
    assert not np.array_equal(weak, strong)


def test_the_paper_has_no_margins_by_strength():
    assert GLISpSettings().strong_margins
    assert not GLISpSettings.paper().strong_margins
