"""The tests check shapes: a wrong one stops them."""

from dataclasses import dataclass

import jaxtyping
import numpy as np
import pytest
from jaxtyping import Float

from prefcal_env.plants import CSTR
from support.type_checker import check, jaxtyped

Pair = Float[np.ndarray, " 2"]


def test_a_wrong_shape_stops_a_test():
    with pytest.raises(jaxtyping.TypeCheckError):
        CSTR().f(np.zeros(3), np.zeros(1), np.zeros(2))


@pytest.mark.unchecked
def test_the_check_can_be_lifted():
    with pytest.raises(IndexError):
        CSTR().f(np.zeros(2), np.zeros(1), np.zeros(1))


def checked(function):
    return jaxtyped(typechecker=check)(function)


@checked
@dataclass
class Vector:
    """A shape in every place where one can stand."""

    x: Pair | None = None

    @checked
    @property
    def wrong(self) -> Pair:
        return np.zeros(3)

    @checked
    @classmethod
    def of(cls, x: list[Pair]):
        return cls(x[0])

    @checked
    @staticmethod
    def named(x: "Pair"):
        return x


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: Vector(np.zeros(3)),
        lambda: Vector().wrong,
        lambda: Vector.of([np.zeros(3)]),
        lambda: Vector.named(np.zeros(3)),
    ],
)
def test_a_shape_is_checked_wherever_it_stands(wrong):
    with pytest.raises(jaxtyping.TypeCheckError):
        wrong()


def test_what_mentions_no_shape_stays_as_it_is():
    def plain(x: int) -> str:
        return str(x)

    assert checked(plain) is plain
