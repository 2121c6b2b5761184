"""Names of scenarios: a plain name, or a name followed by its configuration in JSON."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from prefcal_env.errors import ScenarioError


def split_source(source: str) -> tuple[str, dict[str, Any] | None]:
    """Split 'overtake {"lanes_count": 3}' into the name and its configuration, None if absent.

    Raises:
        ScenarioError: If the text after the name is not a JSON object.
    """
    name, brace, rest = source.partition("{")
    if not brace:
        return source, None
    return name.strip(), _parsed(brace + rest, f"the configuration of {name.strip()!r}")


def joined_source(name: str, config: Mapping[str, Any]) -> str:
    """Return the source of the scenario called `name` with configuration `config`."""
    return f"{name} {json.dumps(config, ensure_ascii=False, sort_keys=True)}"


def with_config_of(source: str, path: Path | None) -> str:
    """Return `source` with the configuration from a JSON file, or unchanged if `path` is None.

    Raises:
        ScenarioError: If the file cannot be read or holds no JSON object, or if `source` already
            has a configuration.
    """
    if path is None:
        return source
    name, config = split_source(source)
    if config is not None:
        raise ScenarioError(f"{source!r} has a configuration: leave out --config {path}")
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ScenarioError(f"cannot read the configuration {str(path)!r}: {error}") from error
    return joined_source(name, _parsed(text, f"the configuration {str(path)!r}"))


def _parsed(text: str, what: str) -> dict[str, Any]:
    try:
        found = json.loads(text)
    except ValueError as error:
        raise ScenarioError(f"{what} is not JSON: {error}") from error
    if not isinstance(found, dict):
        raise ScenarioError(f'{what} must be a JSON object, {{"lanes_count": 3}}, got {text!r:.80}')
    return found
