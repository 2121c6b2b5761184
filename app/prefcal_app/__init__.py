"""The application: studies with a person, what they see, and the command line `prefcal`.

Names are imported on first use, so that `prefcal --help` does not load plants and solvers.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .looking.look import look as look
    from .report.export import export_controller as export_controller
    from .report.export import load_controller as load_controller
    from .report.pictures import figure as figure
    from .worlds.notebook import ask as ask


def __getattr__(name: str) -> Any:
    from prefcal_env.on_first_use import public_names  # here: `prefcal --help` need not load it

    return public_names(__name__).load(name)


def __dir__() -> list[str]:
    from prefcal_env.on_first_use import public_names

    return public_names(__name__).listed()
