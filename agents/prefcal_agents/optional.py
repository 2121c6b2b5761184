"""The agents that need an extra, by name: loaded when first asked for."""

from collections.abc import Mapping
from importlib import import_module
from types import MappingProxyType
from typing import Any

from prefcal_env.errors import SettingsError

OPTIONAL: Mapping[str, str] = MappingProxyType(
    {
        "ReferenceGLISp": "peers",
        "ReferenceGLIS": "peers",
        "OptunaPreferential": "peers",
        "PPOBandit": "rl",
        "SACBandit": "rl",
    }
)
"""Class to the package of `prefcal_agents` that it is in, which is also the extra's name."""


def optional(name: str) -> Any:
    """The class called `name`; made without its extra, it raises MissingExtraError.

    Raises:
        SettingsError: there is none of that name.
    """
    if name not in OPTIONAL:
        raise SettingsError(f"an optional agent must be one of {sorted(OPTIONAL)}, got {name!r}")
    return getattr(import_module(f"{__package__}.{OPTIONAL[name]}"), name)
