"""What came of a verification: frozen data, and what follows from it."""

import shlex
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np
from jaxtyping import Float
from scipy.special import betaincinv

from prefcal_env.controllers.margins import UNSTABLE, Margins
from prefcal_env.envs.varied_loop import (
    AHEAD,
    BACK,
    BIGGER,
    DIRECTION,
    IDENTIFIED,
    LARGER,
    LOAD,
    NOISE,
    REFERENCE,
    SHIFT,
    STEP,
    TURN,
)
from prefcal_env.experiments.experiment import Channel, End
from prefcal_env.sources.varied import PLACES, Factor, LeftOut, Unheld
from prefcal_scenarios.runs import HasKPIs
from prefcal_scenarios.scenario import KPI
from prefcal_scenarios.wording import (
    comparable,
    join_words,
    limits_text,
    number,
    objective,
    quantity,
    range_ends,
    read_text,
    sentence,
    typed_number,
    with_unit,
)

from .nominal import DRAWS, USUAL, Noise, Redrawn, compare_draws, kept_margin, remaining, usual_margins

# --- What came of a verification, as frozen data, and what follows from it.

CONFIDENCE = 0.95
_FEW = 2  # number of limits that are named beside the count of runs, where few fail
_LOUD = 5.0  # times that a sensor makes a KPI as bad, from which on it is said beside the verdict
_MUCH = 0.1  # share of the room to a limit from which on a factor is told to use it
CHANCE = 5  # runs that a relaxed limit must gain: fewer can as well be chance, 1/2 to the power of 5 is 3 %
RANGE_0 = "its range is 0"
"""Why something does not vary that somebody left out."""
_OF_TASK = (STEP, LARGER, AHEAD, BACK, DIRECTION, BIGGER, TURN)
"""What of step and load may not vary."""
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
    unheld: Unheld | None = None  # where no input can hold its plant, whatever the tuning


@dataclass(frozen=True, slots=True)
class Robustness:
    """How one tuning fares."""

    theta: Float[np.ndarray, " n"]  # tuning, physical, shape (n,)
    nominal: VerifiedRun  # run without variation
    margins: Margins | str  # margins on the nominal plant, or why there are none
    runs: tuple[VerifiedRun, ...] = ()  # random runs, independent of each other
    draws: tuple[VerifiedRun, ...] = ()  # runs without variation, with other draws of the noise
    time_unit: str = ""  # unit of the delay margin

    def holds(self, count: int) -> bool:
        """Return whether it holds nominally and in `count` random runs, which are all."""
        return len(self.runs) == count and not any(run.problems for run in (self.nominal, *self.runs))

    def quantiles(self, kpi: str) -> tuple[float, float]:
        """Return the 5 and 95 % quantile of the KPI of this name; NaN without values."""
        values = [float(run.kpis[kpi]) for run in self.runs if kpi in run.kpis]
        low, high = np.quantile(values or [np.nan], (0.05, 0.95), method="nearest").tolist()
        return low, high


@dataclass(frozen=True, slots=True)
class Effect:
    """What one factor does alone."""

    factor: Factor
    run: VerifiedRun  # run at its lowest or at its highest value, the worse of both
    kpi: str  # title of the KPI that gets worst, "" if none gets worse
    # how much worse, as a share of the KPI's 5 to 95 % range over all runs; infinite if a
    # limit is lost
    worsening: float
    used: float = 0.0  # how much of the room to a limit of a run it uses, as a share, where that is much
    doubled: bool = False  # whether that KPI is more than doubled, and by more than half of that range
    unheld: tuple[VerifiedRun, ...] = ()  # runs at its ends that do not count, see `Verification.unheld`


@dataclass(frozen=True, slots=True)
class Others:
    """How other tunings fare: some drawn at random, some near the tuning, and the scenario's references."""

    count: int  # number of tunings
    able: int  # number of those that do nominally what is asked
    best: Robustness | None  # how the best of them fares on the same plants; None without any


def command_of(seed: int, limits: Sequence[str], best: str = "best.json", more: Sequence[str] = ()) -> str:
    """Return the command that verifies a best.json with a seed, limits as typed, and more options."""
    asked = [word for limit in limits for word in ("--limit", limit)]
    return shlex.join(["prefcal", "verify", best, *more, *(["--seed", str(seed)] if seed else []), *asked])


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
        others: How other tunings fare; None if they were not tried: all runs are good, some are missing,
            the tuning before holds in all, or a run is no simulation.
        stopped: How other tunings fared until Ctrl-C ended the search for them, the best one on those of the
            plants that it met; None if it was not ended.
        as_stated: Random runs again with the task as stated: the first that failed and, if all of these
            hold there, all. Empty if no run failed, or nothing of the task varied that nobody stated, or the
            tuning does not even hold nominally.
        unheld: Random runs that do not count, since no input can hold their plant at start or target.
        inputs: Inputs of the nominal plant; empty if they are not known.
        seed: Seed of the variations.
        narrower: Names of the factors whose stated range is narrower than the usual one.
        noise: Noise of the runs `draws`; None if there is none.
        anew: Function of another seed and of limits, each as typed, that returns the command that verifies by
            them in place of its own.
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
    stopped: Others | None = None
    as_stated: tuple[VerifiedRun, ...] = ()
    unheld: tuple[VerifiedRun, ...] = ()
    inputs: tuple[Channel, ...] = ()
    seed: int = 0
    narrower: tuple[str, ...] = ()
    noise: Noise | None = None
    anew: Callable[[int, Sequence[str]], str] = field(default=command_of, compare=False)

    @property
    def runs(self) -> tuple[VerifiedRun, ...]:
        """Return the random runs of the tuning."""
        return self.tuning.runs

    @property
    def both(self) -> list[Robustness]:
        """Return how the tuning fares and, if it is known, the one before."""
        return [self.tuning] if self.before is None else [self.tuning, self.before]

    @property
    def with_other_noise(self) -> Redrawn:
        """Return what KPIs are with other draws of the sensor noise."""
        known = [t for t in self.both if len(t.draws) == DRAWS]
        own, drawn = [t.nominal for t in known], [t.draws for t in known]
        if not known or self.noise is None:
            return Redrawn()
        return compare_draws(self.kpis, own, drawn, self.tuning.time_unit, self.noise.lacking)

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
        complete = 0 < len(self.as_stated) == len(self.runs)
        return complete and self.sound and not any(run.problems for run in self.as_stated)

    @property
    def sound(self) -> bool:
        """Return whether the nominal run and the nominal loop keep what is stated of them."""
        kept = not self.tuning.nominal.problems and not self.misses_margin
        return kept and self.tuning.margins != UNSTABLE

    @property
    def holds(self) -> bool | None:
        """Return whether nominal and random runs keep the stated limits; None without limits or runs."""
        return self.sound and not self.failed if self.runs and breakable(self.kpis) else None

    @property
    def before_holds(self) -> bool:
        """Return whether the tuning before keeps all that is stated, in all runs: nothing holds in more."""
        old = self.before
        return old is not None and old.holds(len(self.runs)) and replace(self, tuning=old).sound

    @property
    def keeps_margins(self) -> bool | None:
        """Return whether the nominal loop keeps the stated limits on margins; None without any."""
        limited = any(k.margin and k.met(0.0) is not None for k in self.kpis)
        return not self.misses_margin if limited and not isinstance(self.tuning.margins, str) else None

    @property
    def stated(self) -> str:
        """Return what of the task is stated, though it varied, in words."""
        words = [*dict.fromkeys(_TASK.get(f.name, f.name) for f in self.unstated)]
        return f"the stated {join_words(words)}"

    @property
    def _where(self) -> str:
        """Return how many runs hold with the task as stated, and what was left out of what varies."""
        count, said = len(self.as_stated), ""
        if count:
            kept = count_kept(self.as_stated)
            said = f"; at {self.stated}, {kept} of the same {count} hold"
            if count < len(self.runs):
                first = "" if count == len(self.failed) else "first "
                left, verb = count - kept or "none", "happens" if count - kept < 2 else "happen"
                said = f"; {left} of the {first}{count} failures {verb} at {self.stated}, too"
                if count == 1:
                    verb = "does not happen" if kept else "happens, too,"
                    said = f"; the one failure {verb} at {self.stated}"
        still = [
            f"{name}, which fails nominally" if why.startswith("turned,") else name
            for name, why in self.left_out
            if why == RANGE_0 or name in _OF_TASK
        ]
        return f"{said}; not varied: {', '.join(still)}" if still else said

    @property
    def headline(self) -> str:
        """Return whether it holds: what is stated decides; if nothing is, usual limits are counted."""
        own, count, loop = self.tuning.nominal, len(self.runs), self.tuning.margins
        unsafe = sum(run.end is End.UNSAFE for run in self.runs)
        ended = f"; {unsafe} end unsafe" if unsafe else ""
        failed = len(self.failed)
        held = f"{self.asked}{self._few}{ended}{self._where}."
        if failed and own.problems:
            said = f"Does not hold, not even nominally: {count - failed} of {count} runs {held}"
        elif failed:  # 1 of 299 is another finding than 167
            where = f" beyond {self.stated}" if self.holds_as_stated else ""
            said = f"Does not hold{where} in {failed} of {count} runs: {count - failed} {held}"
        elif own.problems or loop == UNSTABLE:  # nominally, which no count of varied runs says
            said = f"Does not hold: {self.words(own) if own.problems else 'the nominal loop is not stable'}."
        elif not count:
            return self.statement
        else:
            holds = "Holds" if breakable(self.kpis) else "Not judged, since no limit on runs is stated"
            where = " on the plants that an input can hold" if self.unheld else ""
            missed = ", but a stated margin is missed" if self.misses_margin else ""
            said = f"{holds}{where}{missed}: {count} of {count} runs {held}"
        said += f" {self._set_apart}." if self.unheld else ""
        if count and self.never:
            none = f"Not even the nominal run has a finite {' or '.join(self.never)}."
            # It comes before a count of what all the same end safely, which reads as good news.
            said = f"{said} {none}" if said.startswith("Does not") else f"{none} {said}"
        said += self._quiet + self._loud
        usual = "; ".join(self._offer(*each) for each in self.usual)
        usual = f" Usual limits: {usual}." if usual and count else ""
        known = "nominal loop is not stable" in said  # nothing else can be said of margins then
        return f"{self._narrower}{said}{usual}{'' if known else f' {self.margin_verdict}'}".rstrip()

    @property
    def _few(self) -> str:
        """Return what is missed where few runs fail, which is another finding than if many do."""
        few = 0 < len(self.failed) < min(CHANCE, len(self.runs) / 2) and len(self._missing) <= _FEW
        if not few or self.tuning.nominal.problems:
            return ""
        said = (self.words_of(k, runs[0]) for p, runs in self._missing.items() if (k := self._kpi_of(p)))
        words = "; ".join(said)
        which = "the other" if len(self.failed) == 1 else "the others, at worst"
        return f" ({which}: {words})" if words else ""

    @property
    def _narrower(self) -> str:
        """Return by which ranges it is judged, before the verdict, if some are narrower than usual."""
        named, more = self.narrower[:3], len(self.narrower) - 3
        others = [f"{more} other{'s' * (more > 1)}"] if more > 0 else []
        return f"By narrower ranges than usual ({join_words([*named, *others])}): " if named else ""

    @property
    def apart(self) -> str:
        """Return how many random runs do not count, and where no input can hold their plants."""
        kept = count_kept(self.unheld)
        varied, said = {f.name for f in self.factors}, list[str]()
        found = [run.unheld for run in self.unheld if run.unheld]
        for channel in self.inputs:
            own = [each for each in found if each.input == channel.name]
            counts = [(sum(each.place == place for each in own), place) for place in PLACES]
            places = " and ".join(f"{count} at the {place}" for count, place in counts if count)
            if own:
                less = ", less where its range varies" * (f"range of {channel.name}" in varied)
                said.append(f"{places}, within the range of {channel.name} ({_needed(channel, own)}{less})")
        unsafe = sum(run.end is End.UNSAFE for run in self.unheld)
        also = f"; {kept} of them keep the limits all the same" if kept else ""
        also += f"; {unsafe} of them end unsafe" if unsafe else ""
        return f"{self._set_apart}: {'; '.join(said)}{also}"

    @property
    def set_apart(self) -> tuple[LeftOut, ...]:
        """Return what no input can hold, and why, if there is any."""
        return (("plants that no input can hold", self.apart),) if self.unheld else ()

    @property
    def _set_apart(self) -> str:
        """Return how many random runs do not count."""
        total = len(self.runs) + len(self.unheld)
        return (
            f"Not counted: {len(self.unheld)} of {total} varied plants, which cannot rest, whatever the "
            "tuning"
        )

    def words(self, run: VerifiedRun) -> str:
        """Return what a run misses, with its values and the limits, or that it holds."""
        said = (self.words_of(kpi, run) if (kpi := self._kpi_of(p)) else p for p in run.problems)
        return "; ".join(said) or "holds"

    def words_of(self, kpi: KPI, run: VerifiedRun, worst: str = "") -> str:
        """Return which value of a KPI misses its limit, in words."""
        return f"{kpi.title} {self._read(kpi, run.kpis[kpi.name])}{worst}, required {limits_text(kpi)}"

    def _read(self, kpi: KPI, value: float) -> str:
        """Return a value of a KPI with its unit, in enough digits to tell it from its limits."""
        limit = kpi.at_most if value > kpi.at_most else kpi.at_least
        read, *_ = comparable(kpi, [value, limit]) if np.isfinite(value) else [kpi.read(value)]
        return with_unit(read_text(kpi, read, self.tuning.time_unit), kpi.unit)

    @property
    def misses(self) -> tuple[str, ...]:
        """Return each limit that some random run misses, with the worst value and the number of runs."""
        found = list[str]()
        for problem, runs in self._missing.items():
            kpi, worst = self._kpi_of(problem), " at worst" if len(runs) > 1 else ""
            said = self.words_of(kpi, runs[0], worst) if kpi else problem
            found.append(f"{said}: in {len(runs)} of {len(self.runs)} runs")
        return tuple(found)

    @property
    def _missing(self) -> dict[str, list[VerifiedRun]]:
        """Return the random runs with each problem, the one that is farthest beyond its limit first."""
        found: dict[str, list[VerifiedRun]] = {}
        for run in self.failed:
            for problem in run.problems:
                found.setdefault(problem, []).append(run)
        for problem, runs in found.items():
            runs.sort(key=partial(_excess, self._kpi_of(problem)), reverse=True)
        return found

    def _kpi_of(self, problem: str) -> KPI | None:
        """Return the KPI whose limit a problem is about; None if it is no limit."""
        return next((kpi for kpi in self.kpis if _miss_words(kpi) == problem), None)

    def beyond(self, run: VerifiedRun) -> float:
        """Return by how much a run misses what it misses by most, as a share of the limit."""
        return max((_excess(self._kpi_of(problem), run) for problem in run.problems), default=0.0)

    @property
    def _quiet(self) -> str:
        """Return that the study of an identified plant has no noise though its record has; "" if not so."""
        told = [f.told for f in self.factors if f.name == NOISE and f.told.startswith(IDENTIFIED)]
        return f" The runs that were compared are without {told[0].removeprefix(IDENTIFIED)}." if told else ""

    @property
    def _loud(self) -> str:
        """Return which KPIs a sensor alone makes many times as bad, such as a valve's moves; "" if none."""
        nominal, said = self.tuning.nominal.kpis, list[str]()
        for factor, *runs in zip(self.factors, self.alone[::2], self.alone[1::2], strict=False):
            worse = list[str]()
            for kpi in (k for k in self.kpis if k.goal == "lower" and factor.kind == "sensor"):
                most = max(run.kpis.get(kpi.name, 0.0) for run in runs)
                if np.inf > most > _LOUD * nominal.get(kpi.name, np.inf) > 0:
                    before, after = map(number, comparable(kpi, [nominal[kpi.name], most]))
                    worse.append(f"{kpi.title} from {before} to {with_unit(after, kpi.unit)}")
            if worse:
                said.append(f" {sentence(f'{factor.name} alone takes {join_words(worse)}')}")
        return "".join(said)

    @property
    def misses_margin(self) -> bool:
        """Return whether the nominal loop misses a limit on a margin, or is not stable at its target."""
        found = self.tuning.margins
        return (isinstance(found, Margins) and found.target == UNSTABLE) or bool(self.missed_margins)

    @property
    def missed_margins(self) -> tuple[KPI, ...]:
        """Return the margins whose limits the nominal loop misses."""
        values = self.tuning.nominal.kpis
        stated = (k for k in self.kpis if k.margin and k.name in values)
        return tuple(k for k in stated if k.met(k.read(values[k.name])) is False)

    @property
    def statement(self) -> str:
        """Return how sure it is that the tuning holds, in a sentence."""
        count = len(self.runs)
        if not count:
            none = "no run was completed" if self.planned else "nothing can be varied"
            return f"Not verified: {f'no run counts. {self.apart}' if self.unheld else none}."
        never = f" Not counted, since infinite nominally, too: {', '.join(self.never)}." if self.never else ""
        done = count + len(self.unheld)
        early = "" if done == self.planned else f" (stopped early, {self.planned} were planned)"
        which = "these ranges that an input can hold" if self.unheld else "these ranges"
        if 2 * len(self.failed) > count:  # a bound near 100 % says nothing
            least = np.floor(100 * (1 - most_probable(count - len(self.failed), count)))
            return (
                f"{count - len(self.failed)} of {count} runs {self.asked}{early}: for plants within {which}, "
                f"{100 * (1 - self.share):.3g} % do not, at least {least:.0f} % with "
                f"{100 * CONFIDENCE:g} % confidence.{never}"
            )
        # Rounded up to two digits, so that what is below it stays below.
        digits = 1 - int(np.floor(np.log10(100 * self.bound)))
        percent = np.ceil(100 * self.bound * 10.0**digits - 1e-9) / 10.0**digits
        return (
            f"{count - len(self.failed)} of {count} runs {self.asked}{early}: for plants within "
            f"{which}, the probability that one does not is below {percent:.3g} % with "
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
        never = f", though it has no finite {' or '.join(self.never)}" if self.never else ""
        nominal = f"The nominal run: {self.words(own)}." if own.problems else f"The nominal run holds{never}."
        if self.tuning.margins == UNSTABLE and not own.problems:
            nominal = "The nominal loop is not stable, though its run ended safely."
        return f"{stated} infinite that is finite nominally. {nominal}"

    @property
    def usual(self) -> tuple[tuple[KPI, float, str], ...]:
        """Return KPIs with a limit that is usual, and why; none if a limit is stated."""
        return () if breakable(self.kpis) or not self.runs else tuple(self._usual())

    def _offer(self, kpi: KPI, limit: float, why: str) -> str:
        kept = sum(kpi.read(run.kpis.get(kpi.name, np.inf)) <= limit for run in self.runs)
        most = quantity(limit, kpi.unit)
        return f"{kpi.title} at most {most}{why}: kept in {kept} of {len(self.runs)} runs"

    def _usual(self) -> Iterator[tuple[KPI, float, str]]:
        for kpi in self.kpis:
            value = self.tuning.nominal.kpis.get(kpi.name, np.inf)
            if not np.isfinite(value) or kpi.goal != "lower" or kpi.margin:
                continue
            title = kpi.title.lower()  # people write their own as they like
            if title.startswith("overshoot") and kpi.unit == "%":
                yield kpi, 10.0, ""
            elif "settling time" in title:
                yield kpi, float(f"{kpi.read(2 * value):.4g}"), " (twice the nominal one)"

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
            there = f" At its target, it {usual_margins(target)}." if target and not said else ""
        if said or isinstance(found, str):
            return f"{self._remaining}Margins of the nominal loop: {said}.{there}" if said else ""
        usual, has = ", ".join(words for words, *_ in USUAL), f"{usual_margins(found)}."
        if there.startswith(also := f" At its target, it {has}"):
            has, there = f"{has[:-1]}, also at its target.", there.removeprefix(also)
        none = f"{self._remaining}No limit on a margin is stated"
        return f"{none}. Usual are {usual}: the nominal loop {has}{there}"

    @property
    def remaining(self) -> float:
        """Return the share of a lasting disturbance that the nominal loop leaves, if it is much; else 0."""
        return remaining(self.tuning.margins)

    @property
    def _remaining(self) -> str:
        """Return that large margins are no merit where there is hardly feedback; "" where there is."""
        share = np.floor(100 * self.remaining)
        left = f"{share:.0f} % or more of a lasting disturbance at its input stays"
        return f"The nominal loop has no integral action: {left}. " if share else ""

    def _stated_margins(self) -> str:
        """Return whether the KPIs that are margins keep the limits that are stated; "" without any."""
        values = self.tuning.nominal.kpis
        stated = [kpi for kpi in self.kpis if kpi.margin and kpi.met(0.0) is not None and kpi.name in values]
        return "; ".join(f"{kept_margin(k, k.read(values[k.name]))}{self._varied_margin(k)}" for k in stated)

    def _varied_margin(self, kpi: KPI) -> str:
        """Return on how many varied plants a margin misses its limit if many do, in parentheses; else ""."""
        ends = self.tuning.quantiles(kpi.name)
        kept = [kpi.met(kpi.read(value)) for value in (*ends, self.tuning.nominal.kpis[kpi.name])]
        if all(kept) or not kept[-1] or not np.isfinite(ends).any():
            return ""
        known = [run.kpis[kpi.name] for run in self.runs if kpi.name in run.kpis]
        missed, worst = sum(kpi.met(kpi.read(v)) is False for v in known), max(known, key=kpi.badness)
        low, high, last = (read_text(kpi, kpi.read(v), self.tuning.time_unit) for v in (*ends, worst))
        return (
            f" (not required of varied plants, of which {missed} of {len(known)} miss it, at worst with "
            f"{with_unit(last, kpi.unit)}; 5 to 95 %: {low} to {with_unit(high, kpi.unit)})"
        )

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
        more = len(able) > 1 and together[0] >= max(held for held, _ in alone) + CHANCE
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
        if len(changed) < len(kpis) or len(freed) < CHANCE:
            return held, ""
        typed = [f"{kpi.name} {_tightest(kpi, freed, typed=True)}" for kpi in kpis]
        limits = [f"{_tightest(kpi, freed)} in place of {limits_text(kpi)}" for kpi in kpis]
        if len(kpis) == 1:
            what, new = f"limit of {kpis[0].title}", limits[0]
        else:
            what = "limits together"
            new = ", ".join(f"{kpi.title} {words}" for kpi, words in zip(kpis, limits, strict=True))
        # The limit is as these runs ask for: no proof that others keep it.
        still = "; the stated margin is missed all the same" if self.misses_margin else ""
        return (
            held,
            f"relax the {what}: with {new}, {held} of these {count} runs hold{still}; as that fits these "
            f"plants, verify it on other ones: {self.anew(self.seed + 1, typed)}",
        )

    def _near(self, kpi: KPI, value: float) -> bool:
        """Return whether a value that misses a limit is finite and no outlier, three times as far off.

        Nor does anybody give up more than the limit itself, such as 140 s in place of 70 s.
        """
        limit = kpi.at_least if np.isfinite(kpi.at_least) else kpi.at_most
        missed = [r.kpis[kpi.name] for r in self.failed if _miss_words(kpi) in r.problems]
        usual = float(np.median(np.abs(np.array(missed) - limit)))
        return bool(np.isfinite(value) and abs(value - limit) <= min(3 * usual, abs(limit) or np.inf))

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

        First who loses a limit, by how far, then who comes nearest to one, then who doubles a KPI: what does
        so often, as noise does, makes wide the range of which `worsening` is a share.
        """
        pairs = zip(self.factors, self.alone[::2], self.alone[1::2], strict=False)
        both = [[*self._ends(factor, runs)] for factor, *runs in pairs]

        def badness(effect: Effect) -> tuple[float, float, bool, float, int]:
            lost = self.beyond(effect.run) if np.isinf(effect.worsening) else -1.0
            return lost, effect.used, effect.doubled, effect.worsening, len(effect.run.problems)

        return tuple(sorted((max(pair, key=badness) for pair in both), key=badness, reverse=True))

    @property
    def lost_by(self) -> tuple[str, ...]:
        """Return the names of the factors by which a limit is lost, as `effects` has them."""
        return tuple(each.factor.name for each in self.effects if np.isinf(each.worsening))

    def worst(self, count: int = 3) -> tuple[VerifiedRun, ...]:
        """Return the worst random runs: those farthest beyond each limit first, by how far that is."""
        farthest = [runs[0] for runs in self._missing.values()]

        def badness(run: VerifiedRun) -> tuple[bool, bool, float, int, float]:
            first = any(run is each for each in farthest)
            worse = max((share for share, *_ in self._worse(run)), default=0.0)
            return first, run.end.interrupted, self.beyond(run), len(run.problems), worse

        return tuple(sorted(self.runs, key=badness, reverse=True)[:count])

    def _ends(self, factor: Factor, runs: Sequence[VerifiedRun]) -> Iterator[Effect]:
        """Yield what a factor does at its ends; where no input can hold the plant, only if it is both."""
        unheld = tuple(run for run in runs if run.unheld and run.problems)
        for run in [run for run in runs if run not in unheld] or [self.tuning.nominal]:
            yield replace(self._effect(factor, run), unheld=unheld)

    def _effect(self, factor: Factor, run: VerifiedRun) -> Effect:
        worse = ((doubled and share > 0.5, share, kpi) for share, doubled, kpi in self._worse(run))
        doubled, worsening, kpi = max(worse, default=(False, 0.0, ""))
        lost = set(run.problems) - set(self.tuning.nominal.problems)
        used, limited = max(self._used(run), default=(0.0, ""))
        kpi, used = (limited, used) if used >= _MUCH else (kpi, 0.0)
        return Effect(factor, run, kpi, np.inf if lost else worsening, used, doubled)

    def _used(self, run: VerifiedRun) -> Iterator[tuple[float, str]]:
        """Yield how much of the room that a KPI has nominally to its limit a run uses, and its title."""
        nominal = self.tuning.nominal
        for kpi in breakable(self.kpis):
            if kpi.goal not in ("lower", "higher") or not {kpi.name} <= run.kpis.keys() & nominal.kpis.keys():
                continue
            limit = kpi.at_most if kpi.goal == "lower" else kpi.at_least
            room, gone = (abs(nominal.kpis[kpi.name] - end) for end in (limit, run.kpis[kpi.name]))
            worse = kpi.badness(run.kpis[kpi.name]) > kpi.badness(nominal.kpis[kpi.name])
            if worse and room > 0 and kpi.met(nominal.kpis[kpi.name]):
                yield min(gone / room, 1e300), kpi.title

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
                # Where the range ends at "never", the nominal value is what a change is a share of.
                span = span if np.isfinite(span) else abs(there) or 1.0
                yield min((here - there) / span, 1e300), doubled, kpi.title


def _needed(channel: Channel, found: Sequence[Unheld]) -> str:
    """Return which values of an input plants would need, below and above its range, and the range."""
    needs, middle = [each.needs for each in found], (channel.low + channel.high) / 2
    sides = [sorted(v for v in needs if (v > middle) == above) for above in (False, True)]
    ends = ({number(float(f"{v:.4g}")): None for v in (side[0], side[-1])} for side in sides if side)
    wanted = " or ".join(" to ".join(side) for side in ends)
    return f"they need {with_unit(wanted, channel.unit)}; it has {_between(channel)} at most"


def _between(channel: Channel) -> str:
    return f"{number(channel.low)} to {quantity(channel.high, channel.unit)}"


def _excess(kpi: KPI | None, run: VerifiedRun) -> float:
    """Return by how much a run misses a limit, as a share of it; infinite if it is no limit of a KPI."""
    if kpi is None:
        return np.inf
    value = run.kpis[kpi.name]
    limit = kpi.at_most if value > kpi.at_most else kpi.at_least
    return float(abs(value - limit) / (abs(limit) or 1.0))


def count_kept(runs: Iterable[VerifiedRun]) -> int:
    """Return how many runs keep the stated limits."""
    return sum(not run.problems for run in runs)


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


def _tightest(kpi: KPI, runs: Sequence[VerifiedRun], *, typed: bool = False) -> str:
    """Return the tightest limit of a KPI that lets some runs hold, in words, or as it is typed."""
    values = [run.kpis[kpi.name] for run in runs if kpi.name in run.kpis]
    limit = kpi.read(min(values) if np.isfinite(kpi.at_least) else max(values))
    sign = objective(kpi)[:1]
    if typed:
        return f"{'<=' if sign == '≤' else '>='} {typed_number(limit)} {kpi.unit}".rstrip()
    return f"{sign} {quantity(limit, kpi.unit)}"


def _miss_words(kpi: KPI) -> str:
    return f"{kpi.title} misses its objective"


def most_probable(failed: int, count: int) -> float:
    """Return the upper limit, with 95 % confidence, of a probability seen `failed` of `count` times.

    Source: Clopper, Pearson (1934), The use of confidence or fiducial limits illustrated in the
    case of the binomial, Biometrika 26; one-sided.
    """
    if failed >= count:
        return 1.0
    return float(betaincinv(failed + 1, count - failed, CONFIDENCE))
