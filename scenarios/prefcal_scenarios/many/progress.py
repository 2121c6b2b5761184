"""Tell how many results have arrived."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

Progress = Callable[[int, int | None], None]
"""Function of the number of results that have arrived and of all, None if that is unknown."""


@contextmanager
def counting(progress: Progress | bool, total: int | None) -> Iterator[Callable[[int], None]]:
    """Yield a function that is told how many more results have arrived, and passes on the sum."""
    arrived = 0

    def landed(count: int) -> None:
        nonlocal arrived
        arrived += count
        if count:
            show(arrived, total)

    if progress is True:
        with bar() as show:
            yield landed
    else:
        show = progress or _nothing
        yield landed


@contextmanager
def bar() -> Iterator[Progress]:
    """Show a progress bar with the remaining time on standard error."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, TimeElapsedColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    columns = BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn()
    with Bar(*columns, console=Console(stderr=True)) as display:
        task = display.add_task("experiments", total=None)
        yield lambda arrived, total: display.update(task, completed=arrived, total=total)


def _nothing(arrived: int, total: int | None) -> None:
    """Show nothing."""
