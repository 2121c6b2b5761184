"""Load the agents that need an extra, on first use."""

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
"""Class name to its package in `prefcal_agents`, which is also the name of the extra."""


def optional(name: str) -> Any:
    """Return the class called `name`; creating one without its extra raises MissingExtraError.

    Raises:
        SettingsError: there is no such agent.
    """
    if name not in OPTIONAL:
        raise SettingsError(f"an optional agent must be one of {sorted(OPTIONAL)}, got {name!r}")
    return getattr(import_module(f"{__package__}.{OPTIONAL[name]}"), name)
