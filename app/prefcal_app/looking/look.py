"""Look at two runs: as plain data, a picture in a notebook, or the page in a browser."""

from base64 import b64encode
from collections.abc import Callable
from dataclasses import dataclass
from html import escape
from io import BytesIO
from pathlib import Path
from typing import Any

from prefcal_app.summary.compare import Spread, compared
from prefcal_env.errors import ExperimentError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.experiments.maneuvers import named
from prefcal_env.experiments.notebook import table_of
from prefcal_env.experiments.panels import Plot
from prefcal_scenarios.presentation.folder import picture_at, put
from prefcal_scenarios.presentation.wording import printable, with_unit
from prefcal_scenarios.scenario import KPI

from .kpis import measured_run
from .pair import NamedRun, aligned


def look(
    left: Experiment,
    right: Experiment,
    *,
    names: tuple[str, str] = ("left", "right"),
    align: bool | None = None,
) -> "SideBySide":
    """Compare two runs from anywhere: in a notebook, the result shows their picture and KPIs.

    Args:
        left: A run, for example from `recorded`, `from_frame` or a study.
        right: Another run. Its time base, its length and its signals may differ.
        names: Names of both, as shown to people.
        align: Whether to draw both from time 0; None to do so only if their times do not overlap.

    Raises:
        ExperimentError: If one of them is not an experiment.
    """
    runs = []
    for side, name, experiment in zip(("left", "right"), names, (left, right), strict=True):
        if not isinstance(experiment, Experiment):
            raise ExperimentError(
                f"the {side} run must be an Experiment, got {type(experiment).__name__}: "
                "prefcal_env.from_frame makes one of a table"
            )
        runs.append(run_of(str(name), experiment))
    return SideBySide.of(*runs, align=align)


def run_of(name: str, experiment: Experiment, about: str = "") -> NamedRun:
    """Return an experiment as a run to look at, with KPIs that every run has."""
    measured, kpis = measured_run(experiment)
    return NamedRun(name, measured, kpis, about)


@dataclass(frozen=True, slots=True)
class SideBySide:
    """Two runs beside each other, with the same curves.

    Args:
        left: Left run.
        right: Right run.
        panels: Panels from top to bottom; a run that lacks a curve has no values there.
        known: KPIs that either run has.
        notes: What was changed to make them comparable, in sentences.
    """

    left: NamedRun
    right: NamedRun
    panels: tuple[Plot, ...]
    known: tuple[KPI, ...]
    notes: tuple[str, ...] = ()

    @classmethod
    def of(cls, left: NamedRun, right: NamedRun, *, align: bool | None = None) -> "SideBySide":
        """Return two runs beside each other; for `align`, see `aligned`."""
        return cls(*aligned(left, right, align=align))

    def kpis(self) -> list[dict[str, Any]]:
        """Return the KPIs of both runs with their differences, the largest first."""
        return compared(self.left.experiment, self.right.experiment, self.known, Spread())

    def png(self) -> bytes:
        """Return the picture of both runs over each other; references are dotted."""
        # Imported here: plotting takes half a second to import.
        from prefcal_app.report.trajectories import DrawnRun, overlaid
        from prefcal_scenarios.presentation.style import BEST, OTHERS, save, style

        looks = ((BEST, "-"), (OTHERS[0], (0, (5, 1.6))))
        curves = [
            DrawnRun(run.experiment, printable(run.name).replace("$", r"\$"), color, 1.7, dashes)
            for run, (color, dashes) in zip((self.left, self.right), looks, strict=True)
        ]
        buffer = BytesIO()
        with style():
            save(overlaid(self.panels, curves), buffer)
        return buffer.getvalue()

    def save(self, path: str | Path) -> Path:
        """Write the picture of both runs to a PNG file and return its path.

        Raises:
            SettingsError: If `path` does not end in .png, or its folder does not exist or cannot be
                written to.
        """
        target = picture_at(path)
        put(target, self.png())
        return target

    def show(self, wait: Callable[[], object] = input) -> None:
        """Open the page of both runs in a browser, until Enter is pressed.

        Args:
            wait: Function that returns when the page is no longer needed.
        """
        from prefcal_app.web import open_browser

        from .window import LookWindow

        with LookWindow((self.left, self.right)) as window:
            print(window.link, flush=True)
            open_browser(window.link)
            wait()

    def _repr_html_(self) -> str:
        """Return picture and KPIs for a notebook, self-contained."""
        left, right = self.left.name, self.right.name
        rows = [
            (
                # Without maneuvers there are no groups.
                named(row["title"], row["group"]) if row["group"] else row["title"],
                *(with_unit(row[side]["text"], row["unit"]) for side in ("left", "right")),
                row["difference"] or "–",
            )
            for row in self.kpis()
        ]
        picture = b64encode(self.png()).decode()
        return (
            f'<img alt="{escape(left)} and {escape(right)}" '
            f'src="data:image/png;base64,{picture}">'
            f"{table_of(('KPI', left, right, 'difference'), rows)}"
        )
