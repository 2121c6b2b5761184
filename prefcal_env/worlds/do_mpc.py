"""A do-mpc controller as a `Controller`. do-mpc is not imported: the object is made already."""

from typing import Any

import numpy as np

from prefcal_env.errors import SettingsError
from prefcal_env.experiments.experiment import Measurement, Move


class DoMPC:
    """A controller of do-mpc, or any object with `make_step`, as a `Controller`.

    Make a new `mpc` for each experiment, since it remembers its last plan. A step whose solver
    reports no success counts as not solved, and the last input is held.

    Args:
        mpc: Object that is set up and has `make_step(x0)`, which takes the state as a column and
            returns the input, such as `do_mpc.controller.MPC`.
        T_s: Sampling time, in the plant's unit of time; None uses `t_step` of the settings of
            `mpc`.
        estimator: Object with `make_step(y0)` that estimates the state from the measured outputs,
            such as `do_mpc.estimator.MHE`; None uses the state of the measurement.

    Raises:
        SettingsError: If `mpc` or `estimator` has no `make_step`, or there is no sampling time.
    """

    def __init__(self, mpc: Any, T_s: float | None = None, *, estimator: Any = None) -> None:
        for name, part in (("mpc", mpc), ("estimator", estimator)):
            if part is not None and not callable(getattr(part, "make_step", None)):
                raise SettingsError(f"{name} must have make_step, as in do-mpc, got {part!r:.80}")
        step = getattr(getattr(mpc, "settings", None), "t_step", None) if T_s is None else T_s
        if step is None:
            raise SettingsError("state the sampling time: mpc has no settings.t_step, and T_s=None")
        self._mpc, self._estimator, self._T_s = mpc, estimator, float(step)
        self._started = False

    @property
    def T_s(self) -> float:
        """Sampling time, in the plant's unit of time."""
        return self._T_s

    def move(self, measurement: Measurement) -> Move:
        """Return the first input of the plan from the measured or estimated state."""
        if not self._started:
            self._start(measurement)
        x = measurement.x
        if self._estimator is not None:
            x = np.asarray(self._estimator.make_step(_column(measurement.y)), dtype=float)
        u = np.asarray(self._mpc.make_step(_column(x)), dtype=float).reshape(-1)
        stats = getattr(self._mpc, "solver_stats", None) or {}
        iterations, solved = stats.get("iter_count", 0), stats.get("success", True)
        return Move(u, iterations=int(iterations), solved=bool(solved))

    def _start(self, measurement: Measurement) -> None:
        """Set the first guess, which do-mpc demands before the first step."""
        for part in (self._mpc, self._estimator):
            if hasattr(part, "set_initial_guess"):
                part.x0 = _column(measurement.x)
                part.set_initial_guess()
        self._started = True


def _column(values: Any) -> np.ndarray:
    return np.asarray(values, dtype=float).reshape(-1, 1)
