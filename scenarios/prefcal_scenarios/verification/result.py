"""What came of a verification: frozen data, what follows from it, and what is kept of it."""

import json
import shlex
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.special import betaincinv

from prefcal_env.controllers.margins import UNCONSTRAINED, UNSTABLE, Margins, margins, margins_at_target
from prefcal_env.disk import digest_of, write_durably
from prefcal_env.envs.task import Task
from prefcal_env.envs.varied_loop import (
    DIRECTION,
    IDENTIFIED,
    LOAD,
    NOISE,
    REFERENCE,
    SHIFT,
    STEP,
    STEPPED,
    TURN,
    at_target,
)
from prefcal_env.errors import ScenarioError
from prefcal_env.experiments.experiment import End
from prefcal_env.plain import from_plain, to_plain
from prefcal_env.plants.plant import Plant
from prefcal_env.sources.source import Varied
from prefcal_env.sources.varied import Factor, LeftOut
from prefcal_scenarios.runs import HasKPIs
from prefcal_scenarios.scenario import KPI, Scenario
from prefcal_scenarios.wording import (
    comparable,
    labeled,
    limits_text,
    number,
    objective,
    quantity,
    range_ends,
    read_text,
    typed_theta,
    value_text,
    with_unit,
)

# --- What came of a verification, as frozen data, and what follows from it.

CONFIDENCE = 0.95
RANGE_0 = "its range is 0"
"""Why something does not vary that somebody left out."""
_TASK = {REFERENCE: "target", SHIFT: "start", DIRECTION: "target", LOAD: "load", TURN: "load"}
"""What is stated of a task, by the name of the factor that varies it."""


@dataclass(frozen=True, slots=True)
class VerifiedRun:
    """One run of a tuning with other values of the factors."""

    values: Mapping[str, float]  # values that differ from the nominal ones, by factor
    seed: int  # seed of the run
    end: End  # why it ended
    kpis: Mapping[str, float]  # KPIs by name, in their units
    problems: tuple[str, ...] = ()  # which stated limits it did not keep; empty if it kept all
    limiting: str = ""  # name of the input whose range limits it, as `limiting_input` returns it

    @property
    def words(self) -> str:
        """Return the problems as text, for people."""
        return "; ".join(self.problems) or "holds"


@dataclass(frozen=True, slots=True)
class Robustness:
    """How one tuning fares."""

    theta: Float[np.ndarray, " n"]  # tuning, physical, shape (n,)
    nominal: VerifiedRun  # run without variation
    margins: Margins | str  # margins on the nominal plant, or why there are none
    runs: tuple[VerifiedRun, ...] = ()  # random runs, independent of each other
    time_unit: str = ""  # unit of the delay margin

    def holds(self, count: int) -> bool:
        """Return whether it holds nominally and in `count` random runs, which are all."""
        return len(self.runs) == count and not any(run.problems for run in (self.nominal, *self.runs))

    def quantiles(self, kpi: str) -> tuple[float, float]:
        """Return the 5 and 95 % quantile of the KPI of this name; NaN without values."""
        values = [float(run.kpis[kpi]) for run in self.runs if kpi in run.kpis]
        low, high = np.quantile(values or [np.nan], (0.05, 0.95), method="nearest").tolist()
        return low, high


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


@dataclass(frozen=True, slots=True)
class Effect:
    """What one factor does alone."""

    factor: Factor
    run: VerifiedRun  # run at its lowest or at its highest value, the worse of both
    kpi: str  # title of the KPI that gets worst, "" if none gets worse
    # how much worse, as a share of the KPI's 5 to 95 % range over all runs; infinite if a
    # limit is lost
    worsening: float
    doubled: bool = False  # whether that KPI is more than doubled, and by more than half of that range


@dataclass(frozen=True, slots=True)
class Others:
    """How other tunings fare, drawn at random from the ranges of the knobs."""

    count: int  # number of tunings
    nominal: int  # number of those that do nominally what is asked
    # number of those that still do with the factor that alone makes the tuning fail, by its name
    alone: Mapping[str, int]
    known: tuple[str, ...] = ()  # names of the scenario's references that do nominally what is asked


@dataclass(frozen=True)
class Verification:
    """A tuning on plants that are not exactly as modeled.

    Args:
        scenario: Name of the scenario.
        kpis: KPIs with their objectives.
        factors: What varied, uniformly and independently.
        left_out: What did not, and why.
        planned: Number of random runs that were asked for.
        tuning: How the tuning fares.
        before: How the current tuning does on the same plants; None if it is not known.
        alone: Runs of the tuning with the lowest and the highest value of each factor, in pairs.
        others: How other tunings fare; None if they were not tried: all runs are good, some are missing, or
            a run is no simulation.
        as_stated: Random runs again with the task as stated: those that failed and, if all of these hold
            there, all. Empty if no run failed, or nothing of the task varied that nobody stated.
    """

    scenario: str
    kpis: tuple[KPI, ...]
    factors: tuple[Factor, ...]
    left_out: tuple[LeftOut, ...]
    planned: int
    tuning: Robustness
    before: Robustness | None
    alone: tuple[VerifiedRun, ...]
    others: Others | None = None
    as_stated: tuple[VerifiedRun, ...] = ()

    @property
    def runs(self) -> tuple[VerifiedRun, ...]:
        """Return the random runs of the tuning."""
        return self.tuning.runs

    @property
    def failed(self) -> tuple[VerifiedRun, ...]:
        """Return the random runs that did not keep the stated limits."""
        return tuple(run for run in self.runs if run.problems)

    @property
    def share(self) -> float:
        """Return the share of the random runs that kept them; NaN without any."""
        return 1 - len(self.failed) / len(self.runs) if self.runs else np.nan

    @property
    def bound(self) -> float:
        """Return what the probability of not keeping them is below, with 95 % confidence."""
        return most_probable(len(self.failed), len(self.runs))

    @property
    def asked(self) -> str:
        """Return what each run is asked to do, after "runs"."""
        if breakable(self.kpis):
            return "keep the stated limits"
        nominal = self.tuning.nominal.kpis
        finite = [k.title for k in self.kpis if k.goal and np.isfinite(nominal.get(k.name, np.inf))]
        if any("settl" in title.lower() or "steady" in title.lower() for title in finite):
            return "end safely and settle"
        return "end safely" + (" and reach what the nominal run reaches" if finite else "")

    @property
    def unstated(self) -> tuple[Factor, ...]:
        """Return what of the task varied in a range that nobody stated."""
        return tuple(f for f in self.factors if f.kind == "task" and not f.stated)

    @property
    def holds_as_stated(self) -> bool:
        """Return whether runs fail only at targets, loads or starts that nobody stated."""
        good = not any(run.problems for run in (self.tuning.nominal, *self.as_stated))
        complete = 0 < len(self.as_stated) == len(self.runs)
        return complete and good and self.tuning.margins != UNSTABLE and not self.misses_margin

    @property
    def stated(self) -> str:
        """Return what of the task is stated, though it varied, in words."""
        words = [*dict.fromkeys(_TASK.get(f.name, f.name) for f in self.unstated)]
        return f"the stated {' and '.join(filter(None, [', '.join(words[:-1]), *words[-1:]]))}"

    @property
    def _where(self) -> str:
        """Return how many runs hold with the task as stated, and what was left out of what varies."""
        count, said = len(self.as_stated), ""
        if count:
            of = f"the same {count}" if count == len(self.runs) else f"the {count} that fail"
            said = f"; at {self.stated}, {sum(not run.problems for run in self.as_stated)} of {of} do"
        kept = [name for name, why in self.left_out if why == RANGE_0 or name in (STEP, DIRECTION, TURN)]
        return f"{said}; not varied: {', '.join(kept)}" if kept else said

    @property
    def headline(self) -> str:
        """Return whether it holds: what is stated decides; if nothing is, usual limits are counted."""
        own, count, loop = self.tuning.nominal, len(self.runs), self.tuning.margins
        unsafe = sum(run.end is End.UNSAFE for run in self.runs)
        ended = f"; {unsafe} end unsafe" if unsafe else ""
        held = (
            f"{count - len(self.failed)} of {count} runs {self.asked}{ended}{self._where}." if count else ""
        )
        if self.failed:
            said = f"Does not hold{f' beyond {self.stated}' if self.holds_as_stated else ''}: {held}"
        elif own.problems or loop == UNSTABLE:  # nominally, which no count of varied runs says
            said = f"Does not hold: {own.words if own.problems else 'the nominal loop is not stable'}."
        elif not count:
            return self.statement
        else:
            holds = "Holds" if breakable(self.kpis) else "Not judged, since no limit on runs is stated"
            said = f"{holds}{', but a stated margin is missed' if self.misses_margin else ''}: {held}"
        if count and self.never:
            said += f" Not even the nominal run has a finite {' or '.join(self.never)}."
        said += self._quiet
        usual = "; ".join(self._offer(*each) for each in self.usual)
        return f"{said}{f' Usual limits: {usual}.' if usual and count else ''} {self.margin_verdict}".rstrip()

    @property
    def _quiet(self) -> str:
        """Return that the study of an identified plant has no noise though its record has; "" if not so."""
        told = [f.told for f in self.factors if f.name == NOISE and f.told.startswith(IDENTIFIED)]
        return f" The runs that were compared are without {told[0].removeprefix(IDENTIFIED)}." if told else ""

    @property
    def misses_margin(self) -> bool:
        """Return whether the nominal loop misses a limit on a margin, or is not stable at its target."""
        found, values = self.tuning.margins, self.tuning.nominal.kpis
        stated = (k for k in self.kpis if k.margin and k.name in values)
        unstable = isinstance(found, Margins) and found.target == UNSTABLE
        return unstable or any(k.met(k.read(values[k.name])) is False for k in stated)

    @property
    def statement(self) -> str:
        """Return how sure it is that the tuning holds, in a sentence."""
        count = len(self.runs)
        if not count:
            return f"Not verified: {'no run was completed' if self.planned else 'nothing can be varied'}."
        never = f" Not counted, since infinite nominally, too: {', '.join(self.never)}." if self.never else ""
        early = "" if count == self.planned else f" (stopped early, {self.planned} were planned)"
        if len(self.failed) == count:
            return f"0 of {count} runs {self.asked}{early}.{never}"
        if 2 * len(self.failed) > count:  # a bound near 100 % says nothing
            least = np.floor(100 * (1 - most_probable(count - len(self.failed), count)))
            return (
                f"{count - len(self.failed)} of {count} runs {self.asked}{early}: for plants within these "
                f"ranges, {100 * (1 - self.share):.3g} % do not, at least {least:.0f} % with "
                f"{100 * CONFIDENCE:g} % confidence.{never}"
            )
        # Rounded up to two digits, so that what is below it stays below.
        digits = 1 - int(np.floor(np.log10(100 * self.bound)))
        percent = np.ceil(100 * self.bound * 10.0**digits - 1e-9) / 10.0**digits
        return (
            f"{count - len(self.failed)} of {count} runs {self.asked}{early}: for plants within "
            f"these ranges, the probability that one does not is below {percent:.3g} % with "
            f"{100 * CONFIDENCE:g} % confidence.{never}"
        )

    @property
    def limits(self) -> str:
        """Return what a run is judged by, in a sentence."""
        aims = [kpi.title for kpi in breakable(self.kpis)]
        stated = f"Stated limits: a safe end, the objectives of {', '.join(aims)}, and nothing"
        if not aims:
            stated = "No limit that a run can break is stated. What counts: a safe end, and nothing"
        own = self.tuning.nominal
        nominal = f"The nominal run: {own.words}." if own.problems else "The nominal run holds."
        if self.tuning.margins == UNSTABLE and not own.problems:
            nominal = "The nominal loop is not stable, though its run ended safely."
        return f"{stated} infinite that is finite nominally. {nominal}"

    @property
    def usual(self) -> tuple[tuple[KPI, float, str], ...]:
        """Return KPIs with a limit that is usual, and why; none if a limit is stated."""
        return () if breakable(self.kpis) or not self.runs else tuple(self._usual())

    def _offer(self, kpi: KPI, limit: float, why: str) -> str:
        kept = sum(run.kpis.get(kpi.name, np.inf) <= limit for run in self.runs)
        most = quantity(limit, kpi.unit)
        return f"{kpi.title} at most {most}{why}: {kept} of {len(self.runs)} runs"

    def _usual(self) -> Iterator[tuple[KPI, float, str]]:
        for kpi in self.kpis:
            value = self.tuning.nominal.kpis.get(kpi.name, np.inf)
            if not np.isfinite(value) or kpi.goal != "lower" or kpi.margin:
                continue
            title = kpi.title.lower()  # people write their own as they like
            if title.startswith("overshoot") and kpi.unit == "%":
                yield kpi, 10.0, ""
            elif "settling time" in title:
                yield kpi, kpi.read(2 * value), " (twice the nominal one)"

    @property
    def margin_verdict(self) -> str:
        """Return whether the nominal loop keeps the limits on margins, or usual ones; "" without margins."""
        found = self.tuning.margins
        if found == UNSTABLE:
            return "The nominal loop is not stable: it has no margins."
        said = self._stated_margins()
        target = None if isinstance(found, str) else found.target
        if target == UNSTABLE:
            there = " At its target, it is NOT STABLE."
        else:  # what is stated is judged by a KPI, which is the worse of start and target
            there = f" At its target, it {_usual_margins(target)}." if target and not said else ""
        if said or isinstance(found, str):
            return f"Margins of the nominal loop: {said}.{there}" if said else ""
        usual, has = ", ".join(words for words, *_ in _USUAL), f"{_usual_margins(found)}."
        if there.endswith(f"it {has}"):
            has, there = f"{has[:-1]}, also at its target.", ""
        return f"No limit on a margin is stated. Usual are {usual}: the nominal loop {has}{there}"

    def _stated_margins(self) -> str:
        """Return whether the KPIs that are margins keep the limits that are stated; "" without any."""
        values = self.tuning.nominal.kpis
        stated = [kpi for kpi in self.kpis if kpi.margin and kpi.met(0.0) is not None and kpi.name in values]
        return "; ".join(_kept_margin(kpi, kpi.read(values[kpi.name])) for kpi in stated)

    @property
    def limiting(self) -> str:
        """Return in how many of the runs that fail the range of an input ends, if in most; else ""."""
        limited = [run.limiting for run in self.failed if run.limiting]
        if 2 * len(limited) <= len(self.failed) or self.tuning.margins == UNSTABLE:
            return ""
        which = " or ".join(dict.fromkeys(limited))
        return f"in {len(limited)} of the {len(self.failed)} runs that fail, {range_ends(which)}"

    @property
    def advice(self) -> tuple[str, ...]:
        """Return what to do if some run fails: which limits, if relaxed, let how many more runs hold."""
        missed = {problem for run in self.failed for problem in run.problems}
        able = [kpi for kpi in self.kpis if kpi.goal != "target" and _miss_words(kpi) in missed]
        alone = [self._relax([kpi]) for kpi in able]
        together = self._relax(able)
        more = len(able) > 1 and together[0] > max(held for held, _ in alone)
        return tuple(words for _, words in [*alone, *([together] if more else [])] if words)

    def _relax(self, kpis: Sequence[KPI]) -> tuple[int, str]:
        """Return how many runs hold with limits of some KPIs that just let them, and that in words."""
        misses = {_miss_words(kpi): kpi for kpi in kpis}
        # Who misses anything else would still not hold, and nobody relaxes a limit as far as an outlier asks.
        freed = [
            run
            for run in self.failed
            if all(p in misses and self._near(misses[p], run.kpis[misses[p].name]) for p in run.problems)
        ]
        changed = [kpi for words, kpi in misses.items() if any(words in run.problems for run in freed)]
        held, count = len(self.runs) - len(self.failed) + len(freed), len(self.runs)
        if len(changed) < len(kpis):
            return held, ""
        limits = [f"{_tightest(kpi, freed)} in place of {limits_text(kpi)}" for kpi in kpis]
        if len(kpis) == 1:
            what, new = f"limit of {kpis[0].title}", limits[0]
        else:
            what = "limits together"
            new = ", ".join(f"{kpi.title} {words}" for kpi, words in zip(kpis, limits, strict=True))
        # The limit is as these runs ask for: no proof that others keep it.
        return (
            held,
            f"relax the {what}: with {new}, {held} of these {count} runs hold, of others perhaps fewer",
        )

    def _near(self, kpi: KPI, value: float) -> bool:
        """Return whether a value that misses a limit is finite and no outlier, three times as far off."""
        limit = kpi.at_least if np.isfinite(kpi.at_least) else kpi.at_most
        missed = [r.kpis[kpi.name] for r in self.failed if _miss_words(kpi) in r.problems]
        usual = float(np.median(np.abs(np.array(missed) - limit)))
        return bool(np.isfinite(value) and abs(value - limit) <= 3 * usual)

    @property
    def never(self) -> tuple[str, ...]:
        """Return the titles of the KPIs that are infinite even on the nominal plant."""
        kpis = (kpi for kpi in self.kpis if kpi.goal is not None)
        return tuple(kpi.title for kpi in kpis if np.isinf(self.tuning.nominal.kpis.get(kpi.name, 0.0)))

    @property
    def idle(self) -> tuple[str, ...]:
        """Return the names of the factors that change no KPI at either end, such as one nobody measures."""
        pairs = zip(self.factors, self.alone[::2], self.alone[1::2], strict=False)
        nominal = self.tuning.nominal.kpis
        return tuple(f.name for f, *both in pairs if all(run.kpis == nominal for run in both))

    @cached_property
    def effects(self) -> tuple[Effect, ...]:
        """Return what each factor does alone, the one that hurts most first.

        First who loses a limit, then who doubles a KPI: what does so often, as noise does, makes wide
        the range of which `worsening` is a share.
        """
        pairs = zip(self.factors, self.alone[::2], self.alone[1::2], strict=False)
        both = [[self._effect(factor, run) for run in runs] for factor, *runs in pairs]

        def badness(effect: Effect) -> tuple[bool, bool, float, int]:
            lost = bool(np.isinf(effect.worsening))
            return lost, effect.doubled, effect.worsening, len(effect.run.problems)

        return tuple(sorted((max(pair, key=badness) for pair in both), key=badness, reverse=True))

    @property
    def breaking(self) -> tuple[Effect, ...]:
        """Return the effects by which a limit is lost, the first few."""
        return tuple(each for each in self.effects[:EFFECTS] if np.isinf(each.worsening))

    def worst(self, count: int = 3) -> tuple[VerifiedRun, ...]:
        """Return the worst random runs: by limits that they lose, then by their worst KPI."""

        def badness(run: VerifiedRun) -> tuple[bool, int, float]:
            shares = [share for share, *_ in self._worse(run)]
            return run.end.interrupted, len(run.problems), max(shares, default=0.0)

        return tuple(sorted(self.runs, key=badness, reverse=True)[:count])

    def _effect(self, factor: Factor, run: VerifiedRun) -> Effect:
        worse = ((doubled and share > 0.5, share, kpi) for share, doubled, kpi in self._worse(run))
        doubled, worsening, kpi = max(worse, default=(False, 0.0, ""))
        lost = set(run.problems) - set(self.tuning.nominal.problems)
        return Effect(factor, run, kpi, np.inf if lost else worsening, doubled)

    def _worse(self, run: VerifiedRun) -> Iterator[tuple[float, bool, str]]:
        """Yield by how much KPIs are worse than nominally: share of their range, if doubled, and title."""
        nominal = self.tuning.nominal
        for kpi in self.kpis:
            if kpi.goal is None or kpi.name not in run.kpis or kpi.name not in nominal.kpis:
                continue
            here, there = (float(kpi.badness(each.kpis[kpi.name])) for each in (run, nominal))
            if here > there:
                low, high = self.tuning.quantiles(kpi.name)
                span = max(abs(high - low), 1e-9 * abs(there), 1e-300)
                doubled = here > 2 * there if there >= 0 else there < min(2 * here, 0)  # or halved
                yield (here - there) / span if np.isfinite(span) else 0.0, doubled, kpi.title


def breakable(kpis: Iterable[KPI]) -> list[KPI]:
    """Return the KPIs with a limit that a run can break: a margin is what is left for runs that differ."""
    return [kpi for kpi in kpis if kpi.met(0.0) is not None and not kpi.margin]


def problems_of(kpis: Sequence[KPI], result: HasKPIs, nominal: HasKPIs | None) -> tuple[str, ...]:
    """Return which stated limits a run does not keep, in words.

    A run must not be interrupted, must meet each objective of a KPI that a run can break, and must
    reach what the nominal run reaches: a KPI must not be infinite where it is finite nominally.
    Margins are no such KPIs: what they leave room for is that plants differ.
    """
    if result.end.interrupted:
        return (f"the run ended early: {result.end.value}",)
    found = []
    for kpi in (kpi for kpi in kpis if not kpi.margin):
        value = result.kpis.get(kpi.name)
        reached = nominal is not None and np.isfinite(nominal.kpis.get(kpi.name, np.inf))
        if value is not None and kpi.met(float(value)) is False:
            found.append(_miss_words(kpi))
        elif value is not None and reached and kpi.goal is not None and np.isinf(value):
            found.append(f"{kpi.title} is infinite")
    return tuple(found)


def _tightest(kpi: KPI, runs: Sequence[VerifiedRun]) -> str:
    """Return the tightest limit of a KPI that lets some runs hold, in words."""
    values = [run.kpis[kpi.name] for run in runs if kpi.name in run.kpis]
    limit = kpi.read(min(values) if np.isfinite(kpi.at_least) else max(values))
    return f"{objective(kpi)[:1]} {quantity(limit, kpi.unit)}"


def _miss_words(kpi: KPI) -> str:
    return f"{kpi.title} misses its objective"


_USUAL = (
    ("M_s ≤ 2", "M_s", -2.0),
    ("gain ≥ 6 dB", "gain_margin", 6.0),
    ("phase ≥ 30°", "phase_margin", 30.0),
)
"""Limits of margins that are usual, in words, with the KPI; a negative one is the largest value."""


def _usual_margins(m: Margins) -> str:
    """Return which of the usual limits a loop misses, in words after its name."""
    values = _by_kpi(m)
    missed = [words for words, name, least in _USUAL if values[name] * np.sign(least) < least]
    return f"does not have {' or '.join(missed)}" if missed else "has them all"


def _kept_margin(kpi: KPI, value: float) -> str:
    """Return whether a margin keeps its limit, and whether a tenth is left of that, in words."""
    aim = kpi.aim
    room = aim is None or (value >= aim if kpi.goal == "higher" else value <= aim)
    verdict = (
        "NOT kept" if not kpi.met(value) else "kept" if room else "kept, with less than a tenth to spare"
    )
    return f"{kpi.title} {quantity(value, kpi.unit)}, required {limits_text(kpi)}: {verdict}"


def most_probable(failed: int, count: int) -> float:
    """Return the upper limit, with 95 % confidence, of a probability seen `failed` of `count` times.

    Source: Clopper, Pearson (1934), The use of confidence or fiducial limits illustrated in the
    case of the binomial, Biometrika 26; one-sided.
    """
    if failed >= count:
        return 1.0
    return float(betaincinv(failed + 1, count - failed, CONFIDENCE))


# --- What a verification leaves beside its best.json, as plain data for people and programs.

EFFECTS = 4
"""Number of factors that people are shown, those that hurt most."""
FILE, BEST = "verification.json", "best.json"
"""Names of the files of a verification and of its tuning, in one folder."""
VARIED, USUAL = ("what varied", "between", "range is"), "usual"
"""Headings of the rows of what varied: name, range with its unit, and whether it is the usual one."""
NOT_VARIED = ("what was not varied", "why")
"""Headings of the rows of what did not vary."""
REFUSED = "not acceptable"
"""Verdict of a person on a worst run that speaks against the tuning."""
_NAMED = 8  # number of values of a run that are named


@dataclass(frozen=True, slots=True)
class WorstRun:
    """One of the worst random runs."""

    words: str  # which stated limits it loses, or that it holds
    # values that differ from the nominal ones, by name: those of the step first, which a
    # picture shows, then the one that moved most within its range
    values: dict[str, float]
    seed: int  # seed of the run
    verdict: str = ""  # "acceptable" or "not acceptable"; "" if nobody was asked
    units: dict[str, str] = field(default_factory=dict)  # units of the values by name, those that have one

    @classmethod
    def of(cls, run: VerifiedRun, factors: Sequence[Factor]) -> "WorstRun":
        """Return one of the worst runs, with the factors that varied."""

        def moved(f: Factor) -> tuple[bool, float]:
            share = abs(run.values[f.name] - f.nominal) / max(f.high - f.nominal, f.nominal - f.low)
            return f.name in STEPPED and share > 0, share

        values = {f.name: run.values[f.name] for f in sorted(factors, key=moved, reverse=True)}
        words = run.words if run.problems else f"most different from nominal, but {run.words}"
        if run.problems and run.limiting:
            words += f", {run.limiting} at its limit"
        return cls(words, values, run.seed, units={f.name: f.unit for f in factors if f.unit})

    @property
    def text(self) -> str:
        """Return the values that moved most, with four significant digits and units."""
        shown = list(self.values.items())[:_NAMED]
        words = [f"{n} {quantity(float(f'{v:.4g}'), self.units.get(n, ''))}" for n, v in shown]
        others = len(self.values) - len(shown)
        return ", ".join(words) + (f" and {others} other{'s' if others > 1 else ''}" if others else "")


@dataclass(frozen=True, slots=True)
class Verified:
    """What a verification says. Texts are as people read them; "–" is unknown."""

    headline: str  # whether it holds, how many runs do, usual limits if none is stated, margins
    statement: str  # how sure it is that the limits are kept, in a sentence
    limits_kept: str  # what a run is judged by, in a sentence
    margins_kept: str  # whether the nominal loop keeps limits on margins, in a sentence; "" if unknown
    advice: tuple[str, ...]  # what to do next if some run fails, a text each
    share: float | None  # share of the runs that kept them; None without any
    bound: float  # what the probability of not keeping them is below, with 95 % confidence
    runs: int  # number of random runs
    planned: int  # number that was asked for
    baseline: str  # what the tuning is compared with, such as "current tuning"; "" if that is unknown
    # A row for each KPI: title with unit, objective, nominal value, 5 % and 95 %
    # quantile, then the same three of the baseline, if it is known
    kpis: tuple[tuple[str, ...], ...]
    # A row for each margin: name with unit, value, then that of the baseline, likewise.
    # empty if there are none
    margins: tuple[tuple[str, ...], ...]
    basis: str  # what the margins hold for, or why there are none, in a sentence
    effects: tuple[str, ...]  # what each factor does alone, the one that hurts most first, a text each
    worst: tuple[WorstRun, ...]  # the worst random runs, the worst first
    varied: tuple[tuple[str, str, str], ...]  # a row for each thing that varied, as in `VARIED`
    left_out: tuple[LeftOut, ...]  # a row for each thing that did not, as in `NOT_VARIED`
    scenario: str  # name of the scenario
    version: str  # version of prefcal
    best: str  # SHA-256 of the best.json, in hexadecimal digits
    lines: tuple[str, ...] = ()  # the command that judges by the usual limits, if none is stated
    limits: tuple[str, ...] = ()  # limits that were stated for it, beside those of the study, as typed
    at: str = field(default="", compare=False)  # date, in ISO 8601; "" if nobody said

    @classmethod
    def of(
        cls,
        found: Verification,
        scenario: Scenario,
        baseline: str,
        version: str,
        best: str,
        *,
        robust: bool = False,
    ) -> "Verified":
        """Return what a verification of a scenario's tuning says, and of a `robust` study; see the class."""
        both = [found.tuning, *([found.before] if found.before else [])]
        margins, basis = margins_said([each.margins for each in both], found.tuning.time_unit)
        left = bool(baseline and found.runs) and found.before is None
        if found.before and found.before.runs:
            compared = _compare_counts(found.runs, found.before.runs, baseline)
        else:
            compared = ""
        alone = f" Stopped before the {baseline} ran on these plants." if left else ""
        return cls(
            headline=found.headline,
            statement=found.statement + compared + alone,
            limits_kept=found.limits,
            margins_kept=found.margin_verdict,
            advice=_next(found, scenario, baseline, robust),
            share=found.share if found.runs else None,
            bound=found.bound,
            runs=len(found.runs),
            planned=found.planned,
            baseline=baseline if found.before else "",
            kpis=tuple(_kpi_row(kpi, both) for kpi in found.kpis),
            margins=margins,
            basis=basis,
            effects=tuple(_effect(each, found) for each in found.effects),
            worst=tuple(WorstRun.of(run, found.factors) for run in found.worst()),
            varied=tuple((f.name, _range(f), _kind(f, found.idle)) for f in found.factors),
            left_out=found.left_out,
            scenario=found.scenario,
            version=version,
            best=best,
        )

    @property
    def verdict(self) -> str:
        """Return the headline, with a person's verdicts against worst runs, and the date."""
        refused = sum(each.verdict == REFUSED for each in self.worst)
        judged = (
            f" A person found {refused} of the {len(self.worst)} worst runs {REFUSED}." if refused else ""
        )
        when = f" {'Verified' if self.runs else 'Looked at'} {self.at}." if self.at else ""
        return f"{self.headline}{judged}{when}"

    @property
    def kpi_columns(self) -> tuple[str, ...]:
        """Return the headings of the rows of `kpis`."""
        before = (f"{self.baseline}, nominal", "5 %", "95 %") if self.baseline else ()
        return "KPI", "objective", "nominal", "5 %", "95 %", *before

    @property
    def margin_columns(self) -> tuple[str, ...]:
        """Return the headings of the rows of `margins`."""
        return "margin", "result", *((self.baseline,) if self.baseline else ())

    @classmethod
    def read(cls, folder: str | Path) -> "Verified | None":
        """Return what was verified of the best.json in a folder; None if nothing, or of another one.

        Raises:
            ScenarioError: If the file is there, but cannot be read.
        """
        path, tuning = Path(folder) / FILE, Path(folder) / BEST
        if not (path.is_file() and tuning.is_file()):
            return None
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError) as error:
            raise ScenarioError(f"cannot read {str(path)!r}: {error}") from error
        found = from_plain(content, cls, ScenarioError, repr(str(path)))
        return found if found.best == digest_of(tuning) else None

    def write(self, folder: str | Path, file: str = FILE) -> None:
        """Write the file, durably. Raises ScenarioError, which says the result, if that is not possible."""
        text = json.dumps(to_plain(self), indent=2, ensure_ascii=False, allow_nan=False)
        path = Path(folder) / file
        try:
            write_durably(path, f"{text}\n".encode())
        except OSError as error:
            raise ScenarioError(f"cannot write {str(path)!r}: {error}. Not kept: {self.statement}") from error


def _compare_counts(new: Sequence[VerifiedRun], old: Sequence[VerifiedRun], baseline: str) -> str:
    """Return on how many plants the baseline holds; if those are fewer, also how the result does there."""
    held, now = (sum(not run.problems for run in runs[: len(old)]) for runs in (old, new))
    fewer = f"; after: {now} of these {len(old)}" if len(old) < len(new) else ""
    return f" Before ({baseline}): {held} of {len(old)} of the same plants{fewer}."


_ENOUGH = 10  # tunings that hold nominally, of which none that holds on other plants says something of all


def _next(found: Verification, scenario: Scenario, baseline: str, robust: bool) -> tuple[str, ...]:
    """Return what to do next if some run fails, or the loop is not stable, a text each."""
    count = len(found.runs)
    other = replace(found, tuning=found.before) if found.before and found.before.holds(count) else None
    sound = baseline and other and not other.misses_margin and other.tuning.margins != UNSTABLE
    before = f"take the tuning before ({baseline}): it holds in all {count} of the same runs" if sound else ""
    if found.tuning.margins == UNSTABLE:
        limited = any(kpi.name == "M_s" and kpi.met(0.0) is not None for kpi in found.kpis)
        first = "begin elsewhere (--start)" if limited else "state a limit on M_s, such as at most 2,"
        return (*filter(None, [before]), f"look for a stable loop: {first} and repeat the study")
    if not found.failed:
        return ()
    alone = f"if nothing but {found.stated} counts, verify that alone, with --range task=0"
    every = (
        before,
        found.limiting,
        alone if found.holds_as_stated else "",
        _another(found, scenario, robust) if scenario.simulated else "",
    )
    return (*filter(None, every), *found.advice)


def _another(found: Verification, scenario: Scenario, robust: bool) -> str:
    """Return which other tuning to look for, or what else to change; "" if neither helps."""
    tried = found.others
    ways = [] if found.limiting else ["change the controller"]  # what helps there is said of the input
    change = " or ".join([*ways, "relax the limit"] if breakable(found.kpis) else ways)
    due = f"{change}: " if change else ""
    drawn = "" if tried is None else f"{tried.nominal or 'none'} of {tried.count} tunings drawn at random"
    known = tried is not None and tried.nominal >= _ENOUGH  # of fewer, chance would say it
    lost = [each.factor for each in found.effects if np.isinf(each.worsening)]
    stuck = [e for e in found.breaking if known and tried and not tried.alone.get(e.factor.name)]
    if tried and tried.known and found.tuning.nominal.problems:
        start = typed_theta(scenario.space, scenario.references[tried.known[0]].tolist())
        first = (
            f"begin with {tried.known[0]}, which holds nominally, as this tuning does not: repeat the "
            f"command of the study with {shlex.join(['--start', start])}"
        )
    elif tried and not tried.nominal and found.tuning.nominal.problems:
        few = np.ceil(100 * most_probable(0, tried.count))
        first = (
            f"{due}this tuning does not hold even nominally, and {drawn} does (fewer than {few:.0f} % "
            f"of the ranges do, with {100 * CONFIDENCE:g} % confidence)"
        )
    elif stuck:
        names = " and ".join(f"{e.factor.name} ({_range(e.factor)})" for e in stuck)
        alone = "each alone make" if len(stuck) > 1 else "alone makes"
        first = f"{due}{names} {alone} this tuning fail, and each of the {drawn} that hold nominally"
    elif found.holds_as_stated and not robust:  # on other plants, too: robust studies vary nothing else
        first = ""
    elif robust:
        tighter = "start one with tighter limits, or " if breakable(found.kpis) else ""
        only = f"the study was robust, which varies the plant and the noise only: {tighter}{change}"
        first = only if change else ""
    elif lost and not any(factor.robust for factor in lost):
        names = " and ".join(factor.name for factor in lost[:EFFECTS])
        first = f"{due}{names} alone can break it, which no robust study varies"
    else:
        first = _elsewhere(found, scenario, f" ({drawn} hold nominally)" if drawn else "")
    return first


def _elsewhere(found: Verification, scenario: Scenario, hold: str) -> str:
    """Return how to look for a tuning that holds on other plants."""
    start = shlex.join(["--robust", "--start", typed_theta(scenario.space, found.tuning.theta.tolist())])
    return (
        f"look for one that holds on other plants{hold}: repeat the command of the study with {start}; "
        "with --taste and the name of a saved study, your answers count there"
    )


def _kpi_row(kpi: KPI, tunings: list[Robustness]) -> tuple[str, ...]:
    cells = [labeled(kpi.title, kpi.unit), limits_text(kpi)]
    for each in tunings:
        values = (each.nominal.kpis.get(kpi.name), *each.quantiles(kpi.name))
        cells += [value_text(kpi, value, each.time_unit) for value in values]
    return tuple(cells)


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
    return tuple(_margin_rows(found, time_unit)), f"margins of {UNCONSTRAINED}{stable}{there}"


def _margin_rows(found: Sequence[Margins | str], time_unit: str) -> Iterator[tuple[str, ...]]:
    """Yield a row for each margin; a gain margin has a second number if the gain must not fall by more.

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
    down = f", {number(_decibels(m.gain_reduction))}" if 0 < m.gain_reduction < 1 else ""
    return number(_decibels(m.gain)) + down


def _decibels(factor: float) -> float:
    return round(float(20 * np.log10(factor)), 2)


def _phase(m: Margins) -> float:
    return round(m.phase, 1)


def _sensitivity(m: Margins) -> float:
    return round(m.M_s, 2)


def _disk(m: Margins) -> float:
    return round(m.disk, 3)


def _range(factor: Factor) -> str:
    between = "or" if factor.ends else "to"
    return f"{number(factor.low)} {between} {quantity(factor.high, factor.unit)}"


def _kind(factor: Factor, idle: Collection[str]) -> str:
    """Return where the range of a factor comes from, and whether the factor alone matters at all."""
    said = "stated" if factor.stated else factor.told or USUAL
    return f"{said}, no effect alone" if factor.name in idle else said


def _effect(each: Effect, found: Verification) -> str:
    """Return what a factor does alone: the limits that are lost, or the KPI that gets worst, in its unit."""
    name = f"{each.factor.name} ({_range(each.factor)})"
    if np.isinf(each.worsening):
        return f"{name}: {'; '.join(each.run.problems)}"
    kpi = next((kpi for kpi in found.kpis if kpi.title == each.kpi), None)
    if kpi is None:
        return f"{name}: no KPI gets worse"
    pair = (found.tuning.nominal.kpis[kpi.name], each.run.kpis[kpi.name])
    before, after = (read_text(kpi, value, found.tuning.time_unit) for value in comparable(kpi, pair))
    return f"{name}: {kpi.title} {before} → {with_unit(after, kpi.unit)}"
