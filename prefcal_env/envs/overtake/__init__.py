"""`prefcal/Overtake-v0`: the overtaking of section IV-B as an environment.

The names are imported on first use, since highway-env takes a second to import.
"""

from typing import TYPE_CHECKING

from prefcal_env.on_first_use import public_names

if TYPE_CHECKING:
    from .course import Course as Course
    from .course import Mishap as Mishap
    from .env import OvertakeEnv as OvertakeEnv
    from .scene import OvertakeOptions as OvertakeOptions

__getattr__, __dir__, __all__ = public_names(__name__)
