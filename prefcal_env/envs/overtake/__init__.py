"""`prefcal/Overtake-v0`: the overtaking of section IV-B as an environment.

`OvertakeEnv` is loaded lazily, since highway-env takes a second to import.
"""

from typing import TYPE_CHECKING, Any

from .course import Course as Course
from .course import Mishap as Mishap
from .options import OvertakeOptions as OvertakeOptions

if TYPE_CHECKING:
    from .env import OvertakeEnv as OvertakeEnv


def __getattr__(name: str) -> Any:
    if name != "OvertakeEnv":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from .env import OvertakeEnv

    return OvertakeEnv
