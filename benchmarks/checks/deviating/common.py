"""Provide what all parts share: progress, tables, seeds, the paper's θ."""

import argparse
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

AUTOMATED, PREFERRED = (0.25, 26.0, -0.91), (0.31, 26.0, -1.79)
CAR = (0.085, 0.31, 16.0, 0.261, 0.918)
"""θ found in the paper."""
ERRORS = Console(stderr=True)


def bar(jobs: Sequence[Any], label: str) -> Iterator[Any]:
    """Yield `jobs` one after the other, with a progress bar."""
    yield from track(jobs, label, console=ERRORS)


def table(title: str, *columns: str) -> Table:
    return Table(*columns, title=title, title_justify="left")


def seeds(args: argparse.Namespace) -> range:
    return range(args.first, args.first + args.seeds)


def two(a: float, b: float, digits: str) -> tuple[str, str]:
    return format(a, digits), format(b, digits)


def quantile(values: np.ndarray) -> list[float]:
    return [float(q) for q in np.quantile(values, (0.5, 0.95))]


def lowest(grid: np.ndarray, values: Sequence[float]) -> str:
    """Return where a function is smallest on a grid, and its value there."""
    k = int(np.argmin(values))
    return f"{values[k]:.4f} at {grid[k]:.2f}"
