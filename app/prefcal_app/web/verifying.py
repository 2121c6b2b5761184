"""Verify the result on varied plants while the page of its end is open."""

import threading
from pathlib import Path
from typing import Any

from prefcal_app import report
from prefcal_app.view.tables import cell, row, table
from prefcal_scenarios import verification
from prefcal_scenarios.presentation.wording import number

from .answers import refused
from .pages import Reports

_EFFECTS = 4
"""Number of factors that are shown."""


class Verifying:
    """The verification of the finished report's tuning, in a thread of its own.

    Args:
        reports: Location of the report.
    """

    def __init__(self, reports: Reports) -> None:
        self._reports, self._lock = reports, threading.Lock()
        self._running = self._stopped = False
        self._done, self._planned, self._problem = 0, 0, ""

    def start(self) -> None:
        """Start, unless it runs or there is no report."""
        folder = self._reports.folder
        with self._lock:
            if self._running or folder is None:
                return
            self._running, self._stopped = True, False
            self._done, self._planned, self._problem = 0, 0, ""
        threading.Thread(target=self._verify, args=(folder,), name="verify", daemon=True).start()

    def stop(self) -> None:
        """End the runs; those that are done count."""
        self._stopped = True

    def judge(self, run: int, acceptable: bool) -> None:
        """Keep a person's verdict on one of the worst runs, numbered from 0. Raises StaleError."""
        with self._lock:
            report.verifying.judge(self._reports.folder or Path(), run, acceptable=acceptable)

    def view(self) -> dict[str, Any]:
        """Return how far it is, and what came of it. Raises ScenarioError if that is damaged."""
        folder = self._reports.folder
        told = None
        if folder is not None and not self._running:
            said = verification.verified.Verified.read(folder)
            told = None if said is None else _said(said, folder)
        return {
            "running": self._running,
            "done": self._done,
            "planned": self._planned,
            "problem": self._problem,
            "said": told,
        }

    def _verify(self, folder: Path) -> None:
        try:
            report.verifying.verify_best(folder / verification.verified.BEST, progress=self._progress)
        except Exception as error:
            _, self._problem, _ = refused(error)
        except SystemExit as error:
            self._problem = f"the code of the scenario called exit: {error}"
        finally:
            self._running = False

    def _progress(self, done: int, planned: int | None) -> None:
        self._done, self._planned = done, planned or 0
        if self._stopped:
            raise KeyboardInterrupt  # which a verification takes as its early end


def _said(said: "verification.verified.Verified", folder: Path) -> dict[str, Any]:
    """Return what a verification says, for the page; pictures are in a folder."""
    baseline = [said.baseline] if said.baseline else []
    kpi_heads = ["KPI", "objective", "nominal", "5 %", "95 %"]
    kpi_heads += [f"{said.baseline}, nominal", "5 %", "95 %"] if said.baseline else []
    return {
        "statement": said.statement,
        "limits": said.limits_kept,
        "basis": said.basis,
        "tables": [
            table(label, heads, [row(name, list(map(cell, cells))) for name, *cells in rows])
            for label, heads, rows in (
                ("Stability margins", ["margin", "result", *baseline], said.margins),
                ("KPIs of the varied plants", kpi_heads, said.kpis),
            )
            if rows
        ],
        "effects": list(said.effects[:_EFFECTS]),
        "worst": [
            {
                "words": each.words,
                "values": ", ".join(f"{name} {number(value)}" for name, value in each.values.items()),
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
