"""Knobs of the result are put back, the one noticed least first, until something would be noticed."""

import numpy as np

from prefcal_agents.result import smaller_change
from prefcal_env.knobs import Knob, KnobSpace, LinearConstraint

KNOBS = [Knob(name, 0.0, 1.0) for name in "abcd"]
SPACE = KnobSpace(KNOBS)
RESULT, BEFORE = np.array([0.9, 0.8, 0.7, 0.5]), np.array([0.1, 0.2, 0.3, 0.5])
COSTS = np.array([0.03, 0.9, 0.01, 0.0])
"""What putting each knob back adds to the chance of being worse."""


def chances(thetas):
    return (thetas != RESULT) @ COSTS


def test_all_but_the_knob_that_matters_are_put_back():
    found = smaller_change(RESULT, BEFORE, SPACE, chances)
    assert found.theta == (0.1, 0.8, 0.3, 0.5)
    assert found.kept == (0, 2, 3)  # the last one is the same in both
    assert found.chance == 0.04


def test_it_takes_few_values():
    asked = []

    def counted(thetas):
        asked.extend(thetas)
        return np.zeros(len(thetas))

    assert smaller_change(RESULT, BEFORE, SPACE, counted).theta == tuple(BEFORE)
    assert len(asked) == 3 + 2 + 1


def test_there_is_none_if_every_knob_is_noticed():
    assert smaller_change(RESULT, BEFORE, SPACE, lambda thetas: np.full(len(thetas), 0.06)) is None
    assert smaller_change(RESULT, RESULT, SPACE, chances) is None


def test_what_constraints_forbid_is_not_tried():
    space = KnobSpace(KNOBS, [LinearConstraint("order", {"c": 1.0, "a": -1.0}, 0.0)])
    assert not space.allows(np.array([0.1, 0.8, 0.7, 0.5]))
    found = smaller_change(RESULT, BEFORE, space, chances)
    assert found.kept == (2, 3)
