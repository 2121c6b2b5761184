"""Margins of the nominal loop: where they hold, their rows in a table, and whether they keep their limits."""

import pickle
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from jaxtyping import Float

from prefcal_env.controllers.margins import UNCONSTRAINED, UNSTABLE, Margins, margins, margins_at_target
from prefcal_env.envs.task import Task
from prefcal_env.envs.varied_loop import at_target
from prefcal_env.plants.plant import Plant
from prefcal_env.sources.source import Source, Varied
from prefcal_env.workers import Terms, Worker
from prefcal_scenarios.scenario import KPI
from prefcal_scenarios.wording import labeled, limits_text, number, quantity

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


_PATIENCE = 20.0  # seconds that a report waits for the margins of somebody's own code


def margins_apart(source: Source, thetas: Sequence[Float[np.ndarray, " n"]]) -> tuple[Margins | str, ...]:
    """Return the margins of physical θ, each of shape (n,), from a process of its own, as code may never end.

    Raises:
        RunError: If they take long, or the process dies.
    """
    work = pickle.dumps((_working, (source.elsewhere,)))
    worker = Worker(lambda: work, _PATIENCE, Terms("the computation of margins", again=False, quiet=True))
    try:
        found: tuple[Margins | str, ...] = worker.run(list(thetas))
        return found
    finally:
        worker.close()


def _working(source: Source) -> Callable[[Sequence[Float[np.ndarray, " n"]]], tuple[Margins | str, ...]]:
    """Return, in a worker, the function of θ that returns their margins."""
    known = source.varied()
    return lambda thetas: tuple(margins_at(known, theta) for theta in thetas)


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
