"""The trajectory of an episode while it grows: on a fixed grid and at the sampling instants."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from .experiment import Channels, End

_SAME_INSTANT = 1e-9
"""Instants that are closer than this share of the grid's step are one."""


def instants(
    t: float, end: float, dense_step: float
) -> tuple[Float[np.ndarray, " M"], Float[np.ndarray, " M"]]:
    """Instants to record after `t` up to `end`: multiples of `dense_step`, then `end`.

    Multiples that coincide with `t` or `end` are left out, so none comes twice.

    Returns:
        The instants, shape (M,), and the same relative to `t`.
    """
    close = _SAME_INSTANT * dense_step
    first = int(np.floor((t + close) / dense_step)) + 1
    last = int(np.ceil((end - close) / dense_step))
    absolute = np.append(np.arange(first, last) * dense_step, end)
    return absolute, absolute - t


@dataclass(frozen=True, slots=True)
class Record:
    """An episode so far, as `Experiment` wants it: K dense instants and N steps.

    Args:
        t: Dense instants, shape (K,).
        x: States there, shape (K, n_x), finite.
        u: Inputs held from there on, shape (K, n_u).
        t_control: Sampling instants, shape (N,).
        u_control: Inputs decided there, shape (N, n_u).
        y_ref: Output references there, shape (N, n_y).
        channels: Names, units, limits and targets.
        end: Why it ended; None while it goes on.
        signals: Further signals on `t` by name, each shape (K,).
        y: Outputs at `t`, shape (K, n_y); None where they are not recorded.
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
    """Collects the steps of one episode, which starts in `x0` after input `u0`."""

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
        """Append a period: instants and states after its start, its input and references."""
        self._t.append(t)
        self._x.append(x)
        self._u.append(u)
        self._y_ref.append(y_ref)

    def record(self, channels: Channels, end: End | None) -> Record:
        """Everything so far; before the first step one instant and no step."""
        n_steps, n_u, n_y = len(self._u), len(channels.u), len(channels.y)
        t = np.concatenate([np.zeros(1), *self._t])
        lengths = np.array([len(period) for period in self._t], dtype=int)
        starts = np.concatenate([[0], np.cumsum(lengths)])  # index of every period's start in t
        u_control = np.array(self._u).reshape(n_steps, n_u)
        u = np.repeat(u_control, lengths, axis=0)  # from a period's start to before its end
        last = self._u[-1] if n_steps else self.u0
        return Record(
            t=t,
            x=np.concatenate([self.x0[None], *self._x]),
            u=np.concatenate([u, last[None]]),
            t_control=t[starts[:n_steps]],
            u_control=u_control,
            y_ref=np.array(self._y_ref).reshape(n_steps, n_y),
            channels=channels,
            end=end,
        )
