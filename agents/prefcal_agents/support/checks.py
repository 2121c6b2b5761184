"""Check and save settings; each error says the name, the value and what was expected."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields
from typing import Any, Self

from prefcal_env.errors import SettingsError


@dataclass(frozen=True)
class Settings:
    """Base of an agent's settings, which are a frozen dataclass; this one has none."""

    __slots__ = ()

    def pairs(self) -> tuple[tuple[str, Any], ...]:
        """Return name and value of every setting, for an `AgentState`."""
        return tuple((f.name, getattr(self, f.name)) for f in fields(self))

    @classmethod
    def of(cls, saved: Mapping[str, Any]) -> Self:
        """Create settings from saved ones; a missing setting gets its default.

        Raises:
            SettingsError: If a setting is unknown or a value is not valid.
        """
        unknown = set(saved) - {f.name for f in fields(cls)}
        if unknown:
            agent = cls.__name__.removesuffix("Settings")
            raise SettingsError(f"{agent} has no settings called {sorted(unknown)}")
        return cls(**saved)


def choice(name: str, value: Any, options: Collection[str]) -> None:
    """Raise SettingsError unless `value` is one of `options`."""
    if not isinstance(value, str) or value not in options:
        raise SettingsError(f"{name} must be one of {sorted(options)}, got {value!r}")
