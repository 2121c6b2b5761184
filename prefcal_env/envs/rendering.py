"""What Gymnasium must know of an environment before it makes it."""

from collections.abc import Callable
from typing import Any, TypeVar

Make = TypeVar("Make", bound=Callable[..., Any])


def makes(environment: type) -> Callable[[Make], Make]:
    """Mark an entry point as one that makes `environment`.

    `gymnasium.make` reads render modes from an entry point, and where they lack "human" and
    "rgb_array_list" it wraps what it gets.
    """

    def mark(make: Make) -> Make:
        vars(make)["metadata"] = vars(environment)["metadata"]
        return make

    return mark
