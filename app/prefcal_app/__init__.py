"""The application: studies with a person, what they see, and the command line `prefcal`.

Names are imported on first use, so that `prefcal --help` does not load plants and solvers.
"""

from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .cli.notebook import ask as ask
    from .looking.look import look as look
    from .report.export import load_controller as load_controller
    from .report.trajectories import figure as figure

_HOMES = {
    "ask": "cli.notebook",
    "figure": "report.trajectories",
    "load_controller": "report.export",
    "look": "looking.look",
}

__all__ = list(_HOMES)


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(f".{_HOMES[name]}", __name__), name)
    if not name.startswith("_") and find_spec(f"{__name__}.{name}") is not None:
        return import_module(f".{name}", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})
