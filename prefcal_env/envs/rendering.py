"""Metadata that Gymnasium needs before it makes an environment."""

from collections.abc import Callable
from typing import Any, TypeVar

Make = TypeVar("Make", bound=Callable[..., Any])


def makes(environment: type) -> Callable[[Make], Make]:
    """Return a decorator that marks an entry point as one that makes `environment`.

    `gymnasium.make` reads the render modes of an entry point; if they lack "human" and
    "rgb_array_list", it wraps the environment.
    """

    def mark(make: Make) -> Make:
        vars(make)["metadata"] = vars(environment)["metadata"]
        return make

    return mark
