"""Controllers as plain data, for files: nothing is executed to make them again."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from prefcal_env.errors import SettingsError
from prefcal_env.experiments.control import Controller

from .linearized import Linearized
from .lqg import LQG
from .lqr import LQR
from .pid import PID, Decentralized


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
    if isinstance(controller, LQR):
        return {"controller": "LQR", **_of_lqr(controller)}
    if isinstance(controller, LQG):
        deviations = {"noise": controller.noise.tolist(), "process": controller.process.tolist()}
        return {"controller": "LQG", "lqr": as_data(controller.lqr), **deviations}
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
            for name in _INFINITE.keys() & content.keys():
                content[name] = _INFINITE[name] if content[name] is None else content[name]
            return PID(**content)
        if kind == "Decentralized":
            pids = [from_data(each) for each in content["pids"]]
            return Decentralized([p for p in pids if isinstance(p, PID)])
        if kind == "LQR":
            return _lqr(content)
        if kind == "LQG":
            return LQG(_lqr(content["lqr"]), content["noise"], content["process"])
    except (TypeError, KeyError, AttributeError, ValueError) as error:
        raise SettingsError(f"the data of a {kind} do not fit: {error}") from error
    raise SettingsError(f"controller must be one of {list(KINDS)}, got {kind!r}")


KINDS = ("PID", "Decentralized", "LQR", "LQG")
"""Kinds of controllers that `from_data` makes."""
_INFINITE = {"T_i": np.inf, "low": -np.inf, "high": np.inf}
"""Numbers that may be infinite, which are None in the data."""


def _finite(value: float | None) -> float | None:
    return value if value is not None and np.isfinite(value) else None


def _of_lqr(lqr: LQR) -> dict[str, Any]:
    model = {f.name: getattr(lqr.model, f.name).tolist() for f in fields(Linearized)}
    for name in ("low", "high"):
        model[name] = [_finite(limit) for limit in model[name]]
    weights = {name: getattr(lqr, name).tolist() for name in ("Q", "R", "Q_i")}
    return {"model": model, "T_s": lqr.T_s, "integral": list(lqr.integral), **weights}


def _lqr(content: Mapping[str, Any]) -> LQR:
    model = dict(content["model"])
    n_x, n_u, n_y = (len(model[name]) for name in ("x0", "u0", "y0"))
    for name in ("low", "high"):
        model[name] = [_INFINITE[name] if value is None else value for value in model[name]]
    # Lists without rows have no columns.
    for name, shape in {"A": (n_x, n_x), "B": (n_x, n_u), "C": (n_y, n_x)}.items():
        model[name] = np.reshape(model[name], shape)
    Q_i = np.reshape(content["Q_i"], (len(content["integral"]),) * 2)
    return LQR(
        Linearized(**model),
        content["Q"],
        content["R"],
        T_s=content["T_s"],
        integral=content["integral"],
        Q_i=Q_i,
    )
