"""The application: studies with a person, what they see, and the command line `prefcal`.

Names are imported on first use, so that `prefcal --help` does not load plants and solvers.
"""

from typing import TYPE_CHECKING

from prefcal_env.on_first_use import public_names

if TYPE_CHECKING:
    from .cli.notebook import ask as ask
    from .looking.look import look as look
    from .report.export import load_controller as load_controller
    from .report.trajectories import figure as figure

__getattr__, __dir__, __all__ = public_names(__name__)
