"""The tests check shapes: a wrong one stops them."""

import jaxtyping
import numpy as np
import pytest

from prefcal_env.plants import CSTR


def test_a_wrong_shape_stops_a_test():
    with pytest.raises(jaxtyping.TypeCheckError):
        CSTR().f(np.zeros(3), np.zeros(1), np.zeros(2))


@pytest.mark.unchecked
def test_the_check_can_be_lifted():
    with pytest.raises(ValueError, match="unpack"):
        CSTR().f(np.zeros(3), np.zeros(1), np.zeros(2))
