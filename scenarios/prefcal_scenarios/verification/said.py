"""What people and programs are told of a verification, and what is kept of it beside its best.json."""

import json
import shlex
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from prefcal_env.arrays import holds_more
from prefcal_env.controllers.margins import UNSTABLE, Margins
from prefcal_env.disk import digest_of, write_durably
from prefcal_env.envs.varied_loop import DELAY, LAG, STEPPED
from prefcal_env.errors import ScenarioError
from prefcal_env.plain import from_plain, to_plain
from prefcal_env.sources.varied import Factor, LeftOut, Ranges
from prefcal_scenarios.scenario import KPI, Scenario
from prefcal_scenarios.wording import (
    comparable,
    join_words,
    labeled,
    limits_text,
    number,
    quantity,
    read_text,
    typed_theta,
    value_text,
    with_unit,
)

from .nominal import Redrawn, has_poor_margins, margins_said
from .result import CHANCE, Effect, Others, Robustness, Verification, VerifiedRun, count_kept, problems_of

# --- What a verification leaves beside its best.json, as plain data for people and programs.

_SHOWN, _MOST = 4, 6
"""Number of factors that people are shown, those that hurt most; and the most of those that lose a limit."""
FILE, BEST = "verification.json", "best.json"
"""Names of the files of a verification and of its tuning, in one folder."""
VARIED, USUAL = ("what varied", "between", "range is"), "usual"
"""Headings of the rows of what varied: name, range with its unit, and whether it is the usual one."""
NOT_VARIED = ("what was not varied", "why")
"""Headings of the rows of what did not vary."""
REFUSED = "not acceptable"
"""Verdict of a person on a worst run that speaks against the tuning."""
REPEAT = "repeat the command of the study with --robust --n-max 5"
"""How to compare another tuning, up to the options that name it, if no command is known."""
NEVER_USED = ("first experiment", "result of ")
"""Begins of the names of a first experiment that nobody gave as what is in use."""
_NAMED = 8  # number of values of a run that are named


@dataclass(frozen=True, slots=True)
class WorstRun:
    """One of the worst random runs."""

    words: str  # which stated limits it loses, or that it holds
    # values that differ from the nominal ones, by name: those of the step first, which a
    # picture shows, then what breaks the tuning alone, then what moved most within its range
    values: dict[str, float]
    seed: int  # seed of the run
    verdict: str = ""  # "acceptable" or "not acceptable"; "" if nobody was asked
    units: dict[str, str] = field(default_factory=dict)  # units of the values by name, those that have one

    @classmethod
    def of(
        cls,
        run: VerifiedRun,
        words: str,
        factors: Sequence[Factor],
        *,
        breaking: Collection[str] = (),
        idle: Collection[str] = (),
    ) -> "WorstRun":
        """Return one of the worst runs, with what it misses in words, and the factors that varied.

        Those are named first that are `breaking` alone, and those last that are `idle` alone, by name.
        """

        def moved(f: Factor) -> tuple[bool, bool, bool, float]:
            share = abs(run.values[f.name] - f.nominal) / max(f.high - f.nominal, f.nominal - f.low)
            return f.name in STEPPED and share > 0, f.name in breaking, f.name not in idle, share

        values = {f.name: run.values[f.name] for f in sorted(factors, key=moved, reverse=True)}
        words = words if run.problems else f"most different from nominal, but {words}"
        if run.problems and run.limiting:
            words += f", {run.limiting} at its limit"
        return cls(words, values, run.seed, units={f.name: f.unit for f in factors if f.unit})

    @property
    def text(self) -> str:
        """Return the values that moved most, with four significant digits and units."""
        shown = list(self.values.items())[:_NAMED]
        words = [f"{n} {quantity(float(f'{v:.4g}'), self.units.get(n, ''))}" for n, v in shown]
        others = [*self.values][_NAMED:]
        more = f" and {len(others)} other{'s' * (len(others) > 1)} ({', '.join(others)})" if others else ""
        return ", ".join(words) + more


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
    runs: int  # number of random runs that count
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
    misses: tuple[str, ...] = ()  # each limit that is missed, with the worst value and the number of runs
    breaking: tuple[str, ...] = ()  # names of the factors that lose a limit alone, as in `effects`
    seed: int = 0  # seed of the variations
    ranges: Ranges = field(default_factory=dict)  # relative changes, as typed
    # Title, limits and whether the nominal run keeps them, of each KPI that only `limits` limit
    required: tuple[tuple[str, str, bool | None], ...] = ()
    apart: int = 0  # number of random runs that do not count, since no input can hold their plants
    earlier: tuple[str, ...] = ()  # what verifications of the same tuning said that asked otherwise, each
    holds: bool | None = None  # whether all keep the stated limits; None without limits or runs
    keeps_margins: bool | None = None  # whether the nominal loop keeps those on margins; None if unknown
    noise: Redrawn = field(default_factory=Redrawn)  # KPIs with other draws of the sensor noise
    outside: str = ""  # which nominal values are outside of 5 to 95 %, and why, in a sentence; "" if none

    @property
    def made(self) -> int:
        """Return the number of random runs, with those that do not count."""
        return self.runs + self.apart

    @classmethod
    def of(
        cls,
        found: Verification,
        scenario: Scenario,
        baseline: str,
        version: str,
        best: str,
        again: str = REPEAT,
    ) -> "Verified":
        """Return what a verification of a scenario's tuning says; see the class.

        `again` says how to compare another tuning, up to the options that name it.
        """
        margins = margins_said([each.margins for each in found.both], found.tuning.time_unit)
        return cls(
            headline=found.headline,
            statement=found.statement + _compare_before(found, baseline),
            limits_kept=found.limits,
            margins_kept=found.margin_verdict,
            advice=_next(found, scenario, baseline, again),
            share=found.share if found.runs else None,
            bound=found.bound,
            runs=len(found.runs),
            planned=found.planned,
            baseline=baseline if found.before else "",
            kpis=tuple(_kpi_row(kpi, found.both) for kpi in found.kpis),
            margins=margins[0],
            basis=margins[1],
            effects=tuple(_effect(each, found) for each in _order_effects(found)),
            worst=tuple(_worst(found)),
            varied=tuple((f.name, _range(f), _kind(f, found.idle)) for f in found.factors),
            left_out=(*found.left_out, *found.set_apart),
            scenario=found.scenario,
            version=version,
            best=best,
            misses=_first_of(found.misses),
            breaking=found.lost_by,
            seed=found.seed,
            apart=len(found.unheld),
            holds=found.holds,
            keeps_margins=found.keeps_margins,
            noise=found.with_other_noise,
            outside=_explain_outside(found),
        )

    @property
    def hurting(self) -> tuple[str, ...]:
        """Return what the factors do that hurt most, and which others lose a limit alone, a text each."""
        shown = max(_SHOWN, min(len(self.breaking), _MOST))
        more = self.breaking[shown:]
        others = f"{len(more)} more lose{'s' * (len(more) == 1)} a limit alone: {', '.join(more)}"
        none = self.misses and self.effects and not self.breaking
        first = ["no factor alone loses a limit that the nominal run keeps"] if none else []
        return (*first, *self.effects[:shown], *([others] if more else []))

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
    def noise_columns(self) -> tuple[str, ...]:
        """Return the headings of the rows of `noise`."""
        more = (self.baseline or "before", "better in")
        return (
            "KPI with other noise",
            "result",
            *(more if any(len(row) > 3 for row in self.noise.rows) else ()),
        )

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


def _worst(found: Verification) -> Iterator[WorstRun]:
    """Yield the worst random runs, the worst first."""
    for run in found.worst():
        words = found.words(run)
        yield WorstRun.of(run, words, found.factors, breaking=found.lost_by, idle=found.idle)


def _first_of(misses: Sequence[str]) -> tuple[str, ...]:
    """Return as many limits that are missed as people read, and how many more there are."""
    more = len(misses) - _MOST
    return (*misses[:_MOST], *([f"{more} more limits are missed"] if more > 0 else []))


def _compare_before(found: Verification, baseline: str) -> str:
    """Return on how many plants the baseline holds, how the result does there, and what it misses anyway."""
    if found.before is None:
        return f" Stopped before the {baseline} ran on these plants." if baseline and found.runs else ""
    new, old = found.runs, found.before.runs
    if not old:
        return ""
    held, now = (count_kept(runs[: len(old)]) for runs in (old, new))
    fewer = f"; after: {now} of these {len(old)}" if len(old) < len(new) else ""
    # What fails on the modeled plant already holds on few others: the count alone would read as fragile.
    own, before = found.before.nominal, replace(found, tuning=found.before)
    own = replace(own, problems=problems_of(found.kpis, own, found.tuning.nominal))
    lost = [found.words(own)] * bool(own.problems)
    lost += [before.words_of(kpi, own) for kpi in before.missed_margins]
    already = f"; it misses without any variation: {'; '.join(lost)}" if lost else ""
    return f" Before ({baseline}): {held} of {len(old)} of the same plants{fewer}{already}."


def _next(found: Verification, scenario: Scenario, baseline: str, again: str) -> tuple[str, ...]:
    """Return what to do next if some run fails, or the loop is not stable, a text each."""
    widen = tuple(_widened(found))
    other = _other(found, scenario, baseline, again)
    before = _before(found, scenario, baseline, again, alone=not other)
    if found.tuning.margins == UNSTABLE:
        free = any(kpi.name == "M_s" and kpi.met(0.0) is None for kpi in found.kpis)  # of others, none can be
        first = "state a limit on M_s, such as at most 2," if free else "begin elsewhere (--start)"
        stable = other or f"look for a stable loop: {first} and repeat the study"
        return (*filter(None, [before]), stable)
    margin = _keep_margins(found, again, other)
    if not found.failed:
        return (*filter(None, [margin]), *widen)
    alone = f"if nothing but {found.stated} counts, verify that alone, with --range task=0"
    chance = _leave_to_a_person(found) if other and len(found.failed) < CHANCE else ""
    every = (before, chance, other, margin, found.limiting, alone if found.holds_as_stated else "", *widen)
    if found.stopped:  # a limit is relaxed only where no tuning that was tried holds in more
        return (*filter(None, every), *_look_longer(found, found.stopped, scenario))
    if before or other:  # where a better tuning is known, no limit has to go
        return tuple(filter(None, every))
    left = "" if found.holds_as_stated else _nothing_else(found)
    return (*filter(None, (*every, left)), *found.advice)


def _keep_margins(found: Verification, again: str, other: str) -> str:
    """Return how to look for a tuning that keeps the limits on margins; "" if one does that is advised."""
    best = found.others.best if found.others and other else None
    kept = found.before_holds or (best is not None and replace(found, tuning=best).sound)
    if kept or not found.missed_margins:
        return ""
    limits = join_words([f"{kpi.title} {limits_text(kpi)}" for kpi in found.missed_margins])
    if other:  # its command searches on, too
        return f"neither this tuning nor that one keeps {limits}: the same search looks for one that does"
    return f"look for a tuning that keeps {limits}: search on from this one, {again}"


def _before(found: Verification, scenario: Scenario, baseline: str, again: str, *, alone: bool) -> str:
    """Return that the tuning before is to be kept: it holds in all runs, or in more, beyond chance; or "".

    If it is not `alone` in that, another one that holds in more is advised in its place.
    """
    if not baseline or found.before is None:
        return ""
    runs, used = found.before.runs, not baseline.startswith(NEVER_USED)
    # What was in use stands in the plant; of anything else, no file tells the values.
    which = baseline if used else typed_theta(scenario.space, found.before.theta.tolist())
    name = f"{_name_before(baseline)} ({which})"
    if found.before_holds:
        holds = f"it holds in all {len(runs)} of the same runs"
        poor = has_poor_margins(found.before.margins)
        return f"look at {name}: {holds}, but its nominal loop {poor}" if poor else f"take {name}: {holds}"
    if not alone or not _better(found, found.before):
        return ""
    old, new = (count_kept(each[: len(runs)]) for each in (runs, found.runs))
    more = f"{old - new} more of the same {len(runs)} runs ({old} instead of {new})"
    neither = "neither holds in all; to look for one that does, search on from this one"
    return f"{name} holds in {more}: {'keep' if used else 'take'} it, though {neither}, {again}"


def _name_before(baseline: str) -> str:
    """Return what the first experiment is called in advice: the tuning before, if it was one."""
    return f"the {baseline}" if baseline.startswith(NEVER_USED) else "the tuning before"


def _better(found: Verification, other: Robustness | None) -> bool:
    """Return whether another tuning holds on more of the same plants, beyond chance.

    A tuning that does not keep nominally what the result keeps is none to go to.
    """
    if other is None or other.margins == UNSTABLE:
        return False
    if found.sound and not replace(found, tuning=other).sound:
        return False
    pairs = [(not a.problems, not b.problems) for a, b in zip(other.runs, found.runs, strict=False)]
    return bool(pairs) and holds_more(*np.array(pairs).T)


def _widened(found: Verification) -> Iterator[str]:
    """Yield what helps where no input can hold a plant."""
    names = dict.fromkeys(run.unheld.input for run in found.unheld if run.unheld)
    for name in names:
        yield f"only a larger range of {name}, or less that varies (--range), helps the plants not counted"


def _other(found: Verification, scenario: Scenario, baseline: str, again: str) -> str:
    """Return with which tuning to begin the next study, since it holds on more of the plants; or ""."""
    best, before = found.others.best if found.others else None, found.before
    every = best is not None and best.holds(len(found.runs)) and replace(found, tuning=best).sound
    if best is None or not (every or _better(found, best)):
        return ""
    perhaps = "" if _better(found, best) else " (the difference can be chance)"
    held, count, old = count_kept(best.runs), len(best.runs), count_kept(before.runs) if before else -1
    if old >= held:
        return ""
    names = [name for name, theta in scenario.references.items() if np.array_equal(theta, best.theta)]
    which = f"the tuning {names[0]}" if names else "a tuning that was tried"
    chosen = "" if names else "; these runs chose it, so fewer may hold on other plants"
    known = f", {_name_before(baseline)} in {old}{perhaps}" if before else perhaps
    return (
        f"{which} holds in {held} of the same {count} runs, this one in {count_kept(found.runs)}{known}"
        f"{_nominal_changes(found, best)}{chosen}. To compare it, search on and keep what you like, "
        f"{again} {shlex.join(['--start', typed_theta(scenario.space, best.theta.tolist())])}"
    )


def _nominal_changes(found: Verification, other: Robustness) -> str:
    """Return which KPIs another tuning changes nominally, and how, after a semicolon; "" if none."""
    said, limited = list[str](), list[str]()
    for kpi in (kpi for kpi in found.kpis if kpi.goal or kpi.met(0.0) is not None):
        both = [each.nominal.kpis.get(kpi.name, np.nan) for each in (found.tuning, other)]
        if np.isnan(both).any():
            continue
        here, there = (read_text(kpi, v, found.tuning.time_unit) for v in comparable(kpi, both))
        words = f"{kpi.title} {here} → {with_unit(there, kpi.unit)}"
        if here != there and kpi.met(0.0) is not None:  # what has a limit is said, however many there are
            limited.append(f"{words} (required {limits_text(kpi)})")
        elif here != there and len(said) < _SHOWN:
            said.append(words)
    return f"; nominally {', '.join([*limited, *said])}" if said or limited else ""


def _ways(found: Verification) -> list[str]:
    """Return what else than the tuning can be changed."""
    offset = " (it has no integral action)" if found.remaining else ""
    ways = [] if found.limiting else [f"change the controller{offset}"]  # else the input is to blame
    return ways + ["relax a limit"] * bool(found.advice)


def _leave_to_a_person(found: Verification) -> str:
    """Return that a person has to decide, where so few runs fail that a better tuning can be chance."""
    return f"decide whether {len(found.failed)} of {len(found.runs)} may fail"


def _nothing_else(found: Verification) -> str:
    """Return what is left to change, since none of the tunings that were tried holds in more runs."""
    if (tried := found.others) is None:
        return ""
    due = f"{change}: " if (change := " or ".join(_ways(found))) else ""
    if len(found.failed) < CHANCE and tried.best is not None:  # no reason for another controller
        due = f"{_leave_to_a_person(found)}: "
    if tried.best is None:
        what = "is stable" if tried.able else "does even nominally what is asked"
        none = f"of {tried.count} other tunings that were tried, none {what}"
        return f"{due}{none}, which proves nothing of others"
    counts = f"the best in {count_kept(tried.best.runs)}, this one in {count_kept(found.runs)}"
    return (
        f"{due}none of {tried.count} other tunings that were tried holds in more of the same "
        f"{len(found.runs)} runs, beyond chance ({counts})"
    )


def _look_longer(found: Verification, tried: Others, scenario: Scenario) -> Iterator[str]:
    """Yield which factor fails alone, and what a stopped search shows, with the command that ends it."""
    lost = [each for each in found.effects if np.isinf(each.worsening)]
    if len(lost) == 1:
        yield f"{lost[0].factor.name} alone loses a limit: {found.words(lost[0].run)}"
    count = f"{tried.count} other tuning{'s' * (tried.count != 1)}"
    when = f"after {count}, of which {tried.able} can do as modeled what is asked"
    best = "" if tried.best is None else f"; the best so far {_so_far(found, tried.best, scenario)}"
    yield (
        "look longer: the search for a tuning that holds in more runs was stopped from outside (Ctrl-C, "
        "kill, or Stop on the page; it has no time limit of its own), "
        f"{when if tried.count else 'before any other tuning ran'}{best}. To search to the end, run: "
        f"{found.anew(found.seed, ())}"
    )


def _so_far(found: Verification, best: Robustness, scenario: Scenario) -> str:
    """Return on how many of the plants that it met another tuning holds: where this one fails, and where not.

    Half of the first plants are those that this one fails: one count of both would speak against this one.
    """
    name, lost = f"({typed_theta(scenario.space, best.theta.tolist())})", {run.seed for run in found.failed}
    if len(best.runs) == len(found.runs):
        return f"{name} holds in {count_kept(best.runs)} of the same {len(found.runs)} runs"
    fails, holds = ([run for run in best.runs if (run.seed in lost) is one] for one in (True, False))
    more = f" and in {count_kept(holds)} of {len(holds)} where this one holds" if holds else ""
    return f"{name} holds, so far, in {count_kept(fails)} of {len(fails)} runs where this one fails{more}"


def _name_delay_margin(found: Verification, factor: Factor) -> str:
    """Return the delay margin beside what delays the loop, in parentheses; "" of what does not."""
    own = found.tuning.margins
    delays = [m.delay for m in (own, getattr(own, "target", None)) if isinstance(m, Margins)]
    least = min(delays, default=np.inf)
    if factor.name not in (LAG, DELAY) or not np.isfinite(least):
        return ""
    more = quantity(float(f"{factor.high - factor.nominal:.3g}"), factor.unit)
    words = "it lags by up to" if factor.name == LAG else "it is longer by up to"
    return f" (delay margin {quantity(float(f'{least:.3g}'), found.tuning.time_unit)}, {words} {more})"


def _kpi_row(kpi: KPI, tunings: list[Robustness]) -> tuple[str, ...]:
    cells = [labeled(kpi.title, kpi.unit), limits_text(kpi)]
    for each in tunings:
        values = (each.nominal.kpis.get(kpi.name), *each.quantiles(kpi.name))
        cells += [value_text(kpi, value, each.time_unit) for value in values]
    return tuple(cells)


def _explain_outside(found: Verification) -> str:
    """Return which nominal values are outside of 5 to 95 %, and what alone explains it, in a sentence.

    That is a factor that has its nominal value at an end of its range, such as noise from 0 on, if no other
    one takes the value there: with several, no one of them is the reason.
    """
    pairs = list(zip(found.factors, found.alone[::2], found.alone[1::2], strict=False))
    said = dict[str, list[str]]()
    for kpi in found.kpis:
        value, ends = found.tuning.nominal.kpis.get(kpi.name, np.nan), found.tuning.quantiles(kpi.name)
        end = ends[0] if value < ends[0] else ends[1]
        shown = {value_text(kpi, each, found.tuning.time_unit) for each in (value, end)}
        if not np.isfinite([value, end]).all() or ends[0] <= value <= ends[1] or len(shown) == 1:
            continue
        reach = [
            f
            for f, *both in pairs
            if max((run.kpis.get(kpi.name, value) - value) / (end - value) for run in both) >= 1
        ]
        if reach and (why := _takes_there(reach)):
            said.setdefault(why, []).append(kpi.title)
    whole = "; ".join(f"{', '.join(titles)}, {why}" for why, titles in said.items())
    return f"Nominal values outside of 5 to 95 %: {whole}." if whole else ""


def _takes_there(factors: Sequence[Factor]) -> str:
    """Return why a value is outside, if these factors alone move it to the range; "" if that says nothing."""
    first, *more = factors
    if more:
        return f"which {join_words([f.name for f in factors])} each move that far alone"
    if first.ends or first.nominal not in (first.low, first.high):
        return ""
    has = f"{first.name} {quantity(first.nominal, first.unit)}" if first.nominal else f"no {first.name}"
    return f"since the nominal run has {has}"


def _range(factor: Factor) -> str:
    between = "or" if factor.ends else "to"
    return f"{number(factor.low)} {between} {quantity(factor.high, factor.unit)}"


def _kind(factor: Factor, idle: Collection[str]) -> str:
    """Return where the range of a factor comes from, and whether the factor alone matters at all."""
    said = "stated" if factor.stated else factor.told or USUAL
    return f"{said}, no effect alone" if factor.name in idle else said


def _order_effects(found: Verification) -> list[Effect]:
    """Return the effects as people read them: what more than doubles a KPI is among those shown first.

    Limits that somebody states say nothing of noise that moves a valve ten times as much.
    """
    effects, shown = [*found.effects], _SHOWN - 1
    doubled = [e for e in effects[shown + 1 :] if e.doubled and not np.isinf(e.worsening)]
    if doubled and len(found.lost_by) <= shown and not any(e.doubled for e in effects[: shown + 1]):
        effects.remove(doubled[0])
        effects.insert(shown, doubled[0])
    return effects


def _effect(each: Effect, found: Verification) -> str:
    """Return what a factor does alone: the limits that are lost, or the KPI that gets worst, in its unit."""
    f = each.factor
    ends = [quantity(run.values[f.name], f.unit) for run in each.unheld]
    name = f"{f.name} ({_range(f)}{f', but no input can hold the plant at {ends[0]}' if ends else ''})"
    if len(ends) > 1:
        return f"{f.name} ({_range(f)}): at either end, no input can hold the plant"
    if np.isinf(each.worsening):
        return f"{name}: {found.words(each.run)}{_name_delay_margin(found, f)}"
    kpi = next((kpi for kpi in found.kpis if kpi.title == each.kpi), None)
    if kpi is None:
        return f"{name}: no KPI gets worse"
    pair = (found.tuning.nominal.kpis[kpi.name], each.run.kpis[kpi.name])
    unit = found.tuning.time_unit
    before, after = value_text(kpi, pair[0], unit), read_text(kpi, comparable(kpi, pair)[1], unit)
    return f"{name}: {kpi.title} {before} → {with_unit(after, kpi.unit)}"
