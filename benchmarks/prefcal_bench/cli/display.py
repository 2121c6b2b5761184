"""Show the progress of a benchmark on standard error."""

from typing import Self

from rich.console import Console
from rich.markup import escape
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.text import Text

from prefcal_scenarios.wording import printable

_PERIOD = 900.0  # seconds of history for the estimate of the remaining time; a slow cell takes half a minute


class BenchDisplay:
    """Progress bar with the remaining time, and messages above it. A `Watcher`."""

    def __init__(self, console: Console) -> None:
        self.done, self._kept = 0, True
        self._console = console
        self._bar = Progress(
            TextColumn("[bold]{task.fields[what]}"),
            BarColumn(bar_width=None),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            TextColumn("[dim]{task.description}"),
            console=console,
            expand=True,
            speed_estimate_period=_PERIOD,
        )
        self._task = self._bar.add_task("", total=None, what="")

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()
        if not self._console.is_terminal:
            self._console.print()  # outside a terminal, rich leaves the last line open

    def begin(self, what: str, total: int, done: int) -> None:
        """Restart the bar with `done` of `total` results already there."""
        self._bar.remove_task(self._task)
        self._task = self._bar.add_task("", total=total, completed=done, what=escape(what))
        self._kept = what != "random experiments"  # these are in the cache, not in the folder
        if what == "cells":
            self.done = done
            if done:
                self.say(f"{done} of {total} results are there already.")

    def landed(self, what: str) -> None:
        """Advance the bar by one."""
        self.done += self._kept
        self._bar.update(self._task, advance=1, description=escape(printable(what)))

    def say(self, words: str) -> None:
        """Print a line above the bar."""
        self._console.print(Text(printable(words)), soft_wrap=True)
