"""Controllers as plain data, for files: nothing is executed to make them again."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from prefcal_env.errors import SettingsError
from prefcal_env.experiments.control import Controller

from .decentralized import Decentralized
from .pid import PID


def as_data(controller: Controller) -> dict[str, Any]:
    """Return a controller of this package as JSON-able data, from which `from_data` makes it.

    Infinite numbers become None. The memory of a run is not kept.

    Raises:
        SettingsError: If the controller is of another kind.
    """
    if isinstance(controller, PID):
        channels = {"output": controller.output, "input": controller.input}
        parameters = {k: _finite(v) for k, v in controller.parameters.items()}
        return {"controller": "PID", **channels, **parameters}
    if isinstance(controller, Decentralized):
        return {"controller": "Decentralized", "pids": [as_data(p) for p in controller.pids]}
    raise SettingsError(f"no data can hold a controller of type {type(controller).__name__}")


def from_data(data: Mapping[str, Any]) -> Controller:
    """Return the controller that `as_data` describes.

    Raises:
        SettingsError: If `data` describes no controller of this package.
    """
    kind = data.get("controller")
    content = {k: v for k, v in data.items() if k != "controller"}
    try:
        if kind == "PID":
            infinite = {"T_i": np.inf, "low": -np.inf, "high": np.inf}
            for name in infinite.keys() & content.keys():
                content[name] = infinite[name] if content[name] is None else content[name]
            return PID(**content)
        if kind == "Decentralized":
            pids = [from_data(each) for each in content["pids"]]
            return Decentralized([p for p in pids if isinstance(p, PID)])
    except (TypeError, KeyError, AttributeError) as error:
        raise SettingsError(f"the data of a {kind} do not fit: {error}") from error
    raise SettingsError(f"controller must be one of {list(KINDS)}, got {kind!r}")


KINDS = ("PID", "Decentralized")
"""Kinds of controllers that `from_data` makes."""


def _finite(value: float | None) -> float | None:
    return value if value is not None and np.isfinite(value) else None
