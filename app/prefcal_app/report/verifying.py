"""Verify the tuning of a best.json; what came of it stays beside it, and on the acceptance sheet."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from prefcal_env.disk import digest_of
from prefcal_env.errors import ScenarioError, StaleError
from prefcal_scenarios.many.simulate import Progress
from prefcal_scenarios.presentation.folder import put
from prefcal_scenarios.presentation.style import png
from prefcal_scenarios.verification import Verification, replay, verify
from prefcal_scenarios.verification.factor import Ranges
from prefcal_scenarios.verification.result import VerifiedRun
from prefcal_scenarios.verification.varied_runs import RUNS, unvaried
from prefcal_scenarios.verification.verified import Verified, WorstRun

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
        timeout: Time limit of each run in seconds; None for no limit.
        progress: As for `simulate_many`.

    Raises:
        PrefcalError: If the file or a range does not fit, or nothing of the scenario can vary.
        OSError: If the folder cannot be written.
    """
    tuning = tuning_of(best)
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
    return _kept(found, tuning, best)


def _kept(found: Verification, tuning: Tuning, best: Path) -> Verified:
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
    for k, each in enumerate(found.worst()):
        put(best.parent / picture(k), _drawn(tuning, each, k + 1))
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


def _drawn(tuning: Tuning, worst: VerifiedRun, rank: int) -> bytes:
    """Return a PNG of one of the worst runs beside the nominal one of the same seed."""
    nominal, made = (
        replay(tuning.scenario, tuning.theta, each) for each in (replace(worst, values={}), worst)
    )
    labels = "nominal", f"worst run {rank}: {worst.words}"
    return png(figure(tuning.scenario, nominal, made, labels, own=True))
