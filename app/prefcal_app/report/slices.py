"""Draw slices of the learned cost through the best θ."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, NullLocator

from prefcal_env.knobs.space import KnobSpace
from prefcal_scenarios.presentation.style import BEST, FAINT, VALLEY, WIDTH, canvas
from prefcal_scenarios.presentation.wording import knob_axis

from .record import Record, Surrogate, above

_LINE, _PLANE = 121, 41
"""Number of points of a slice, and along each side of a plane."""


def slices(record: Record) -> Figure:
    """Draw each knob's slice on the diagonal, each pair's plane below, and the samples on both."""
    assert record.surrogate is not None
    space = record.scenario.space
    n = len(space)
    figure = canvas(min(2.45, 9.0 / n) * n, WIDTH)
    grid = figure.subplots(n, n, squeeze=False)
    learned = _Learned.of(record)
    for i in range(n):
        for j in range(n):
            axes = grid[i, j]
            if j > i:
                axes.set_visible(False)
                continue
            if i == j:
                _line(axes, record, i, learned)
            else:
                _plane(axes, record, (j, i), learned)
            axes.set_xlabel(knob_axis(space.knobs[j]) if i == n - 1 else "")
            if j == 0 and i > 0:
                axes.set_ylabel(knob_axis(space.knobs[i]))
    grid[0, 0].set_ylabel("learned cost, square root\n(0: the lowest shown)")
    _explain(figure, n)
    return figure


def _best(record: Record) -> Float[np.ndarray, " n"]:
    assert record.best is not None
    return record.best.experiment.theta


def _explain(figure: Figure, n: int) -> None:
    figure.text(
        1.08 / n if n > 1 else 0.4, 0.985,
        "The learned cost through the best θ (blue).\n"
        "Diagonal: one knob moved, the others at their best.\n"
        "Below: two knobs moved; the bluer, the better.\n"
        "Dots: the experiments, at their own learned cost\n"
        "(diagonal), or projected onto the plane (below).",
        va="top", color=FAINT, linespacing=1.6,
    )  # fmt: skip


def _line(axes: Axes, record: Record, i: int, learned: "_Learned") -> None:
    space, best = record.scenario.space, _best(record)
    values = _along(space, i, _LINE)
    axes.plot(
        record.thetas[:, i],
        learned(record.thetas),
        "o",
        color=FAINT,
        alpha=0.45,
        ms=3.6,
        mew=0,
        clip_on=False,
    )
    axes.plot(values, learned(_moved(best, i, values)), color=BEST, linewidth=2)
    axes.plot(best[i], float(learned(best[None, :])[0]), "o", color=BEST, ms=7,
              mec="white", mew=1.2, zorder=5, clip_on=False)  # fmt: skip
    _scale(axes, space, i, "x")


def _plane(axes: Axes, record: Record, pair: tuple[int, int], learned: "_Learned") -> None:
    space, best = record.scenario.space, _best(record)
    j, i = pair
    across, up = _along(space, j, _PLANE), _along(space, i, _PLANE)
    values = learned(_plane_points(best, pair, across, up)).reshape(len(up), len(across))
    axes.contourf(across, up, values, levels=14, cmap=VALLEY)
    axes.plot(
        record.thetas[:, j],
        record.thetas[:, i],
        "o",
        color="#39434d",
        ms=3,
        mew=0,
        alpha=0.6,
        clip_on=False,
    )
    axes.plot(
        best[j], best[i], "o", color=BEST, ms=8, mec="white", mew=1.4, zorder=5, clip_on=False
    )
    axes.grid(False)
    _scale(axes, space, j, "x")
    _scale(axes, space, i, "y")


def _moved(
    best: Float[np.ndarray, " n"], i: int, values: Float[np.ndarray, " c"]
) -> Float[np.ndarray, "c n"]:
    """Return the best θ with knob `i` set to each of `values`."""
    points = np.repeat(best[None, :], len(values), axis=0)
    points[:, i] = values
    return points


def _plane_points(
    best: Float[np.ndarray, " n"],
    pair: tuple[int, int],
    across: Float[np.ndarray, " a"],
    up: Float[np.ndarray, " b"],
) -> Float[np.ndarray, "m n"]:
    """Return the best θ with two knobs set to each pair of values, row by row upwards."""
    first, second = (grid.ravel() for grid in np.meshgrid(across, up))
    points = _moved(best, pair[0], first)
    points[:, pair[1]] = second
    return points


@dataclass(frozen=True, slots=True)
class _Learned:
    """Learned cost as it is drawn: the square root of the difference to the lowest value shown.

    Only the order of learned costs has a meaning, and the square root emphasizes low ones.
    """

    surrogate: Surrogate
    lowest: float

    @classmethod
    def of(cls, record: Record) -> "_Learned":
        """Return the learned cost, offset by its lowest value in all samples, slices and planes."""
        assert record.surrogate is not None
        space, best = record.scenario.space, _best(record)
        n = len(space)
        points = [record.thetas, best[None, :]]
        points += [_moved(best, i, _along(space, i, _LINE)) for i in range(n)]
        points += [
            _plane_points(best, (j, i), _along(space, j, _PLANE), _along(space, i, _PLANE))
            for i in range(n)
            for j in range(i)
        ]
        return cls(record.surrogate, float(record.surrogate(np.vstack(points)).min()))

    def __call__(self, thetas: Float[np.ndarray, "m n"]) -> Float[np.ndarray, " m"]:
        """Return the drawn cost of physical θ, 0 or more."""
        return above(self.surrogate(thetas), self.lowest)


def _along(space: KnobSpace, i: int, count: int) -> Float[np.ndarray, " c"]:
    """Return values of knob `i` over its range, physical and without repeated integers."""
    knob = space.knobs[i]
    return np.unique([knob.decode(z) for z in np.linspace(0, 1, count)])


def _scale(axes: Axes, space: KnobSpace, i: int, side: str) -> None:
    knob = space.knobs[i]
    axis = axes.xaxis if side == "x" else axes.yaxis
    if knob.scale == "log10":
        axes.set(**{f"{side}scale": "log"})
        axis.set_minor_locator(NullLocator())
    else:
        axis.set_major_locator(MaxNLocator(5, integer=knob.integer))
    axes.set(**{f"{side}lim": (knob.low, knob.high)})
