"""What a user sees on standard error while a study runs."""

from types import TracebackType
from typing import Self

import numpy as np
from jaxtyping import Float
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.markup import escape
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeRemainingColumn,
)
from rich.text import Text

from prefcal_env.compiling import Compiling
from prefcal_env.study import Comparison
from prefcal_scenarios.interview import Now
from prefcal_scenarios.report.record import VERDICTS
from prefcal_scenarios.report.wording import theta_text
from prefcal_scenarios.scenario import Scenario


class Display:
    """A progress bar that names the current θ, the best θ and the verdicts so far."""

    def __init__(self, scenario: Scenario, n_max: int, console: Console) -> None:
        self._scenario, self._console = scenario, console
        self._counts = dict.fromkeys(VERDICTS, 0)
        self._current = "none yet"
        self._best = "none yet"
        self._compiling = False
        self._bar = Progress(
            TextColumn("[bold]{task.description}"), BarColumn(bar_width=None),
            MofNCompleteColumn(), TimeRemainingColumn(compact=True), console=console,
            expand=True,
        )  # fmt: skip
        self._task = self._bar.add_task(f"calibrating {escape(scenario.name)}", total=n_max)
        self._live = Live(console=console, get_renderable=self._lines, refresh_per_second=8)

    def __enter__(self) -> Self:
        self._live.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._live.stop()
        if not self._console.is_terminal:
            self._console.print()  # there, rich leaves the last line open

    def compiling(self, part: Compiling) -> None:
        """Say what is being compiled; where there is no live display, once and for all."""
        if not self._console.is_terminal and not self._compiling:
            self._console.print(part.words, markup=False, highlight=False, soft_wrap=True)
        self._compiling = True
        self._current = part.words

    def running(self, theta: Float[np.ndarray, " n"]) -> None:
        """Say which θ is being tried now."""
        self._current = theta_text(self._scenario.space, theta)

    def compared(self, comparison: Comparison) -> None:
        """Count one more experiment and its verdict."""
        if comparison.incumbent is not None:
            self._counts[comparison.answer.preference] += 1
        self._bar.advance(self._task)

    def best(self, now: Now) -> None:
        """Name the best experiment: the one that the study would return if it ended now."""
        index = now.incumbent
        if index is not None:
            theta = np.array(now.state.samples[index].theta)
            self._best = f"{theta_text(self._scenario.space, theta)} (experiment {index + 1})"

    def _lines(self) -> RenderableType:
        counts = " · ".join(f"{VERDICTS[v]} {n}" for v, n in self._counts.items())
        rows = (("θ now", self._current, ""), ("best θ", self._best, "bold blue"),
                ("verdicts", counts, ""))  # fmt: skip
        texts = [Text.assemble((f"{name:<9} ", "dim"), (text, look)) for name, text, look in rows]
        return Group(self._bar, *texts)
