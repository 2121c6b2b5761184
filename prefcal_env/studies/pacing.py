"""How many comparisons for each experiment the agent of a study asks."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from prefcal_env.errors import StudyError

NAME = "questions_per_experiment"
"""Of the agent's setting."""


def questions_of(configuration: Mapping[str, Any]) -> int:
    """Most comparisons for each experiment, of the configuration of a study as it stands.

    Raises:
        StudyError: it is no whole number.
    """
    settings = _settings(configuration.get("agent"))
    most = 1 if settings is None else settings.get(NAME, 1)
    if type(most) is not int:
        raise StudyError(f"{NAME} of a study must be a whole number, got {most!r}")
    return most


def paced(configuration: Mapping[str, Any], questions: int) -> Mapping[str, Any]:
    """`configuration` with at most so many.

    Raises:
        StudyError: fewer than one, or the study's agent has no settings.
    """
    if questions < 1:
        raise StudyError(f"there must be 1 or more questions per experiment, got {questions}")
    agent: Any = configuration.get("agent")
    settings = _settings(agent)
    if settings is None:
        raise StudyError("the agent of the study has no settings that could be changed")
    changed = {**agent, "settings": {**settings, NAME: questions}}
    return MappingProxyType({**configuration, "agent": changed})


def _settings(agent: Any) -> Mapping[str, Any] | None:
    settings = agent.get("settings") if isinstance(agent, Mapping) else None
    return settings if isinstance(settings, Mapping) else None
