"""Verify the result on varied plants while the page of its end is open."""

import threading
from pathlib import Path
from typing import Any

from prefcal_app import report
from prefcal_app.view.tables import cell, row, table
from prefcal_env.errors import StaleError
from prefcal_scenarios import verification

from .answers import refused
from .pages import Reports

_PATIENCE = 10.0
"""Seconds that closing waits for the runs in progress, whose result is then kept."""


class Verifying:
    """The verification of the finished report's tuning, in a thread of its own.

    Args:
        reports: Location of the report.
    """

    def __init__(self, reports: Reports) -> None:
        self._reports, self._lock = reports, threading.Lock()
        self._thread: threading.Thread | None = None
        self._stopped = False
        self._done, self._planned, self._problem = 0, 0, ""

    def start(self) -> None:
        """Start, unless it runs or there is no report."""
        folder = self._reports.folder
        with self._lock:
            if self.running or folder is None:
                return
            self._done, self._planned, self._problem, self._stopped = 0, 0, "", False
            self._thread = threading.Thread(target=self._verify, args=(folder,), name="verify", daemon=True)
            self._thread.start()

    @property
    def running(self) -> bool:
        """Whether the plant is being varied."""
        return self._thread is not None and self._thread.is_alive()

    def stop(self) -> None:
        """End the runs; those that are done count."""
        self._stopped = True

    def close(self) -> None:
        """End the runs, and wait until what they say is kept."""
        self.stop()
        if self._thread is not None:
            self._thread.join(_PATIENCE)

    def judge(self, run: int, seed: int, best: str, acceptable: bool) -> None:
        """Keep a person's verdict on one of the worst runs.

        Args:
            run: Its number, from 0.
            seed: Its seed.
            best: Digest of the tuning that was verified.
            acceptable: The verdict.

        Raises:
            StaleError: If another tuning was verified, or the same one again.
        """
        with self._lock:
            folder, said = self._reports.folder, self._said()
            known = [] if said is None else [(each.seed, said.best) for each in said.worst]
            if folder is None or known[run : run + 1] != [(seed, best)]:
                raise StaleError("the result was verified again since you looked")
            report.verifying.judge(folder, run, acceptable=acceptable)

    def view(self) -> dict[str, Any]:
        """Return how far it is, and what came of it. Raises ScenarioError if that is damaged."""
        folder = self._reports.folder
        said = None if folder is None or self.running else self._said()
        return {
            "running": self.running,
            "runs": verification.varied_runs.RUNS,
            "done": self._done,
            "planned": self._planned,
            "problem": self._problem,
            "said": None if folder is None or said is None else _view(said, folder),
        }

    def _said(self) -> "verification.verified.Verified | None":
        folder = self._reports.folder
        return None if folder is None else verification.verified.Verified.read(folder)

    def _verify(self, folder: Path) -> None:
        try:
            report.verifying.verify_best(folder / verification.verified.BEST, progress=self._progress)
        except Exception as error:
            _, self._problem, _ = refused(error)
        except SystemExit as error:
            self._problem = f"the code of the scenario called exit: {error}"

    def _progress(self, done: int, planned: int | None) -> None:
        self._done, self._planned = done, planned or 0
        if self._stopped:
            raise KeyboardInterrupt  # which a verification takes as its early end


def _view(said: "verification.verified.Verified", folder: Path) -> dict[str, Any]:
    """Return what a verification says, for the page; pictures are in a folder."""
    return {
        "best": said.best,
        "statement": said.statement,
        "limits": said.limits_kept,
        "basis": said.basis,
        "tables": [
            table(label, heads, [row(name, list(map(cell, cells))) for name, *cells in rows])
            for label, heads, rows in (
                ("Stability margins", said.margin_columns, said.margins),
                ("KPIs of the varied plants", said.kpi_columns, said.kpis),
            )
            if rows
        ],
        "effects": list(said.effects[: verification.verified.EFFECTS]),
        "worst": [
            {
                "words": each.words,
                "values": each.text,
                "seed": each.seed,
                "verdict": each.verdict,
                "picture": _picture(folder, report.verifying.picture(k)),
            }
            for k, each in enumerate(said.worst)
        ],
        "varied": list(said.varied),
        "left_out": list(said.left_out),
    }


def _picture(folder: Path, name: str) -> str:
    """Return the address of a picture; empty if the run could not be drawn."""
    return f"/report/{name}" if (folder / name).is_file() else ""
