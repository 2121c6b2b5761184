"""The trajectory of a running episode, on a fixed grid and at the sampling instants."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import ceil, floor

import numpy as np
from jaxtyping import Float

from .experiment import Channels, End

_SAME_INSTANT = 1e-9
"""Share of the grid's step below which two instants count as one."""


def instants(t: float, end: float, dense_step: float) -> Float[np.ndarray, " M"]:
    """Return the instants to record: `t`, the multiples of `dense_step` in between, and `end`.

    Multiples that coincide with `t` or `end` are left out, so that no instant appears twice.
    """
    close = _SAME_INSTANT * dense_step
    first = floor((t + close) / dense_step) + 1
    last = ceil((end - close) / dense_step)
    return np.array([t, *(k * dense_step for k in range(first, last)), end])


@dataclass(frozen=True, slots=True)
class Record:
    """The record of an episode so far, from which an `Experiment` is made.

    It has K dense instants and N steps, and arrays as in `Experiment`; `end` is None while the
    episode goes on.
    """

    t: Float[np.ndarray, " K"]
    x: Float[np.ndarray, "K n_x"]
    u: Float[np.ndarray, "K n_u"]
    t_control: Float[np.ndarray, " N"]
    u_control: Float[np.ndarray, "N n_u"]
    y_ref: Float[np.ndarray, "N n_y"]
    channels: Channels
    end: End | None
    signals: Mapping[str, Float[np.ndarray, " K"]] = field(default_factory=dict)
    y: Float[np.ndarray, "K n_y"] | None = None


@dataclass(slots=True)
class Trajectory:
    """A collector of the steps of one episode, which starts in `x0` after input `u0`."""

    x0: Float[np.ndarray, " n_x"]
    u0: Float[np.ndarray, " n_u"]
    _t: list[Float[np.ndarray, " M"]] = field(default_factory=list)
    _x: list[Float[np.ndarray, "M n_x"]] = field(default_factory=list)
    _u: list[Float[np.ndarray, " n_u"]] = field(default_factory=list)
    _y_ref: list[Float[np.ndarray, " n_y"]] = field(default_factory=list)

    def add(
        self,
        t: Float[np.ndarray, " M"],
        x: Float[np.ndarray, "M n_x"],
        u: Float[np.ndarray, " n_u"],
        y_ref: Float[np.ndarray, " n_y"],
    ) -> None:
        """Append a period: instants and states after its start, its input and its references."""
        self._t.append(t)
        self._x.append(x)
        self._u.append(u)
        self._y_ref.append(y_ref)

    def record(self, channels: Channels, end: End | None) -> Record:
        """Return everything so far; before the first step, one instant and no step."""
        n_steps, n_u, n_y = len(self._u), len(channels.u), len(channels.y)
        t = np.concatenate([np.zeros(1), *self._t])
        lengths = np.array([len(period) for period in self._t], dtype=int)
        starts = np.concatenate([[0], np.cumsum(lengths)])  # index of every period's start in t
        u_control = np.concatenate([np.zeros(0), *self._u]).reshape(n_steps, n_u)
        u = np.repeat(u_control, lengths, axis=0)  # each period's input, until before its end
        last = self._u[-1] if n_steps else self.u0
        return Record(
            t=t,
            x=np.concatenate([self.x0[None], *self._x]),
            u=np.concatenate([u, last[None]]),
            t_control=t[starts[:n_steps]],
            u_control=u_control,
            y_ref=np.concatenate([np.zeros(0), *self._y_ref]).reshape(n_steps, n_y),
            channels=channels,
            end=end,
        )
