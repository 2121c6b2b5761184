"""Judgements of people with just noticeable differences: what differs by less is about the same."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Float, Int

from .rule import minus, noticeable, sign
from .runs import Runs

_FAR_OFF, _FAR_WORSE = 10.0, 100.0
"""Number of scales beyond which a KPI is as far from the ideal, or as bad, as it can be."""


@dataclass(frozen=True, slots=True)
class Noticed:
    """A KPI, or something seen in the curves, with the largest difference that is not noticed."""

    name: str  # name of the KPI or of the look
    # Just noticeable difference: in its unit, or if `relative`, as a share of the larger value
    noticed: float
    at_most: float = -np.inf  # limit below which all values are equally good, in its unit
    relative: bool = False

    def verdict(self, a: Runs, b: Runs) -> Int[np.ndarray, " K"]:
        """Return -1 where `a` is noticeably lower above the limit, 0 for a tie, 1 where `b` is."""
        x, y = (np.maximum(runs.column(self.name), self.at_most) for runs in (a, b))
        if not self.relative:
            return noticeable(minus(x, y), self.noticed)
        larger = np.maximum(np.abs(x), np.abs(y))
        return noticeable(minus(x, y), self.noticed * np.where(np.isinf(larger), 0.0, larger))


@dataclass(frozen=True, slots=True)
class Order:
    """A `Judgement`: the first of `criteria` that differs noticeably decides; else it is a tie."""

    criteria: tuple[Noticed, ...]

    def verdict(self, a: Runs, b: Runs) -> Int[np.ndarray, " K"]:
        """Return -1 where `a` is noticeably better, 0 for a tie, and 1 where `b` is."""
        found = self.criteria[0].verdict(a, b)
        for criterion in self.criteria[1:]:
            found = np.where(found == 0, criterion.verdict(a, b), found)
        return found


@dataclass(frozen=True, slots=True)
class Majority:
    """A `Judgement`: each of `criteria` has a vote if it differs noticeably; even votes are a tie.

    It goes round in circles at times, as votes do.
    """

    criteria: tuple[Noticed, ...]

    def verdict(self, a: Runs, b: Runs) -> Int[np.ndarray, " K"]:
        """Return -1 where more votes are for `a`, 0 for as many, and 1 where more are for `b`."""
        return sign(np.sum([criterion.verdict(a, b) for criterion in self.criteria], axis=0))


class Part(Protocol):
    """One KPI of a total."""

    def cost(self, runs: Runs) -> Float[np.ndarray, " K"]:
        """Return what it adds, 0 or more, lower is better, shape (K,)."""


@dataclass(frozen=True, slots=True)
class Total:
    """A `Judgement`: the smaller total is better."""

    parts: Sequence[Part]  # what counts
    noticed: float  # just noticeable difference of the total
    # Exponent of the total: 1 adds up, 2 is as the crow flies, and with infinity the largest part decides
    power: float = 1.0

    def total(self, runs: Runs) -> Float[np.ndarray, " K"]:
        """Return the total, shape (K,)."""
        costs = np.array([part.cost(runs) for part in self.parts])
        return np.asarray(np.linalg.norm(costs, ord=self.power, axis=0))

    def verdict(self, a: Runs, b: Runs) -> Int[np.ndarray, " K"]:
        """Return -1 where `a` is noticeably better, 0 for a tie, and 1 where `b` is."""
        return noticeable(self.total(a) - self.total(b), self.noticed)


@dataclass(frozen=True, slots=True)
class Wish:
    """The distance of one KPI, or of one look, from that of the ideal run."""

    name: str  # name of the KPI or of the look
    value: float  # value that one would like; lower ones are as good, in its unit
    scale: float  # unit of its distance, above 0, in its unit

    def cost(self, runs: Runs) -> Float[np.ndarray, " K"]:
        """Return the distance in scales, from 0 to 10, shape (K,)."""
        return _beyond(runs, self.name, self.value, self.scale, _FAR_OFF)


@dataclass(frozen=True, slots=True)
class Rank:
    """The rank of one KPI among usual runs."""

    name: str  # name of the KPI
    marks: tuple[float, ...]  # values that usual runs have, rising, in its unit
    shares: tuple[float, ...]  # share of usual runs that are better than each of `marks`, from 0 to 1, rising

    def cost(self, runs: Runs) -> Float[np.ndarray, " K"]:
        """Return the share of usual runs that are better, shape (K,), 1 beyond the last mark."""
        values = runs.column(self.name)
        inside = np.minimum(values, self.marks[-1])
        return np.where(values > self.marks[-1], 1.0, np.interp(inside, self.marks, self.shares))


@dataclass(frozen=True, slots=True)
class Loss:
    """One KPI of a trade-off with diminishing returns."""

    name: str  # name of the KPI
    weight: float  # weight, above 0
    good: float  # value that could not be better, in the KPI's unit
    scale: float  # distance from `good` from which on ratios count, above 0, in that unit
    power: float  # exponent, 1 or more: the larger, the less is gained near `good`

    def cost(self, runs: Runs) -> Float[np.ndarray, " K"]:
        """Return weight · log(1 + (distance / scale)^power), shape (K,)."""
        scales = _beyond(runs, self.name, self.good, self.scale, _FAR_WORSE)
        return self.weight * np.log1p(scales**self.power)


def _beyond(runs: Runs, name: str, value: float, scale: float, most: float) -> Float[np.ndarray, " K"]:
    """Return how far a KPI is beyond a value, from 0 to `most` scales, shape (K,)."""
    beyond = np.maximum(runs.column(name) - value, 0.0)
    return np.minimum(beyond, most * scale) / scale
