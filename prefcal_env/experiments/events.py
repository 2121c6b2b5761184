"""Find what happens in a run, its events, and measure how an output responds to each of them.

docs/tracking.md shows the definitions with pictures.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int

Curve = Float[np.ndarray, " K"]
Kind = Literal["start", "step", "ramp", "load"]

# --- Events of an output: its start away from the reference, changes of the reference, and loads.

BAND = 0.03  # share of the size of an event that counts as settled, for channels without a band
_STILL = 1e-9  # share of its largest value below which a reference does not change
_LEAST = 0.02  # share of the largest error or change below which nothing is an event
_TOGETHER = 0.02  # share of the record: changes in one direction that are closer are one ramp
_SURE = 5.0  # standard deviations of noise
_ROUNDING = 1 + 1e-9  # 29.7 is within 0.3 of 30
_FEW = 20  # rows, below which nothing tells an oscillation from noise
_LOUD = 0.2  # share of the largest error above which a start is an event, however noisy it seems


@dataclass(frozen=True, slots=True)
class RunEvent:
    """Something that an output has to respond to."""

    # A start away from the reference, a change of the reference, at once or by and by, or a load, which
    # drives the output away although the reference stays
    kind: Kind
    first: int  # row of the record from whose instant times count
    last: int  # row from which the reference has its new value
    end: int  # row after the last one that belongs to the event
    size: float  # change that is wanted, in the unit of the output; 0 of a load
    band: float  # error that counts as settled, in the same unit


@dataclass(frozen=True, slots=True)
class _Begun:
    """A start or a change of a record, or its rest before the first one: then there is no kind."""

    kind: Kind | None
    first: int  # row
    last: int  # row from which the reference has its new value
    end: int  # row at which the next one begins
    size: float  # change that is wanted, with its sign
    band: float


def _begun(
    t: Curve, y: Curve, r: Curve, band: float | None, changes: Sequence[tuple[int, int]]
) -> tuple[list[_Begun], float]:
    """Return what begins in a record with these changes, and the largest error or change in it.

    Noise decides nothing: a start that it explains is no event. A change takes place at the first
    row that has it.
    """
    error, noise = float(np.abs(y - r).max()), noise_of(t, y - r)
    scale = max([error, *(abs(float(r[last] - r[first - 1])) for first, last in changes)])
    least = max(_LEAST * scale, min(_SURE * noise, _LOUD * scale))
    away = scale > _SURE * noise and abs(float(y[0] - r[0])) > least
    found = []
    for (first, last), (end, _) in pairwise([(0, 0), *changes, (len(t), 0)]):
        kind: Kind | None = "step" if last - first < 2 else "ramp"
        if not first:
            kind = "start" if away else None
        before = max(first - 1, 0)
        wanted = float(r[last] - y[before])  # from where it is, which may not be the old value
        size = max(abs(wanted), abs(float(r[last] - r[before])))
        own = BAND * size if kind else max(BAND * scale, _SURE * noise)  # noise ends no rest
        within = own if band is None else band
        found.append(_Begun(kind, first, last, end, float(np.copysign(size, wanted)), within))
    return found, scale


def _changes(t: Curve, y: Curve, r: Curve) -> Iterator[tuple[int, int]]:
    """Yield the first and the last row of each change of a reference in one direction.

    One that is small beside the others, or beside its noise, is none.
    """
    moves = np.diff(_without_noise(r, noise_of(t, r)))
    rows = np.flatnonzero(np.abs(moves) > _STILL * max(np.abs(r).max(), np.ptp(r))) + 1
    pause = _TOGETHER * (t[-1] - t[0])
    groups: list[list[int]] = []
    for row in rows.tolist():
        same = groups and moves[row - 1] * moves[groups[-1][-1] - 1] > 0
        if same and (row - groups[-1][-1] < 2 or t[row] - t[groups[-1][-1]] <= pause):
            groups[-1].append(row)
        else:
            groups.append([row])
    sizes = [abs(float(r[group[-1]] - r[group[0] - 1])) for group in groups]
    largest = max([float(np.abs(y - r).max()), *sizes])
    for group, size in zip(groups, sizes, strict=True):
        if size > _LEAST * largest:
            yield group[0], group[-1]


def _without_noise(r: Curve, noise: float) -> Curve:
    """Return a reference that changes only where noise, the same before and after, does not explain it."""
    held = r.copy()
    for k in range(1, len(r) if noise else 0):
        if abs(r[k] - held[k - 1]) <= _SURE * np.sqrt(2) * noise:
            held[k] = held[k - 1]
    return held


def _is_taken_away(t: Curve, y: Curve, r: Curve, first: int) -> bool:
    """Return whether a reference changes at the very end, and the output does not follow it any more."""
    late = first > 1 and t[-1] - t[first] <= _TOGETHER * (t[-1] - t[0])
    return bool(late and abs(y[-1] - r[-1]) > abs(y[-1] - r[first - 1]))


_ABRUPT = 0.2  # share of the rest before, within which a load drives the output out of its band
_LOAD = 0.05  # share of the largest error or change that the error after a load has at least
_REST = 5  # samples of a rest, at least


def _loads(t: Curve, error: Curve, first: int, end: int, band: float, scale: float) -> Iterator[int]:
    """Yield the row from which on each load acts: where an output that had settled leaves its band.

    An overshoot that comes slowly, or an oscillation, is no load: it has not rested for as long as
    it took to get there, or it does not leave abruptly.
    """
    size = np.abs(error)
    for begin, stop in _runs(size[first:end] <= band):
        i, j = first + begin, first + stop  # rows i ... j - 1 are within
        rest = t[j - 1] - t[i]
        calm = i + np.flatnonzero(size[i:j] <= band / 3)
        if j >= end or j - i < _REST or not len(calm):
            continue
        lasts = rest >= max(t[i] - t[first], _TOGETHER * (t[-1] - t[0]))
        abrupt = t[j] - t[calm[-1]] <= _ABRUPT * rest
        if lasts and abrupt and size[j:end].max() > max(_LOAD * scale, 2 * band):
            first = int(calm[-1])
            yield first
            yield from _loads(t, error, first, end, band, scale)
            return


def _runs(inside: Bool[np.ndarray, " M"]) -> Int[np.ndarray, "k 2"]:
    """Return the first row of each stretch that is true, and the row after its last one."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], inside.astype(np.int8), [0]])))
    return np.asarray(edges.reshape(-1, 2))


# --- Noise: it is neither a start away from the reference, nor does it end a rest in the band.

_LONGEST = 10  # largest number of samples of a median: those of the event by this number
_FEW, _OPPOSITE = 40, -1 / 3  # number of samples, and correlation of neighbors, from which noise can be told
_NORMAL = 1.4826  # standard deviation of normal noise, by the median of its size


def noise_of(t: Curve, y: Curve) -> float:
    """Return the standard deviation of noise, from each value's distance to the line beside it.

    Of the second half, where the transient is over. An oscillation is no noise: such distances of
    neighbors are alike there, and opposite in noise (their correlation is -2/3).
    """
    if len(t) < _FEW:
        return 0.0
    t, y = t[len(t) // 2 :], y[len(t) // 2 :]
    share = (t[1:-1] - t[:-2]) / (t[2:] - t[:-2])
    line = (1 - share) * y[:-2] + share * y[2:]
    size = np.sqrt(1 + share**2 + (1 - share) ** 2)
    apart = (y[1:-1] - line) / size
    opposite = apart[1:] @ apart[:-1] < _OPPOSITE * (apart @ apart)
    return float(_NORMAL * np.median(np.abs(apart))) if opposite else 0.0


def _smooth(error: Curve, noise: float, band: float) -> Curve:
    """Return the running median of an error over so many samples that the noise stays in the band."""
    wanted = (_SURE * noise / band) ** 2 if band > 0 else 0.0
    half = int(min(wanted, len(error) / _LONGEST)) // 2
    if not half:
        return error
    padded = np.pad(error, half, mode="reflect")
    return np.asarray(np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1), axis=1))


# --- What is measured of the events of an output.


@dataclass(frozen=True, slots=True)
class Response:
    """How an output follows its reference, at the instants `t` of a record of K rows."""

    # Instants, shape (K,), increasing, up to where the run is over: at the very end, the reference may be
    # taken away
    t: Curve
    y: Curve  # output, shape (K,)
    r: Curve  # reference, shape (K,)
    smooth: Curve  # error y - r with so little noise that it stays in the band, shape (K,)
    events: tuple[RunEvent, ...]  # events, in the order of time

    @classmethod
    def of(cls, t: Curve, y: Curve, r: Curve, band: float | None = None) -> "Response":
        """Find the events of an output.

        Args:
            t: Instants, shape (K,), increasing; two or more.
            y: Output, shape (K,), finite.
            r: Reference, shape (K,), finite.
            band: Error that counts as settled, in the unit of y; None for 3 % of each event.
        """
        changes = [*_changes(t, y, r)]
        for first, _ in changes:
            if _is_taken_away(t, y, r, first):
                return cls.of(t[:first], y[:first], r[:first], band)
        noise = noise_of(t, y - r)
        begun, scale = _begun(t, y, r, band, changes)
        smooth, events = np.empty(len(t)), []
        for each in begun:
            rows = slice(each.first, each.end)
            smooth[rows] = _smooth(y[rows] - r[rows], noise, each.band)
            stops = [*_loads(t, smooth, each.last, each.end, each.band, scale), each.end]
            if each.kind:
                events.append(RunEvent(each.kind, each.first, each.last, stops[0], each.size, each.band))
            events += [RunEvent("load", row, row, stop, 0.0, each.band) for row, stop in pairwise(stops)]
        return cls(t, y, r, smooth, tuple(events))

    @property
    def loads(self) -> tuple[RunEvent, ...]:
        """The loads."""
        return tuple(event for event in self.events if event.kind == "load")

    @property
    def changes(self) -> tuple[RunEvent, ...]:
        """The events but loads; of a record without one, the loads, or else the whole record."""
        found = tuple(event for event in self.events if event.kind != "load")
        error = self.y - self.r
        band = max(BAND * float(np.abs(error).max()), _SURE * noise_of(self.t, error))
        return found or self.loads or (RunEvent("load", 0, 0, len(self.t), 0.0, band),)

    def overshoot(self, event: RunEvent) -> float:
        """Return how far the output goes beyond the new value, on the other side than it comes from.

        After a load it comes from no side: its largest error counts.
        """
        beyond = self.y[event.first : event.end] - np.median(self.r[event.last : event.end])
        beyond = np.abs(beyond) if event.kind == "load" else np.sign(event.size) * beyond
        return max(float(beyond.max()), 0.0)

    def settling_time(self, event: RunEvent) -> float:
        """Return the time from the event until the error stays in the band; infinite for never."""
        rows = slice(event.first, event.end)
        return staying_time(self.t[rows], self.smooth[rows], event.band) - float(self.t[event.first])

    def lag(self, event: RunEvent) -> float:
        """Return by which time the output trails a ramp of its reference, at the end of the ramp."""
        first, last = event.first - 1, event.last
        speed = (self.r[last] - self.r[first]) / (self.t[last] - self.t[first])
        return max(float(-self.smooth[last] / speed), 0.0)

    def areas(self) -> tuple[float, float]:
        """Return the area between output and reference, and the one weighted with time.

        The output is a line between samples, and a reference that steps is held until it does. Time
        counts from the latest start or change.
        """
        left, right = self.y[:-1] - self.r[:-1], self.y[1:] - self.r[1:]
        since = np.zeros(len(self.t) - 1)
        for event in self.events:
            if event.kind == "step":  # the error jumps at the end of the interval before
                rows = slice(event.first - 1, event.last)
                right[rows] = self.y[1:][rows] - self.r[:-1][rows]
            if event.kind != "load":
                since[event.first :] = self.t[event.first]
        each = _area(left, right) * np.diff(self.t)
        middle = (self.t[1:] + self.t[:-1]) / 2 - np.maximum(since, self.t[0])
        return float(each.sum()), float(each @ middle)


def _area(left: Curve, right: Curve) -> Curve:
    """Return the mean size of lines from `left` to `right`, which may cross zero."""
    a, b = np.abs(left), np.abs(right)
    total = np.where(a + b > 0, a + b, 1.0)
    return np.asarray(np.where(left * right >= 0, a + b, (a**2 + b**2) / total) / 2)


def entry_time(t: Curve, error: Curve, band: float) -> float:
    """Return the instant of the last entry of an error into the band; infinite for never."""
    outside = np.flatnonzero(np.abs(error) > band * _ROUNDING)
    last = int(outside[-1]) if len(outside) else -1
    return float(t[last + 1]) if last + 1 < len(t) else np.inf


def staying_time(t: Curve, error: Curve, band: float) -> float:
    """Return the instant from which an error stays in the band; infinite for never.

    An oscillation is in the band at the end by chance. So the last visit must be as long as the longest
    one that ended, or a tenth of the time; the first one, before anything moved, is none of these.
    """
    found, outside = entry_time(t, error, band), np.abs(error) > band * _ROUNDING
    if len(t) < _FEW:
        return found
    turns = np.flatnonzero(np.diff(outside.astype(int))) + 1  # rows from which the error is in or out
    visits = [(t[a], t[b - 1]) for a, b in pairwise(turns.tolist()) if not outside[a]]
    longest = max((float(b - a) for a, b in visits), default=0.0)
    return found if t[-1] - found >= min(longest, float(t[-1] - t[0]) / 10) else np.inf
