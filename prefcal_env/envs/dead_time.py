"""Dead time of inputs, outputs and measurements, exact for any length and sampling time."""

from bisect import bisect_right
from collections.abc import Callable
from itertools import pairwise
from math import isfinite
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.plants.jacobians import D, U, X
from prefcal_env.plants.plant import Plant

_SAME_INSTANT = 1e-10
"""Share of a sampling period below which two instants count as one."""


def delays_of(plant: Plant) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the dead times of inputs and outputs in the plant's unit of time; 0 if it has none."""
    given = getattr(plant, "input_delay", ()), getattr(plant, "output_delay", ())
    n_u, n_y = len(plant.inputs), len(plant.outputs)
    return (tuple(given[0]) or (0.0,) * n_u, tuple(given[1]) or (0.0,) * n_y)


def dead_times(plant: Plant) -> Float[np.ndarray, "n_y n_u"]:
    """Return the dead time from each input to each output, in the plant's unit of time."""
    inputs, outputs = delays_of(plant)
    entries = getattr(plant, "entry_delay", ()) or 0.0
    return np.asarray(np.add.outer(outputs, inputs) + np.array(entries))


class DeadTime:
    """The part of an episode that a plant with dead time remembers.

    A sampling period is divided where a delayed input changes, so that dead times need not be
    multiples of the sampling time. Before the start, the plant is at its initial state and input.

    Args:
        plant: Plant whose inputs are delayed.
        x0: State at time 0, shape (n_x,).
        u0: Input before time 0, shape (n_u,).
        d0: Measured disturbances at time 0, shape (n_d,).
    """

    def __init__(self, plant: Plant, x0: X, u0: U, d0: D) -> None:
        self._plant, self._delays = plant, delays_of(plant)[0]
        self._distinct = sorted(set(self._delays))
        self._given_at, self._given = [-np.inf], [u0]  # inputs as they are decided
        self._since, self._spans = [-np.inf], [(x0, u0, d0)]  # as they reach the plant
        self._tolerance = 0.0
        self._end = -np.inf, x0  # the latest state
        entries = getattr(plant, "entry_delay", ())
        self._entries = np.pad(entries, ((0, 0), (0, 1))) if entries else None

    def hold(self, x: X, u: U, d: D, t: Float[np.ndarray, " M"]) -> Float[np.ndarray, "M1 n_x"]:
        """Decide u at `t[0]` and hold it until `t[-1]`; return the states at `t[1:]`."""
        start, end = float(t[0]), float(t[-1])
        self._tolerance = _SAME_INSTANT * (end - start)
        self._given_at.append(start)
        self._given.append(u)
        changes = self._changes(start, end)
        if not changes:
            return self._held(x, d, start, t[1:])
        rows: list[np.ndarray] = []
        for a, b in pairwise([start, *changes, end]):
            inside = t[(t > a) & (t <= b)]
            instants = inside if len(inside) and inside[-1] == b else np.append(inside, b)
            states = self._held(x, d, a, instants)
            rows.append(states[: len(inside)])
            x = states[-1]
        return np.concatenate(rows)

    def _held(self, x: X, d: D, start: float, t: Float[np.ndarray, " M"]) -> Float[np.ndarray, "M n_x"]:
        """Return the states at `t` after x at `start`; no delayed input changes meanwhile."""
        reaching = self._reaching(start)
        self._since.append(start)
        self._spans.append((x, reaching, d))
        if all(map(isfinite, x.tolist())):
            states = self._plant.hold(x, reaching, d, t - start)
        else:
            states = np.full((len(t), len(x)), np.nan)
        self._end = float(t[-1]), states[-1]
        return states

    def outputs(self, t: float, delays: tuple[float, ...]) -> Float[np.ndarray, " n_y"]:
        """Return the outputs as seen at `t`, each from as long ago as its delay, shape (n_y,)."""
        if self._entries is not None:
            return self._joined(t, self._entries + np.array(delays)[:, None])
        if len(delays) == 1:
            return np.array(self._output(t - delays[0]))
        seen = {delay: self._output(t - delay) for delay in set(delays)}
        return np.array([seen[delay][i] for i, delay in enumerate(delays)], dtype=float)

    def _joined(self, t: float, ago: Float[np.ndarray, "n_y n"]) -> Float[np.ndarray, " n_y"]:
        """Return the sums of what each input adds to the outputs, from as long ago as `ago`."""
        y = np.zeros(len(ago))
        for delay in np.unique(ago).tolist():
            entries = self._output(t - delay, self._plant.entries)  # type: ignore[attr-defined]
            y += np.where(ago == delay, entries, 0.0).sum(axis=1)
        return y

    def _changes(self, start: float, end: float) -> list[float]:
        """Return the instants between `start` and `end` at which a delayed input changes."""
        first, last = start + self._tolerance, end - self._tolerance
        found: list[float] = []
        for delay in self._distinct:
            begin = bisect_right(self._given_at, first - delay)
            for given in self._given_at[max(begin, 1) :]:
                if (t := given + delay) >= last:
                    break
                if t > first:
                    found.append(t)
        merged: list[float] = []
        for t in sorted(found):
            if not merged or t - merged[-1] > self._tolerance:
                merged.append(t)
        return merged

    def _reaching(self, t: float) -> Float[np.ndarray, " n_u"]:
        """Return the inputs that act on the plant from `t` on, shape (n_u,)."""
        chosen = [
            self._given[bisect_right(self._given_at, t - delay + self._tolerance) - 1][i]
            for i, delay in enumerate(self._delays)
        ]
        return np.array(chosen, dtype=float)

    def _output(self, t: float, g: Callable[..., Any] | None = None) -> np.ndarray:
        """Return the outputs of the plant at `t`, or what `g` makes of its state."""
        k = bisect_right(self._since, t + self._tolerance) - 1
        x, u, d = self._spans[k]
        ago = t - self._since[k]
        if k == len(self._since) - 1 and abs(t - self._end[0]) <= self._tolerance:
            x = self._end[1]
        elif self._tolerance < ago < np.inf:
            x = self._plant.hold(x, u, d, np.array([ago]))[0]
        return np.asarray((g or self._plant.g)(x, u, d), dtype=float)
