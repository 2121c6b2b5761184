"""Many θ at once are treated as one by one, and a part of a space is checked."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefcal_env.errors import KnobError
from prefcal_env.knobs import Knob, KnobSpace

SPACE = KnobSpace(
    [
        Knob("real", 2.0, 5.0, step=0),
        Knob("count", 3, 17, integer=True),
        Knob("decades", 1, 5000, scale="log10", integer=True),
    ]
)
coordinate = st.floats(0, 1)


@given(st.tuples(coordinate, coordinate, coordinate))
def test_snapping_many_agrees_with_snapping_one(z):
    snapped, one = SPACE.snap_all(np.array([z]))[0], SPACE.snap(np.array(z))
    assert snapped[0] == z[0]
    assert SPACE.check(SPACE.decode(snapped))[1:] == pytest.approx(SPACE.decode(one)[1:], abs=1)
    half_way = [(3 + 14 * z[1]) % 1, 5000 ** z[2] % 1]
    for k, part in enumerate(half_way, start=1):
        # Just between two integers, rounding may take either.
        assert abs(part - 0.5) < 1e-9 or snapped[k] == pytest.approx(one[k], abs=1e-12)


@given(st.lists(st.tuples(coordinate, coordinate, coordinate), max_size=5))
def test_encoding_many_agrees_with_encoding_one(points):
    thetas = np.array([SPACE.decode(np.array(z)) for z in points]).reshape(-1, 3)
    z = SPACE.encode_all(thetas)
    assert z.shape == thetas.shape
    for theta, found in zip(thetas, z, strict=True):
        assert found == pytest.approx(SPACE.encode(theta), abs=1e-14)


@pytest.mark.parametrize(
    ("theta", "words"),
    [
        ((1.9, 3, 1), "'real' must be in"),
        ((2.0, 3.5, 1), "'count' must be an integer"),
        ((2.0, 3, np.nan), "must be finite"),
        ((2.0, 3, np.inf), "must be finite"),
        ((2.0, 3, 0), "'decades' must be in"),
        ((2.0, 3), "must have shape"),
    ],
)
def test_of_many_the_first_that_cannot_be_is_refused(theta, words):
    fine = (2.0, 3.0, 1.0)[: len(theta)]
    with pytest.raises(KnobError, match=words):
        SPACE.encode_all(np.array([fine, theta, np.full(len(theta), 9e9)], dtype=float))


@given(st.tuples(coordinate, coordinate, coordinate))
def test_decoding_many_agrees_with_decoding_one(z):
    z = SPACE.snap_all(np.array([z]))
    assert SPACE.decode_all(z)[0] == pytest.approx(SPACE.decode(z[0]), rel=1e-12, abs=1e-12)


def test_a_part_that_rounding_leaves_no_room_in_is_refused():
    with pytest.raises(KnobError, match="too narrow to search"):
        SPACE.narrowed({"real": (3.0, 3.0 + 1e-12)})
    with pytest.raises(KnobError, match=r"expected a part of \[2.0, 5.0\], got 1 to 3"):
        SPACE.narrowed({"real": (1, 3)})
    with pytest.raises(KnobError, match=r"existing knobs, got \['speed'\]"):
        SPACE.narrowed({"speed": (0, 1)})
