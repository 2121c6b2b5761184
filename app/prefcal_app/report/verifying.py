"""Verify the tuning of a best.json; what came of it stays beside it, and on the acceptance sheet."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from prefcal_env.disk import digest_of
from prefcal_env.errors import ScenarioError, StaleError
from prefcal_env.experiments.experiment import End
from prefcal_scenarios.isolated import DEFAULT_LIMIT
from prefcal_scenarios.many.simulate import Progress
from prefcal_scenarios.presentation.folder import folder_for, put
from prefcal_scenarios.presentation.style import png
from prefcal_scenarios.verification import Verification, verify
from prefcal_scenarios.verification.factor import Ranges
from prefcal_scenarios.verification.result import VerifiedRun
from prefcal_scenarios.verification.varied_runs import RUNS, replays, unvaried
from prefcal_scenarios.verification.verified import BEST, Verified, WorstRun

from .answers import refresh
from .export import Tuning, tuning_of, versions
from .trajectories import figure

_VERDICTS = {True: "acceptable", False: "not acceptable"}


def verify_best(
    best: Path,
    runs: int = RUNS,
    *,
    ranges: Ranges | None = None,
    jobs: int | None = None,
    timeout: float | None = None,
    progress: Progress | bool = False,
) -> Verified:
    """Return what came of varying the plant of a best.json, written durably beside it.

    Args:
        best: The file.
        runs: Number of random runs.
        ranges: Relative changes, as for `verify`.
        jobs: Number of processes, as for `verify`.
        timeout: Time limit of each run in seconds; None for that of a study if the scenario is a person's
            own, which runs in other processes, and for no limit otherwise.
        progress: As for `simulate_many`.

    Raises:
        PrefcalError: If the file or a range does not fit, the folder cannot be written, or nothing of the
            scenario can vary.
    """
    if best.name != BEST:
        raise ScenarioError(
            f"what is verified must be called {BEST}, as verification.json counts for that: got {str(best)!r}"
        )
    tuning = tuning_of(best)
    folder_for(best.parent)
    if tuning.own and timeout is None:
        timeout = DEFAULT_LIMIT
    if tuning.scenario.source.asks:
        found = unvaried(tuning.scenario, tuning.theta, tuning)
    else:
        found = verify(
            tuning.scenario,
            tuning.theta,
            runs,
            start=tuning.before,
            ranges=ranges,
            jobs=jobs,
            timeout=timeout,
            progress=progress,
        )
    return _kept(found, tuning, best, timeout)


def _kept(found: Verification, tuning: Tuning, best: Path, timeout: float | None) -> Verified:
    """Write what a verification says, with earlier verdicts on the same runs, and draw its worst runs."""
    if found.planned and not found.runs:
        raise ScenarioError("stopped before a random run was completed, so nothing is written")
    if not best.is_file() or digest_of(best) != tuning.digest:
        raise StaleError(f"{str(best)!r} changed while its tuning was verified: verify again")
    said = Verified.of(found, tuning.scenario, tuning.baseline, versions()["prefcal"], tuning.digest)
    said = replace(said, worst=_judged(said.worst, best.parent))
    said.write(best.parent)
    for stale in best.parent.glob("worst_run_*.png"):
        stale.unlink(missing_ok=True)
    with suppress(Exception):  # what cannot run again has no picture
        for rank, drawn in _drawn(tuning, found.worst(), timeout):
            put(best.parent / picture(rank), drawn)
    refresh(best.parent)
    return said


def _judged(worst: Sequence[WorstRun], folder: Path) -> tuple[WorstRun, ...]:
    """Return runs with the verdicts that the verification in a folder has on the same ones."""
    try:
        before = Verified.read(folder)
    except ScenarioError:  # a damaged file is written anew
        before = None
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


def _drawn(
    tuning: Tuning, worst: Sequence[VerifiedRun], timeout: float | None
) -> Iterator[tuple[int, bytes]]:
    """Yield number and PNG of the worst runs that did not fail, beside nominal ones of the same seed."""
    shown = [(rank, run) for rank, run in enumerate(worst) if run.end is not End.FAILED]
    runs = [each for _, run in shown for each in (replace(run, values={}), run)]
    made = replays(tuning.scenario, tuning.theta, runs, timeout) if runs else []
    for (rank, run), nominal, varied in zip(shown, made[::2], made[1::2], strict=True):
        labels = "nominal", f"worst run {rank + 1}: {run.words}"
        yield rank, png(figure(tuning.scenario, nominal, varied, labels, own=True))
