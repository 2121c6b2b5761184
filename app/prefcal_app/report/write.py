"""Write the folder of a report; every file appears whole or not at all."""

from collections.abc import Sequence
from pathlib import Path

from prefcal_env.errors import ScenarioError
from prefcal_scenarios.presentation.folder import put
from prefcal_scenarios.scenario import Picture
from prefcal_scenarios.verification.verified import FILE as VERIFICATION
from prefcal_scenarios.verification.verified import Verified

from .acceptance import sheet
from .answers import FILE
from .export import best_as_json
from .html import page
from .pictures import PICTURES, draw
from .record import StudyRecord
from .tables import comparisons_as_csv


def write_report(record: StudyRecord, folder: Path, extra: Sequence[Picture] = ()) -> Path:
    """Write the report's files into `folder`; return the path of report.html.

    Equal studies give equal bytes. Files of an earlier report in `folder` are replaced.

    Args:
        record: Record of the study, complete or not.
        folder: Existing folder.
        extra: Additional figures of the scenario.
    """
    if record.best is not None:
        put(folder / "best.json", best_as_json(record).encode())
    else:
        (folder / "best.json").unlink(missing_ok=True)
    put(folder / "comparisons.csv", comparisons_as_csv(record).encode())
    drawn = draw(record, extra)
    for stale in {p.file for p in (*PICTURES, *extra)} - {d.picture.file for d in drawn}:
        (folder / stale).unlink(missing_ok=True)
    for d in drawn:
        put(folder / d.picture.file, d.content)
    if record.best is not None:
        put(folder / FILE, sheet(record, _verified(folder)).encode())
    else:
        (folder / FILE).unlink(missing_ok=True)
    report = folder / "report.html"
    put(report, page(record, drawn).encode())
    return report


def _verified(folder: Path) -> Verified | str | None:
    """Return what was verified of the best.json in a folder; of a damaged file, that it is."""
    try:
        return Verified.read(folder)
    except ScenarioError:
        return f"{VERIFICATION} is damaged, or of another version of prefcal"
