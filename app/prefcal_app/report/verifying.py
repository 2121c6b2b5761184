"""Verify the tuning of a best.json; what came of it stays beside it, and on sheet and report."""

import json
import shlex
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime, tzinfo
from functools import partial
from itertools import count
from pathlib import Path

import numpy as np

from prefcal_app.view.end import Told
from prefcal_env.disk import digest_of
from prefcal_env.errors import ScenarioError, StaleError
from prefcal_env.experiments.experiment import End
from prefcal_env.sources.varied import BEYOND, Ranges
from prefcal_scenarios.described.description import join_limits
from prefcal_scenarios.described.making import limited
from prefcal_scenarios.described.steps import marks_of
from prefcal_scenarios.isolated import DEFAULT_LIMIT
from prefcal_scenarios.names import is_built_in, is_described
from prefcal_scenarios.runs import Progress, processes_kept
from prefcal_scenarios.scenario import KPI, Scenario, finds_kpis, with_found_kpis
from prefcal_scenarios.style import png
from prefcal_scenarios.verification import Verification, verify
from prefcal_scenarios.verification.result import VerifiedRun, breakable, command_of
from prefcal_scenarios.verification.said import BEST, REFUSED, REPEAT, Verified, WorstRun
from prefcal_scenarios.verification.said import FILE as VERIFICATION
from prefcal_scenarios.verification.varied_runs import RUNS, replays, robustly, unvaried
from prefcal_scenarios.wording import folder_for, join_words, limits_text, put

from .export import BestTuning, tuning_of, versions
from .pictures import figure
from .write import keep_loop, refresh

_VERDICTS = {True: "acceptable", False: REFUSED}


@processes_kept()
def verify_best(
    best: Path,
    runs: int | None = None,
    *,
    limits: Sequence[str] | None = None,
    ranges: Ranges | None = None,
    jobs: int | None = None,
    timeout: float | None = None,
    seed: int | None = None,
    progress: Progress | bool = False,
    prepare: Callable[[Scenario], None] = lambda scenario: None,
    clock: Callable[[tzinfo], datetime] = datetime.now,
) -> Verified:
    """Return what came of varying the plant of a best.json, written durably beside it.

    One of fewer runs than the one that is there does not replace it: see `written_beside`. Where `runs`,
    `limits`, `ranges` or `seed` is None, it is that of the one that is there.

    Args:
        best: The file.
        runs: Number of random runs.
        limits: Limits of KPIs or margins beside those of the study, each a text such as "overshoot <= 10 %".
        ranges: Relative changes, as for `verify`.
        jobs: Number of processes, as for `verify`.
        timeout: Time limit of each run in seconds; None for that of a study, an hour.
        seed: Seed of the variations, as for `verify`.
        progress: As for `simulate_many`.
        prepare: Called with the scenario before its first run, such as to compile what runs it.
        clock: Function of a time zone that returns the time, for the date of the verdict.

    Raises:
        PrefcalError: If the file or a range does not fit, the folder cannot be written, or nothing of the
            scenario can vary.
    """
    prepare((tuning := _verifiable(best)).scenario)
    timeout = DEFAULT_LIMIT if tuning.own and timeout is None else timeout
    runs, limits, ranges, seed = _fill_in(best.parent, runs, limits, ranges, seed)
    tuning, own = _add_limits(tuning, limits, timeout), tuning.scenario.kpis
    if tuning.scenario.source.asks:
        found = unvaried(tuning.scenario, tuning.theta, tuning)
    else:
        vary = partial(verify, jobs=jobs, timeout=timeout, progress=progress, ranges=ranges)
        vary = partial(vary, start=tuning.before, seed=seed, noise=tuning.seed)
        found = vary(tuning.scenario, tuning.theta, runs)
    command = partial(command_of, best=str(best), more=_options_of(runs, ranges))
    titles = {kpi.title: kpi.name for kpi in found.kpis}
    found = replace(found, anew=lambda seed, wanted: command(seed, join_limits(limits, wanted, titles)))
    said = _put_in_words(found, tuning, best, limits, f"{clock(UTC):%Y-%m-%d %H:%M} UTC")
    told = said.statement + _tell_apart(found, own) * tuning.robust
    said = replace(said, statement=told, limits=limits, ranges=ranges)
    said = _with_earlier(_offering(said, found, own, command), _there(best.parent))
    _keep(said, found, tuning, best, timeout)
    return said


def _fill_in(
    folder: Path, runs: int | None, limits: Sequence[str] | None, ranges: Ranges | None, seed: int | None
) -> tuple[int, tuple[str, ...], Ranges, int]:
    """Return what is asked of a verification: what is None as in the one in a folder, else as usual."""
    there = _there(folder)
    known: tuple[int, tuple[str, ...], Ranges, int] = (RUNS, (), {}, 0)
    if there is not None:
        known = there.planned or RUNS, there.limits, there.ranges, there.seed
    return (
        known[0] if runs is None else runs,
        known[1] if limits is None else tuple(limits),
        known[2] if ranges is None else ranges,
        known[3] if seed is None else seed,
    )


def _verifiable(best: Path) -> BestTuning:
    """Return the tuning of a best.json whose folder can be written."""
    if best.name != BEST:
        raise ScenarioError(
            f"what is verified must be called {BEST}, as verification.json counts for that: got {str(best)!r}"
        )
    tuning = tuning_of(best)
    folder_for(best.parent)
    return tuning


def _add_limits(tuning: BestTuning, limits: Sequence[str], timeout: float | None) -> BestTuning:
    """Return the tuning with further limits of KPIs, which one more run finds if the scenario states none."""
    scenario = tuning.scenario
    if limits and finds_kpis(scenario) and not scenario.source.asks:
        run = VerifiedRun({}, tuning.seed, tuning.end, {})
        scenario = with_found_kpis(scenario, replays(scenario, tuning.theta, [run], timeout)[0])
    return replace(tuning, scenario=limited(scenario, limits))


def _options_of(runs: int, ranges: Ranges) -> list[str]:
    """Return the words that verify by as many runs with the same ranges."""
    changes = (f"{name}={_type_range(change)}" for name, change in ranges.items())
    return [*(("--runs", str(runs)) if runs != RUNS else ()), *_options("--range", changes)]


def _options(flag: str, values: Iterable[str]) -> list[str]:
    return [word for value in values for word in (flag, value)]


def _type_range(change: float | Sequence[float]) -> str:
    ends = [change] if isinstance(change, float | int) else change
    return ":".join(repr(float(end)).removesuffix(".0") for end in ends)


def _begin_another(tuning: BestTuning, best: Path, limits: Sequence[str]) -> str:
    """Return how to compare the result with another tuning by these limits, up to the name of that."""
    limited = shlex.join(_options("--limit", limits)) if is_described(tuning.source) else ""
    words = [f"run: {tuning.anew}" if tuning.anew else REPEAT, *filter(None, [limited])]
    if tuning.anew and "--calibrator human" not in tuning.anew:  # the folder of theirs has the study's name
        folder = best.parent if best.parent.name else Path(best.resolve().parent.name)
        free = (Path(f"{folder}-{k}") for k in count(2))
        words.append(shlex.join(["--out", str(next(each for each in free if not each.exists()))]))
    if tuning.before is not None or " --start " not in tuning.anew:  # else, the study began with its result
        words.append(shlex.join(["--start", str(best)]))
    return " ".join(words)


def _tell_apart(found: Verification, own: Sequence[KPI]) -> str:
    """Return why a robust study, whose KPIs are `own`, counted otherwise than a verification."""
    others, limited = robustly(found.factors, own)[1], bool(breakable(own))
    kinds = {factor.kind for factor in others}
    names = [f.name for f in others] if limited else [words for k, words in BEYOND.items() if k in kinds]
    without = f", without {join_words(names)}" if names else ""
    turned = sum(any(run.values[f.name] != f.nominal for f in others) for run in found.failed)
    these = f": {turned} of the {len(found.failed)} failures have that turned" if limited and names else ""
    said = f" The robust study counted other draws{without}{these if found.failed else ''}."
    return said if found.runs else ""


def _put_in_words(
    found: Verification, tuning: BestTuning, best: Path, limits: Sequence[str], at: str
) -> Verified:
    """Return what a verification says of a best.json, with earlier verdicts on the same worst runs."""
    if found.planned and not found.runs and not found.unheld:
        raise ScenarioError("stopped before a random run was completed, so nothing is written")
    if not best.is_file() or digest_of(best) != tuning.digest:
        raise StaleError(f"{str(best)!r} changed while its tuning was verified: verify again")
    version = versions()["prefcal"]
    baseline = "" if tuning.before is None else tuning.baseline  # else, it counts as one that did not run
    again = _begin_another(tuning, best, limits)
    said = Verified.of(found, tuning.scenario, baseline, version, tuning.digest, again)
    if limits and not is_described(tuning.source):
        first = _how_to_state(tuning.source, limits, found.kpis)
        said = replace(said, advice=tuple(f"{a}{first}" if again in a else a for a in said.advice))
    changed = "Of the plant as its files are now, not as in the study. " if tuning.changed else ""
    return replace(
        said, headline=f"{changed}{said.headline}", worst=_copy_verdicts(said.worst, best.parent), at=at
    )


def _how_to_state(source: str, limits: Sequence[str], kpis: Sequence[KPI]) -> str:
    """Return how a study of a scenario that takes no limits gets those of a verification, after a command."""
    if is_built_in(source):  # there is no file to state them in
        return f"; {source} takes no limits of yours: verify the result of that by the same ones"
    margins = "; ".join(map(_as_code, (k for k in kpis if k.margin and limits_text(k))))
    how = f" (a margin as {margins})" if margins else ""
    return f"; first state {'; '.join(limits)} in the KPIs of your file{how}"


def _as_code(kpi: KPI) -> str:
    """Return a margin with its limit as a Python file states it."""
    end, limit = ("at_most", kpi.at_most) if np.isfinite(kpi.at_most) else ("at_least", kpi.at_least)
    words = ", ".join(json.dumps(each, ensure_ascii=False) for each in (kpi.name, kpi.title, kpi.unit))
    return f"KPI({words}, {end}={limit:g}, margin=True)"


def _offering(
    said: Verified, found: Verification, own: Sequence[KPI], command: Callable[[int, Sequence[str]], str]
) -> Verified:
    """Return what a verification says, with its own limits and the command that judges by usual ones.

    Where it is judged by looser limits than `own`, those of the study, that comes first.
    """
    told = f"{said.limits_kept} Stated for this verification, not in the study: {'; '.join(said.limits)}."
    if said.limits:
        looser = "; ".join(_list_looser(own, found.kpis))
        first = f"By looser limits than the study's ({looser}): " if looser else ""
        nominal, stated = found.tuning.nominal.kpis, {kpi.name for kpi in own if limits_text(kpi)}
        new = [k for k in found.kpis if limits_text(k) and k.name in nominal.keys() - stated]
        required = tuple((k.title, limits_text(k), k.met(nominal[k.name])) for k in new)
        said = replace(said, limits_kept=told, headline=f"{first}{said.headline}", required=required)
    usual = [f"{k.name} <= {float(f'{limit:.4g}'):g} {k.unit}".strip() for k, limit, _ in found.usual]
    if not usual:
        return said
    lines = (command(said.seed, [*said.limits, *usual]),)
    return replace(said, lines=lines, limits_kept=f"{said.limits_kept} To judge it by the usual limits, run:")


def _list_looser(own: Sequence[KPI], now: Sequence[KPI]) -> Iterator[str]:
    """Yield the limits of KPIs that are looser than their own ones, in words."""
    known = {kpi.name: kpi for kpi in own}
    for kpi in now:
        before = known.get(kpi.name, kpi)
        if kpi.at_most > before.at_most or kpi.at_least < before.at_least:
            yield f"{kpi.title} {limits_text(kpi)} in place of {limits_text(before)}"


def _with_earlier(said: Verified, there: Verified | None) -> Verified:
    """Return what a verification says, with what earlier ones of the tuning said that asked otherwise."""
    if there is None:
        return said
    first, earlier = there.headline.removesuffix(".").split(". ")[0], there.earlier
    earlier += (f"{there.at}, {_list_options(there)}: {first}",) if there.runs else ()
    earlier = tuple(each for each in earlier if f", {_list_options(said)}: " not in each)
    told = f" Verified before, otherwise: {'; '.join(earlier)}." if earlier else ""
    return replace(said, earlier=earlier, statement=said.statement + told)


def _list_options(said: Verified) -> str:
    """Return the options of a verification as they are typed."""
    seed = ("--seed", str(said.seed)) if said.seed else ()
    words = [*_options_of(said.planned, said.ranges), *seed, *_options("--limit", said.limits)]
    return shlex.join(words) or "as usual"


def written_beside(said: Verified, folder: Path) -> str:
    """Return the file of a verification of fewer runs than the one in a folder, which stays; "" if not so."""
    kept = _there(folder)
    fewer = kept is not None and kept.made > said.made
    return f"verification-{said.made}-runs.json" if fewer else ""


def _there(folder: Path) -> Verified | None:
    """Return what was verified of the best.json in a folder; None if it is damaged."""
    with suppress(ScenarioError):
        return Verified.read(folder)
    return None


def _keep(said: Verified, found: Verification, tuning: BestTuning, best: Path, timeout: float | None) -> None:
    """Write what a verification says; unless that is beside another, complete the pages with it."""
    beside = written_beside(said, best.parent)
    said.write(best.parent, beside or VERIFICATION)
    if beside:
        return
    both = [each.margins for each in (found.tuning, found.before) if each]
    # One that was interrupted may lack these runs, which the end of the study had.
    noise = found.with_other_noise or Told.read(best.parent).noise
    keep_loop(best.parent, tuning.scenario, both, noise)
    for stale in best.parent.glob("worst_run_*.png"):
        stale.unlink(missing_ok=True)
    with suppress(Exception):  # what cannot run again has no picture
        for rank, drawn in _draw(tuning, found.worst(), said.worst, timeout):
            put(best.parent / picture(rank), drawn)
    refresh(best.parent)


def _copy_verdicts(worst: Sequence[WorstRun], folder: Path) -> tuple[WorstRun, ...]:
    """Return runs with the verdicts that the verification in a folder has on the same ones."""
    before = _there(folder)
    given = [] if before is None else [(replace(run, verdict=""), run.verdict) for run in before.worst]
    return tuple(replace(each, verdict=next((v for run, v in given if run == each), "")) for each in worst)


def picture(worst: int) -> str:
    """Return the name of the picture of one of the worst runs, numbered from 0."""
    return f"worst_run_{worst + 1}.png"


def judge(folder: Path, worst: int, *, acceptable: bool) -> Verified:
    """Keep a person's verdict on one of the worst runs, numbered from 0.

    Raises:
        StaleError: If there is no such run of the best.json that is there.
    """
    said = Verified.read(folder)
    if said is None or not 0 <= worst < len(said.worst):
        raise StaleError(f"worst run {worst + 1} is not of the best.json in {str(folder)!r}: verify again")
    runs = list(said.worst)
    runs[worst] = replace(runs[worst], verdict=_VERDICTS[acceptable])
    told = replace(said, worst=tuple(runs))
    told.write(folder)
    refresh(folder)
    return told


def _draw(
    tuning: BestTuning, worst: Sequence[VerifiedRun], said: Sequence[WorstRun], timeout: float | None
) -> Iterator[tuple[int, bytes]]:
    """Yield number and PNG of the worst runs that did not fail, beside nominal ones of the same seed."""
    shown = [(rank, run) for rank, run in enumerate(worst) if run.end is not End.FAILED]
    runs = [each for _, run in shown for each in (replace(run, values={}), run)]
    made = replays(tuning.scenario, tuning.theta, runs, timeout) if runs else []
    for (rank, _), nominal, varied in zip(shown, made[::2], made[1::2], strict=True):
        labels, words = ("nominal", f"worst run {rank + 1}"), f"{said[rank].words}: {said[rank].text}."
        below, lasts = f"Worst run {rank + 1}: {words}", max(nominal.duration, varied.duration)
        runs_by = dict(zip(labels, (nominal, varied), strict=True))
        marks = {label: marks_of(tuning.scenario.kpis, run, lasts) for label, run in runs_by.items()}
        if any(marks.values()):
            below += " Stated limits of runs are dashed, the band in which they settle is shaded."
        yield rank, png(figure(tuning.scenario, nominal, varied, labels, own=True, marks=marks, below=below))
