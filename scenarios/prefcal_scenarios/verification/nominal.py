"""The nominal loop: its margins, with their limits, and its KPIs with other draws of the sensor noise."""

import pickle
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.controllers.margins import UNCONSTRAINED, UNSTABLE, Margins, margins, margins_at_target
from prefcal_env.envs.task import Task
from prefcal_env.envs.varied_loop import IDENTIFIED, NOISE, at_target
from prefcal_env.errors import PrefcalError
from prefcal_env.experiments.experiment import check_returned
from prefcal_env.plants.plant import Plant
from prefcal_env.sources.source import Source, Varied, env_of
from prefcal_env.sources.varied import Factor, Values
from prefcal_env.workers import Terms, Worker
from prefcal_scenarios.runs import HasKPIs, Simulated
from prefcal_scenarios.scenario import KPI
from prefcal_scenarios.wording import (
    comparable,
    labeled,
    limits_text,
    number,
    quantity,
    read_text,
    value_text,
    with_unit,
)

# --- Margins: where they hold, their rows in a table, and whether they keep their limits.

UNKNOWN = "no margins: the plant is not known as equations, so it cannot be linearized"


def margins_at(known: Varied, theta: Float[np.ndarray, " n"]) -> Margins | str:
    """Return the margins of a physical θ, shape (n,), where the study starts, or why there are none.

    Those of a plant that is not linear say where that is, and hold the margins at the target, too.
    """
    if (loop := known.loop) is None:
        return UNKNOWN
    make = partial(loop.controller, theta)
    try:
        start = margins(loop.plant, loop.task, make)
    except Exception as error:  # people's own plants and controllers can raise anything
        return f"no margins: {error}"
    target = at_target(loop.plant, loop.task)
    there = margins_at_target(loop.plant, target, make)
    # The same to the last printed digit: the plant is linear, or did not move.
    if target is None or there is None or _by_kpi(there) == _by_kpi(start):
        return start
    there = replace(there, place=_place(loop.plant, target))
    return replace(start, place=_place(loop.plant, loop.task), target=there)


def _place(plant: Plant, task: Task) -> str:
    """Return where a task starts, in words."""
    y = plant.g(task.x0, task.u0, task.disturbance(0.0))
    channels = *plant.outputs, *plant.inputs
    return ", ".join(f"{c.name} {quantity(v, c.unit)}" for c, v in zip(channels, [*y, *task.u0], strict=True))


def _by_kpi(m: Margins) -> dict[str, float]:
    """Return margins by the names of the KPIs that they are, rounded as they are printed."""
    return {
        "M_s": _sensitivity(m),
        "gain_margin": min(_decibels(min(m.gain, 1 / max(m.gain_reduction, 1e-9))), 60.0),
        "phase_margin": _phase(m),
        "delay_margin": float(f"{m.delay:.3g}"),
        "disk_margin": _disk(m),
    }


def margins_said(found: Sequence[Margins | str], time_unit: str) -> tuple[tuple[tuple[str, ...], ...], str]:
    """Return `margins` and `basis` of `Verified`, given margins of the tuning and perhaps of the baseline."""
    first = found[0]
    if isinstance(first, str):
        return (), first
    stable = "; this loop is NOT STABLE" if first == UNSTABLE else ""
    there = ""
    if (moved := next((m for m in found if isinstance(m, Margins) and m.target), None)) is not None:
        assert moved.target is not None
        there = f": its start is {moved.place}, its target {moved.target.place}"
    lower = "".join(_say_lower_gain(first))
    return tuple(_margin_rows(found, time_unit)), f"margins of {UNCONSTRAINED}{stable}{there}{lower}"


def _say_lower_gain(m: Margins) -> Iterator[str]:
    """Yield between what the gain may change where it must not fall by more, a text for each place."""
    places = (("at the start, ", m), ("at the target, ", m.target)) if m.target else (("", m),)
    for place, each in places:
        if each and 0 < each.gain_reduction < 1:
            fall, rise = (number(float(f"{factor:.3g}")) for factor in (each.gain_reduction, each.gain))
            rises = f"to {rise} times" if np.isfinite(each.gain) else "without limit"
            yield f"; {place}the gain may fall to {fall} times its value or rise {rises}"


def list_margins(rows: Sequence[Sequence[str]]) -> tuple[str, ...]:
    """Return the rows of margins in words, with those before in brackets, if they are known."""
    return tuple(f"{name}: {after}{f' (before {old[0]})' if old else ''}" for name, after, *old in rows)


def _margin_rows(found: Sequence[Margins | str], time_unit: str) -> Iterator[tuple[str, ...]]:
    """Yield a row for each margin; a gain margin says both ways if the gain must not fall by more.

    They are rounded as the KPIs are that have limits: what is printed is what a limit is compared with.
    Of a plant that is another one at its target, each has two rows.
    """
    moved = any(isinstance(m, Margins) and m.target for m in found)
    for name, unit, read in (
        ("gain margin", "dB", _gain_margin),
        ("phase margin", "°", lambda m: number(_phase(m))),
        ("delay margin", time_unit, lambda m: number(m.delay)),
        ("maximum sensitivity M_s", "", lambda m: number(_sensitivity(m))),
        ("disk margin", "", lambda m: number(_disk(m))),
    ):
        for place in ("start", "target") if moved else ("",):
            there = (m.target or m if isinstance(m, Margins) and place == "target" else m for m in found)
            cells = (_margin(m, read) for m in there)
            yield labeled(f"{name} at the {place}" if place else name, unit), *cells


def _margin(m: Margins | str, read: Callable[[Margins], str]) -> str:
    """Return what is read of margins as text; an unstable loop has none."""
    if isinstance(m, str):
        return number(None)
    return "✗ unstable" if m == UNSTABLE else read(m)


def _gain_margin(m: Margins) -> str:
    up = number(_decibels(m.gain))
    return f"{up} up, {number(-_decibels(m.gain_reduction))} down" if 0 < m.gain_reduction < 1 else up


def _decibels(factor: float) -> float:
    return round(float(20 * np.log10(factor)), 2)


def _phase(m: Margins) -> float:
    return round(m.phase, 1)


def _sensitivity(m: Margins) -> float:
    return round(m.M_s, 2)


def _disk(m: Margins) -> float:
    return round(m.disk, 3)


USUAL = (("M_s ≤ 2", "M_s", -2.0), ("gain ≥ 6 dB", "gain_margin", 6.0), ("phase ≥ 30°", "phase_margin", 30.0))
"""Limits of margins that are usual, in words, with the KPI; a negative one is the largest value."""


def usual_margins(m: Margins) -> str:
    """Return which of the usual limits a loop misses, in words after its name."""
    values = _by_kpi(m)
    missed = [words for words, name, least in USUAL if values[name] * np.sign(least) < least]
    return f"does not have {' or '.join(missed)}" if missed else "has them all"


def has_poor_margins(found: Margins | str) -> str:
    """Return which of the usual limits a loop misses at start or target, in words after its name; or ""."""
    both = [m for m in (found, getattr(found, "target", None)) if isinstance(m, Margins)]
    return next((words for m in both if not (words := usual_margins(m)).startswith("has")), "")


_OFFSET = 0.1  # share of a lasting disturbance from which on a loop is told to leave it


def remaining(found: Margins | str) -> float:
    """Return the share of a lasting disturbance at the plant's inputs that stays, if it is much; else 0.

    A loop without integral action leaves |S(0)| of it. So one that hardly feeds back has large margins and
    yet an offset on every plant but the modeled one. What differs at start and target counts as the less.
    """
    both = [m for m in (found, getattr(found, "target", None)) if isinstance(m, Margins)]
    if not all(m.loop for m in both) or not both:
        return 0.0
    least = min(float(np.abs(1 / (1 + m.loop.L[0])).max()) for m in both if m.loop)
    return least if least >= _OFFSET else 0.0


def kept_margin(kpi: KPI, value: float) -> str:
    """Return whether a margin keeps its limit, and whether a tenth is left of that, in words."""
    aim = kpi.aim
    room = aim is None or (value >= aim if kpi.goal == "higher" else value <= aim)
    verdict = (
        "NOT kept" if not kpi.met(value) else "kept" if room else "kept, with less than a tenth to spare"
    )
    return f"{kpi.title} {quantity(value, kpi.unit)}, required {limits_text(kpi)}: {verdict}"


# --- KPIs with other draws of the sensor noise: a study has one, which may favor or harm a tuning.

DRAWS = 20
"""Other draws of the noise that are looked at."""
STEADY = 19
"""Draws with which a change has to keep its sign."""
_LOUD = 2.0  # times that noise makes a KPI as bad, from which on it is said where the study has none
_FAR = 0.5  # share of what the other draws span, beyond which the study's own draw stands apart
_PATIENCE = 20.0  # seconds that a report waits for margins, and for runs
Theta = Float[np.ndarray, " n"]
Nominal = tuple[tuple[Margins | str, ...], list[list[Simulated]] | str, str]
"""Margins of some θ, then runs with other draws of the noise of each, none without noise, or why there are
none, and the noise that runs of a study lack, in words."""


@dataclass(frozen=True, slots=True)
class Redrawn:
    """What KPIs are with other draws of the sensor noise than that of the study, in words; empty without."""

    # A row for each KPI: title with unit, then for the result and for the tuning before, if there is one,
    # the median with the lowest and the highest value; at last, with how many draws it is better
    rows: tuple[tuple[str, ...], ...] = ()
    # With how many draws KPIs change as in the study, by their titles: those for which these are too few
    unsteady: Mapping[str, str] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()  # what else is to be known, a text each
    lacking: str = ""  # noise that the runs of the study lack, in words; "" if they have one draw of it

    def __bool__(self) -> bool:
        return bool(self.rows)

    @property
    def texts(self) -> tuple[str, ...]:
        """Return what the rows are, these in words, a text each, then the remarks."""
        if not self:
            return ()
        pairs = any(len(row) > 3 for row in self.rows)
        which = f"{DRAWS} draws of {self.lacking}" if self.lacking else f"the next {DRAWS} seeds"
        first = f"with {which}{', before → after' if pairs else ''}: median (lowest to highest)"
        said = (
            f"{name}: {' → '.join(reversed(rest[:2]))}{f', better with {rest[2]}' if rest[2:] else ''}"
            for name, *rest in self.rows
        )
        return first, *said, *self.remarks


@dataclass(frozen=True, slots=True)
class Noise:
    """Noise of the sensors of a simulated loop, of which each seed has another draw."""

    # Values of factors with which runs have it; none if the runs of a study have it
    values: Values = field(default_factory=dict)
    lacking: str = ""  # what the runs of a study lack then, in words


def noise_of(source: Source) -> Noise | None:
    """Return the noise of a simulated loop; None without.

    The runs of a plant that was identified from a record are without the noise of that.
    """
    if source.asks:
        return None
    task, factors = getattr(env_of(source), "task", None), tuple[Factor, ...]()
    with suppress(PrefcalError):
        known = source.varied()
        factors = known.factors
        # A function may make its environment anew for each run.
        task = task or getattr(known.loop, "task", None)
    noise = getattr(task, "noise", None)
    if noise is not None and np.any(noise):
        return Noise()
    found = (f for f in factors if f.name == NOISE and f.told.startswith(IDENTIFIED))
    return next((Noise({NOISE: f.high}, f.told.removeprefix(IDENTIFIED)) for f in found), None)


def other_seeds(seed: int) -> range:
    """Return the seeds of other draws than that of a seed."""
    return range(seed + 1, seed + 1 + DRAWS)


def run_again(
    source: Source, thetas: Sequence[Theta], seed: int, clock: Callable[[], float] = time.perf_counter
) -> list[list[Simulated]] | str:
    """Return what remains of runs of each θ, physical, shape (n,), with other draws than that of a seed.

    Or why there are none: nobody waits for runs that take long, as `clock` tells in seconds.
    """
    made: list[list[Simulated]] = [[] for _ in thetas]
    begun = 0.0
    for count, other in enumerate(other_seeds(seed), start=1):
        for theta, runs in zip(thetas, made, strict=True):
            try:
                runs.append(Simulated.of(check_returned(source.run(theta.copy(), seed=other))))
            except Exception as error:  # people's own code can raise anything
                return f"a run failed: {error}"
        if count == 1:
            begun = clock()  # the first one may compile, and so says nothing of the others
        elif (clock() - begun) * DRAWS > _PATIENCE * (count - 1):
            return f"{len(thetas) * DRAWS} runs take more than {_PATIENCE:.0f} s: prefcal verify makes them"
    return made


def nominal_apart(source: Source, thetas: Sequence[Theta], seed: int) -> Nominal:
    """Return what `nominal_of` does, from a process of its own, as somebody's code may never end.

    Raises:
        RunError: If they take long, or the process dies.
    """
    work = pickle.dumps((_working, (source.elsewhere,)))
    worker = Worker(lambda: work, 2 * _PATIENCE, Terms("the computation of margins", again=False, quiet=True))
    try:
        found: Nominal = worker.run((list(thetas), seed))
        return found
    finally:
        worker.close()


def _working(source: Source) -> Callable[[tuple[Sequence[Theta], int]], Any]:
    """Return, in a worker, the function that returns margins and runs."""
    return lambda asked: nominal_of(source, *asked)


def nominal_of(source: Source, thetas: Sequence[Theta], seed: int) -> Nominal:
    """Return what is known of physical θ, each of shape (n,), on the nominal plant.

    Raises:
        ScenarioError: If nothing of the source can vary.
    """
    known, noise = source.varied(), noise_of(source)
    at = known.at(noise.values) if noise and noise.values else source
    margins = tuple(margins_at(known, theta) for theta in thetas)
    return margins, run_again(at, thetas, seed) if noise else [], noise.lacking if noise else ""


def compare_draws(
    kpis: Sequence[KPI],
    own: Sequence[HasKPIs],
    drawn: Sequence[Sequence[HasKPIs]],
    time_unit: str,
    lacking: str = "",
) -> Redrawn:
    """Return what KPIs are with other draws of the noise; margins do not depend on it.

    Args:
        kpis: KPIs to say something of.
        own: Runs of the result and of the tuning before, if there is another one, with the draw of the study.
        drawn: Runs with other draws, of each of these.
        time_unit: Unit of time.
        lacking: Noise that runs of the study lack, in words; "" if they have one draw of it.
    """
    known = [kpi for kpi in kpis if not kpi.margin and all(kpi.name in run.kpis for run in own)]
    each = [_Draws(kpi, own, drawn, time_unit, quiet=bool(lacking)) for kpi in known]
    remarks = [*_ended_early(drawn), *(words for one in each for words in one.remarks())]
    return Redrawn(
        tuple(one.row for one in each),
        {one.kpi.title: one.unsteady for one in each if one.unsteady},
        tuple(remarks),
        lacking,
    )


_NAMES = ("", " before")
"""What follows the name of a KPI of the result and of the tuning before."""


def _ended_early(drawn: Sequence[Sequence[HasKPIs]]) -> Iterator[str]:
    for name, runs in zip(_NAMES, drawn, strict=False):
        if count := sum(run.end.interrupted for run in runs):
            yield f"with {count} of {len(runs)} draws, the run{name} ends early"


class _Draws:
    """One KPI with the draw of a study and with others, of the result and of the tuning before."""

    def __init__(
        self,
        kpi: KPI,
        own: Sequence[HasKPIs],
        drawn: Sequence[Sequence[HasKPIs]],
        time_unit: str,
        *,
        quiet: bool,
    ) -> None:
        self.kpi, self._time_unit, self._quiet = kpi, time_unit, quiet
        self._own = [run.kpis[kpi.name] for run in own]
        self._values = [np.array([_value(kpi, run) for run in runs]) for runs in drawn]

    @property
    def row(self) -> tuple[str, ...]:
        """Return the row of `Redrawn`."""
        spans = [self._span(values) for values in self._values]
        count = self._changes()
        last = () if count is None else (f"{count[0]} of {len(self._values[0])}",)
        return labeled(self.kpi.title, self.kpi.unit), *spans, *last

    @property
    def unsteady(self) -> str:
        """Return with how many draws it changes as in the study if these are too few; else ""."""
        if (count := self._changes()) is None:
            return ""
        now, then = (float(self.kpi.badness(value)) for value in self._own)
        word, same = ("better", count[0]) if now < then else ("worse", count[1])
        return f"{word} with {same} of {len(self._values[0])}" if now != then and same < STEADY else ""

    def remarks(self) -> Iterator[str]:
        """Yield where limits are not kept with all draws, and where the study's own draw stands apart."""
        (first, *_), value, kpi = self._values, self._own[0], self.kpi
        kept = sum(bool(kpi.met(kpi.read(v))) for v in first)
        if kpi.met(0.0) is not None and (
            0 < kept < len(first) or (kept == 0) is bool(kpi.met(kpi.read(value)))
        ):
            yield f"{kpi.title} {limits_text(kpi)} is kept with {kept} of {len(first)} draws"
        for name, value, values in zip(_NAMES, self._own, self._values, strict=False):
            if np.isfinite(value) and (lost := int(np.isinf(values).sum())):
                yield f"{kpi.title}{name} is {self._text(np.inf)} with {lost} of {len(values)} draws"
            yield from self._apart(name, value, values[~np.isnan(values)])

    def _apart(self, name: str, value: float, known: Float[np.ndarray, " r"]) -> Iterator[str]:
        """Yield that no draw has nearly the value of the study, which has a draw of its own, or no noise."""
        if not len(known) or np.isinf(known).any():
            return
        kpi, least, most = self.kpi, float(known.min()), float(known.max())
        own, low, high = (self._text(v) for v in (value, least, most))
        others = with_unit(low if low == high else f"{low} to {high}", kpi.unit)
        if self._quiet and kpi.goal == "lower" and least > _LOUD * value > 0:
            yield f"{kpi.title}{name} is {with_unit(own, kpi.unit)} without that noise, {others} with it"
        elif (
            not self._quiet
            and max(least - value, value - most) > _FAR * (most - least)
            and own not in (low, high)
        ):
            yield (
                f"{kpi.title}{name} is {with_unit(own, kpi.unit)} with the draw of the study alone, {others} "
                "with the others"
            )

    def _changes(self) -> tuple[int, int] | None:
        """Return with how many draws it is better, and worse, than before; None without that, or a goal."""
        if len(self._values) < 2 or self.kpi.goal is None:
            return None
        bad = [np.where(np.isnan(v), np.inf, self.kpi.badness(v)) for v in self._values]
        return int((bad[0] < bad[1]).sum()), int((bad[0] > bad[1]).sum())

    def _span(self, values: Float[np.ndarray, " r"]) -> str:
        """Return the median of values, and the lowest and the highest in parentheses if they differ."""
        known = np.sort(values[~np.isnan(values)])
        if not len(known):
            return number(None)
        middle = (known[(len(known) - 1) // 2] + known[len(known) // 2]) / 2
        read = comparable(self.kpi, [float(v) for v in (middle, known[0], known[-1])])
        median, low, high = (read_text(self.kpi, value, self._time_unit) for value in read)
        return median if low == high else f"{median} ({low} to {high})"

    def _text(self, value: float) -> str:
        return value_text(self.kpi, float(value), self._time_unit)


def _value(kpi: KPI, run: HasKPIs) -> float:
    """Return a KPI of a run; NaN of one that ended early."""
    return np.nan if run.end.interrupted else float(run.kpis.get(kpi.name, np.nan))
