"""Several PIDs side by side, one for each pair of an input and an output."""

from collections.abc import Sequence

import numpy as np

from prefcal_env.errors import SettingsError
from prefcal_env.experiments.control import Measurement, Move

from .pid import PID


class Decentralized:
    """A `Controller` made of PIDs, each with an output and an input of its own.

    Args:
        pids: One or more PIDs with the same sampling time and different inputs.

    Raises:
        SettingsError: If there is none, sampling times differ, or two PIDs have the same input.
    """

    def __init__(self, pids: Sequence[PID]) -> None:
        self.pids = tuple(pids)
        strangers = [p for p in self.pids if not isinstance(p, PID)]
        if not self.pids or strangers:
            raise SettingsError(f"Decentralized needs one or more PIDs, got {strangers or 'none'}")
        times = sorted({p.T_s for p in self.pids})
        if len(times) > 1:
            raise SettingsError(f"Decentralized: all PIDs need the same T_s, got {times}")
        inputs = [p.input for p in self.pids]
        if len(set(inputs)) < len(inputs):
            raise SettingsError(f"Decentralized: each PID needs its own input, got {inputs}")

    @property
    def T_s(self) -> float:
        """Sampling time, in the plant's unit of time."""
        return self.pids[0].T_s

    def move(self, measurement: Measurement) -> Move:
        """Let each PID decide its input; inputs without a PID stay as they are."""
        u = np.array(measurement.u, dtype=float)
        for pid in self.pids:
            u[pid.input] = pid.move(measurement).u[pid.input]
        return Move(u)
