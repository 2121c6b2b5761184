"""Draw the figures of a report: trajectories, the course of the study, and all others."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import takewhile
from textwrap import wrap
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, NullLocator

from prefcal_app.view.now import slices_view
from prefcal_app.view.question import Seen, eventful
from prefcal_env.controllers.margins import Margins, OpenLoop
from prefcal_env.experiments.experiment import Channel, Experiment
from prefcal_env.experiments.panels import Plot, maneuvers_of
from prefcal_env.knobs import Knob
from prefcal_env.plants.plant import Plant
from prefcal_scenarios.described.steps import Mark
from prefcal_scenarios.scenario import KPI, Picture, Scenario, panels_of
from prefcal_scenarios.style import (
    BEST,
    FAINT,
    FIRST,
    GOOD,
    INK,
    LIMIT,
    OTHERS,
    WIDTH,
    above,
    canvas,
    legend,
    look,
    png,
    style,
)
from prefcal_scenarios.wording import (
    knob_axis,
    knob_number,
    labeled,
    mathtext,
    measured,
    number,
    quantity,
    theta_text,
)

from .record import StudyRecord, foremost_kpis

# --- Draw closed-loop runs, overlaid or side by side.

_ACROSS = 3  # largest number of maneuvers next to each other; more would be too narrow to read
_PER_INCH = 14  # number of characters of a title in an inch
_LINE, _WIDE = 76, 100  # number of characters of θ that fit above half of a figure, and of text under it


@dataclass(frozen=True, slots=True)
class DrawnRun:
    """A run to draw."""

    experiment: Experiment
    label: str
    color: str
    width: float = 1.7
    dashes: Any = "-"


_Row = tuple[Plot, bool]  # A panel, and whether it is a zoom on the range around its target


@dataclass(frozen=True, slots=True)
class _Block:
    """Panels below each other with the same curves, and a heading above them."""

    heading: str
    rows: Sequence[_Row]
    curves: Sequence[DrawnRun]
    window: tuple[float, float] | None = None
    """Part of the time that is shown, since what is drawn hardly moves in the rest; None for all of it."""
    own: bool = False
    """Whether targets and limits are those of the first run, not of the scenario."""
    marks: Sequence[Mark] = ()
    """Where stated limits are."""


def curves_of(record: StudyRecord, *, references: bool = True) -> list[DrawnRun]:
    """Return the baseline, the references and the best run, except runs without any record."""
    first, best = record.before, record.result
    alone = {record.baseline: first.experiment}
    (name, _), *others = (record.compared_with if references else alone).items()
    curves = [DrawnRun(first.experiment, f"{name} ({first.number})", FIRST, 1.4)]
    for i, (name, experiment) in enumerate(others):
        color, dashes = look(i)
        curves.append(DrawnRun(experiment, name, color, 1.5, dashes))
    curves.append(DrawnRun(best.experiment, f"best (experiment {best.number})", BEST, 2.0))
    return [c for c in curves if any(len(run.t) for run in c.experiment.runs or (c.experiment,))]


def best_against(
    record: StudyRecord,
    *,
    references: bool = True,
    panels: int | None = None,
    most: float = np.inf,
    width: float = WIDTH,
) -> Figure | None:
    """Draw the best trajectory with what it is compared with; None without any record.

    Args:
        record: Record of the study.
        references: Whether to draw the references, and zooms on targets with a narrow band.
        panels: Largest number of panels, most important first; None for all.
        most: Largest height of the figure, in inches.
        width: Width of the figure, in inches.
    """
    curves = curves_of(record, references=references)
    if not curves:
        return None
    draws = partial(panels_of, record.scenario)
    return overlaid(lambda *runs: draws(*runs)[:panels], curves, zooms=references, most=most, width=width)


def figure(
    scenario: Scenario,
    left: Experiment,
    right: Experiment,
    labels: tuple[str, str] = ("1", "2"),
    *,
    own: bool = False,
    marks: Mapping[str, Sequence[Mark]] | None = None,
    below: str = "",
) -> Figure:
    """Draw two experiments side by side on equal axes, a row for each panel and maneuver.

    Args:
        scenario: Scenario of both experiments.
        left: Left experiment.
        right: Right experiment.
        labels: Labels of the left and the right experiment.
        own: Whether each has targets and limits of its own, as on a varied plant.
        marks: Where the stated limits of each are, by label; None for nowhere.
        below: Text under the figure, which has room for a long one: titles take it from the curves.
    """
    pair = (DrawnRun(left, labels[0], BEST, 1.9), DrawnRun(right, labels[1], OTHERS[0], 1.9))
    parts = maneuvers_of(left, right)
    blocks = []
    for part, runs in parts.items():
        panels = panels_of(scenario, *runs)
        rows = [(panel, False) for panel in panels]
        for window in _windows(panels, runs):
            for curve, run in zip(pair, runs, strict=True):
                heading = part if curve is pair[0] else ""
                limits = (marks or {}).get(curve.label, ())
                blocks.append(_Block(heading, rows, [replace(curve, experiment=run)], window, own, limits))
    with style():
        said = [*_rest(blocks), *wrap(below, _WIDE)]
        height = 0.8 + 1.75 * sum(len(b.rows) for b in blocks) / 2 + 0.2 * len(said)
        drawn, tops = _drawn(blocks, 2, height)
        up = 15 if any(parts) else 0  # above the name of the first maneuver
        thetas = [_theta_lines(scenario, curve.experiment.theta) for curve in pair]
        up += max(map(_over_title, tops[:2]))
        label = 3 + 12 * max(map(len, thetas)) + up
        for axes, curve, lines in zip(tops[:2], pair, thetas, strict=True):
            above(axes, "\n".join(lines), up, color=FAINT, fontsize=8.5)
            above(axes, curve.label, label, color=curve.color, fontweight="bold")
        if said:
            drawn.supxlabel("\n".join(said), x=0.01, ha="left", fontsize=9)
    return drawn


def alone(scenario: Scenario, experiment: Experiment) -> Figure:
    """Draw one experiment, a panel per signal, with a zoom on targets that have a narrow band."""
    theta = "\n".join(_theta_lines(scenario, experiment.theta))
    with style():
        curve = DrawnRun(experiment, theta, BEST, 1.9)
        return overlaid(partial(panels_of, scenario), [curve], zooms=True)


def overlaid(
    panels: Callable[..., Sequence[Plot]],
    curves: Sequence[DrawnRun],
    *,
    zooms: bool = False,
    most: float = np.inf,
    width: float = WIDTH,
) -> Figure:
    """Draw runs over each other, with the references that change: a column of panels for each maneuver.

    `panels` returns those of the runs of one maneuver; one or more runs left a record. With `zooms`, and
    without maneuvers, a narrow band around a target gets a panel of its own. Sizes are as for `best_against`.
    """
    parts = maneuvers_of(*(curve.experiment for curve in curves))
    blocks = []
    for part, runs in parts.items():
        found = [
            replace(curve, experiment=run)
            for curve, run in zip(curves, runs, strict=True)
            if len(run.t) or len(parts) == 1
        ]
        if found:
            drawn = panels(*(c.experiment for c in found))
            zoomed = zooms and len(parts) == 1
            rows = list(_zoomed(drawn, found)) if zoomed else [(panel, False) for panel in drawn]
            windows = _windows(drawn, [c.experiment for c in found])
            blocks += [_Block(part, rows, found, window) for window in windows]
    across = min(len(blocks), _ACROSS)
    count = max(len(block.rows) for block in blocks) * -(-len(blocks) // across)
    each = 1.75 if len(parts) == 1 else 1.6
    height = 0.75 + each * count if np.isinf(most) else min(most, 0.8 + 2.2 * count)
    figure, tops = _drawn(blocks, across, height, width, short=len(parts) > 1)
    if said := _rest(blocks):
        figure.supxlabel(said[0], x=0.01, ha="left", fontsize=9)
    fullest = max(range(len(blocks)), key=lambda i: len(blocks[i].curves))
    legend(figure, tops[fullest], len(curves))
    return figure


def _drawn(
    blocks: Sequence[_Block], across: int, height: float, width: float = WIDTH, *, short: bool = False
) -> tuple[Figure, list[Axes]]:
    """Draw blocks in `height` by `width` inches; return the figure, and the first axes of each block.

    Blocks of the same rows next to each other share their axes.
    """
    count = max(len(block.rows) for block in blocks)
    figure = canvas(height, width)
    grid = figure.subplots(count * -(-len(blocks) // across), across, squeeze=False)
    for axes in grid.flat:
        axes.set_visible(False)
    tops = []
    for i, block in enumerate(blocks):
        top, column = i // across * count, i % across
        places = list(grid[top : top + len(block.rows), column])
        same = column > 0 and blocks[i - 1].rows is block.rows
        for axes, left in zip(places, grid[top:, 0], strict=False):
            axes.set_visible(True)
            axes.tick_params(labelbottom=axes is places[-1], labelleft=not same)
            if same:
                axes.sharey(left)
            beside = same and blocks[i - 1].window == block.window
            if axes is not grid[top, 0] and (beside or axes is not places[0]):
                axes.sharex(grid[top, 0] if beside else places[0])
        _fill(places, block, int(_PER_INCH * width * _span(blocks, i, across) / across), short=short)
        if block.heading:
            above(places[0], block.heading, _over_title(places[0]), fontweight="bold")
        tops.append(places[0])
    return figure, tops


def _over_title(axes: Axes) -> int:
    """Return how many points above axes there is room for what stands above their title."""
    return 21 + 13 * axes.get_title("left").count("\n")


def _span(blocks: Sequence[_Block], i: int, across: int) -> int:
    """Return how many columns the titles of a block have: 0 if those before it stand for both."""

    def goes_on(k: int) -> bool:
        before, block = blocks[k - 1], blocks[k]
        return k % across > 0 and before.rows is block.rows and before.curves is block.curves

    return 0 if goes_on(i) else 1 + len([*takewhile(goes_on, range(i + 1, len(blocks)))])


def _theta_lines(scenario: Scenario, theta: Float[np.ndarray, " n"]) -> list[str]:
    """Return θ in lines that fit above half of a figure."""
    lines, room = [""], 0
    for knob, value in zip(scenario.space, theta, strict=True):
        text = knob_number(knob, value)
        length = len(f"{knob.name} = {text},  ")
        if length > room:
            lines, room = [*lines, ""], _LINE
        lines[-1] += f"{',  ' if lines[-1] else ''}{mathtext(knob.name)} = {text}"
        room -= length
    return lines[1:]


def _zoomed(panels: Sequence[Plot], curves: Sequence[DrawnRun]) -> Iterator[_Row]:
    """Yield every panel, followed by a zoom if its accepted band would look like a line."""
    for panel in panels:
        yield panel, False
        every = np.concatenate([panel.values(c.experiment) for c in curves])
        spread = np.ptp(every[np.isfinite(every)]) if np.isfinite(every).any() else 0.0
        band = panel.channel.band
        if panel.channel.target is not None and band is not None and 2 * band < 0.15 * spread:
            yield panel, True


def _fill(axes: Sequence[Axes], block: _Block, room: int, *, short: bool) -> None:
    """Draw the curves of a block; `short` titles name only the signal and its unit.

    Their lines have at most `room` characters; 0 leaves them out.
    """
    for place, (panel, zoomed) in zip(axes, block.rows, strict=True):
        channel = _own(panel, block.curves[0].experiment) if block.own else panel.channel
        for curve in block.curves:
            _reference(place, panel, curve.experiment)
            _draw(place, panel, curve)
        _limits(place, channel, named=not short)
        for mark in block.marks:
            if (mark.output, "y") == (panel.name, panel.kind):
                _mark(place, mark, panel.scale)
        named = replace(channel, target=None, band=None, low=-np.inf, high=np.inf)
        title = panel_title(named if short else channel, zoomed=zoomed)
        place.set_title(_break(title, room) if room else "")
        if zoomed and channel.target is not None and channel.band is not None:
            place.set_ylim(channel.target - 3 * channel.band, channel.target + 3 * channel.band)
        place.margins(x=0.01)
    axes[-1].set_xlabel(labeled("time", block.curves[0].experiment.channels.time_unit))
    if block.window is not None:
        axes[-1].set_xlim(block.window)


def _break(title: str, room: int) -> str:
    """Return a title in lines of at most `room` characters; a target or limits stay in one line."""
    name, *rest = title.split(" · ")
    whole = " · ".join([name, *(part.replace(" ", "\xa0") for part in rest)])
    return "\n".join(wrap(whole, room)).replace("\xa0", " ")


def _rest(blocks: Sequence[_Block]) -> list[str]:
    """Return a line that says what of the time is not drawn; none if all of it is."""
    cut = [curve.experiment for block in blocks if block.window for curve in block.curves]
    if not cut:
        return []
    end = max(run.t[-1] for run in cut if len(run.t))
    return [f"Of {quantity(end, cut[0].channels.time_unit)}, what is not shown hardly moves."]


def _windows(panels: Sequence[Plot], runs: Sequence[Experiment]) -> Sequence[tuple[float, float] | None]:
    """Return the parts of the time to draw, as the page shows them; None for all of it.

    On paper nobody can zoom out: all of it is drawn unless things happen in less than half of it.
    """
    if not any(len(run.t) for run in runs):
        return [None]
    axes = Seen().frame(panels, *runs)
    parts, (first, last) = eventful(panels, axes, *runs), axes["x"]
    return [(a, b) for a, b in parts] if sum(b - a for a, b in parts) < 0.5 * (last - first) else [None]


def _own(panel: Plot, experiment: Experiment) -> Channel:
    """Return the channel of a panel, with the target and the limits of this run where both have them."""
    found = [c for c in (*experiment.channels.y, *experiment.channels.u) if c.name == panel.name]
    changes = {}
    for name in ("target", "low", "high") if found else ():
        drawn, own = getattr(panel.channel, name), getattr(found[0], name)
        if drawn is not None and own is not None and np.isfinite([drawn, own]).all():
            changes[name] = panel.scale * own
    return replace(panel.channel, **changes)


def _reference(axes: Axes, panel: Plot, experiment: Experiment) -> None:
    """Draw a reference that changes in time, as the runs recorded it."""
    values = experiment.signals.get(panel.reference)
    if values is not None and len(experiment.t):
        axes.plot(
            experiment.t,
            panel.scale * np.asarray(values),
            drawstyle="steps-post",
            color=GOOD,
            linewidth=0.9,
            linestyle=(0, (1, 2)),
        )


def _draw(axes: Axes, panel: Plot, curve: DrawnRun) -> None:
    t, values = curve.experiment.t, panel.values(curve.experiment)
    if not np.isfinite(values).any():
        return
    axes.plot(
        t,
        values,
        label=curve.label,
        color=curve.color,
        linewidth=curve.width,
        linestyle=curve.dashes,
        drawstyle="steps-post" if panel.held else "default",
    )
    # Runs end at different times: a dot marks a completed run, a cross a stopped one.
    marker = "X" if curve.experiment.end.interrupted else "o"
    axes.plot(t[-1], values[-1], marker, color=curve.color, markersize=5, markeredgewidth=0)


def _mark(axes: Axes, mark: Mark, scale: float) -> None:
    """Draw a stated limit: a band as a shade, a value or a time as a dashed line."""
    line: Any = {"color": LIMIT, "zorder": 1, "linewidth": 1.1, "linestyle": (0, (6, 3))}
    if mark.first == mark.last:
        axes.axvline(mark.first, **line)
    elif mark.low == mark.high:
        axes.plot([mark.first, mark.last], [scale * mark.low] * 2, **line)
    else:
        axes.axhspan(scale * mark.low, scale * mark.high, color=GOOD, alpha=0.18, linewidth=0)


def _limits(axes: Axes, channel: Channel, *, named: bool) -> None:
    """Draw target and limits; far limits are left out where the title names them (`named`)."""
    if channel.target is not None:
        axes.axhline(channel.target, color=GOOD, zorder=1, linewidth=0.9, linestyle=(0, (1, 2)))
        if channel.band is not None:
            low, high = channel.target - channel.band, channel.target + channel.band
            axes.axhspan(low, high, color=GOOD, alpha=0.18, linewidth=0)
    low, high = axes.dataLim.intervaly
    moves = named and -np.inf < low < high < np.inf
    for limit in (channel.low, channel.high):
        # A limit far away would make a line of what moves.
        far = moves and not 2 * low - high <= limit <= 2 * high - low
        if np.isfinite(limit) and not far:
            axes.axhline(limit, color=LIMIT, zorder=1, linewidth=1.1, linestyle=(0, (6, 3)))


def panel_title(channel: Channel, *, zoomed: bool = False) -> str:
    """Return the title of a panel: the signal, its unit, and its target or limits."""
    parts = [channel.name]
    if channel.symbol:
        parts.append(f"${channel.symbol}$")
    text = " ".join(parts) + (f" [{channel.unit}]" if channel.unit else "")
    if zoomed:
        return f"{text} · around the target"
    if channel.target is not None:
        text += f" · target {number(channel.target)}"
        if channel.band is not None:
            # A share is read where it is stated as one, as 3 %: of 0.75 K around 65 °C, nobody knows 1.154 %.
            share = 100 * channel.band / abs(channel.target) if channel.target else np.inf
            plain = share < 100 and np.isclose(share, float(f"{share:.2g}"), rtol=1e-9)
            band = f"{number(share)} %" if plain else number(channel.band)
            text += f" ± {band}"
    limits = [number(v) for v in (channel.low, channel.high) if np.isfinite(v)]
    if not limits:
        return text
    return f"{text} · limit{'s' * (len(limits) - 1)} {' to '.join(limits)}"


# --- Draw what was tried: KPIs of every experiment and of the best so far, and costs along each knob.

INDEX = KPI("performance index", "performance index (lower is better)", better="lower")
"""The score that the answers follow, drawn as a KPI."""
_ROWS = 4  # maximum number of KPIs to draw
_KNOBS_ACROSS = 3  # number of knobs next to each other
_LEAST = 10  # smallest span of an axis in differences that people can just see: fewer must not look large
_INNER = (0.05, 0.9)  # quantiles of the experiments that are always within the scale


def course(record: StudyRecord) -> Figure:
    """Draw each KPI in a row, with a dot per experiment and steps for the best.

    The performance index comes first if the answers follow it.
    """
    kpis = drawn_kpis(record)
    figure = canvas(0.8 + 1.35 * len(kpis))
    grid = figure.subplots(len(kpis), 1, sharex=True, squeeze=False)[:, 0]
    for axes, kpi in zip(grid, kpis, strict=True):
        _kpi(axes, record, kpi)
    grid[-1].set_xlim(0.3, record.trials[-1].number + 0.7)
    grid[-1].xaxis.set_major_locator(MaxNLocator(10, integer=True))
    grid[-1].set_xlabel("experiment")
    legend(figure, grid[0], 4)
    return figure


def drawn_kpis(record: StudyRecord) -> list[KPI]:
    """Return the KPIs that tell experiments apart, as many as fit, largest change first."""
    index = [INDEX] if record.shows_cost else []
    return index + foremost_kpis(record, _ROWS - len(index))


def _values(record: StudyRecord, kpi: KPI) -> Float[np.ndarray, " N"]:
    """Return the KPI of every trial as read, or its cost; NaN if unknown."""
    if kpi is INDEX:
        return np.array([np.nan if t.cost is None else t.cost for t in record.trials])
    return record.read(kpi)


def _held(record: StudyRecord, values: Float[np.ndarray, " N"]) -> Float[np.ndarray, " H"]:
    """Return the value of the best so far after each comparison."""
    by_index = dict(zip((t.index for t in record.trials), values, strict=True))
    return np.array([by_index[t.index] for t in record.incumbents])


def _kpi(axes: Axes, record: StudyRecord, kpi: KPI) -> None:
    numbers = np.array([t.number for t in record.trials])
    answered = np.array([c.query.challenger.index + 1 for c in record.comparisons])
    values = _values(record, kpi)
    low, high = _scale(record, kpi)
    axes.plot(
        answered,
        np.clip(_held(record, values), low, high),
        color=BEST,
        linewidth=2.0,
        drawstyle="steps-post",
        label="best so far",
        zorder=3,
    )
    dots: dict[str, Any] = {"linestyle": "", "markeredgewidth": 0, "clip_on": False}
    inside = (values >= low) & (values <= high)
    dots |= {"color": FAINT, "alpha": 0.6, "markersize": 4.5}
    axes.plot(numbers[inside], values[inside], "o", **dots, label="one experiment")
    dots |= {"color": LIMIT, "alpha": 0.75, "markersize": 5, "label": "off the scale or never"}
    for off, at, marker in ((values > high, high, "^"), (values < low, low, "v")):
        if off.any():
            axes.plot(numbers[off], np.full(off.sum(), at), marker, **dots)
    line: dict[str, Any] = {"color": GOOD, "linewidth": 1.1, "linestyle": (0, (5, 3))}
    limits = [limit for limit in (kpi.at_least, kpi.at_most) if low <= limit <= high]
    for i, limit in enumerate(limits):
        axes.axhline(limit, **line, label="objective" if not i else None)
    for i, (name, cost) in enumerate(record.reference_costs.items() if kpi is INDEX else ()):
        color, dashes = look(i)
        axes.axhline(cost, color=color, linewidth=1.2, linestyle=dashes, label=name)
    axes.set_ylim(low, high)
    axes.yaxis.set_major_locator(MaxNLocator(4))
    axes.set_title(labeled(mathtext(kpi.title), kpi.unit))


def _scale(record: StudyRecord, kpi: KPI) -> tuple[float, float]:
    """Return axis limits that include most experiments and every best one, but no outliers.

    Costs of the first experiments can be a hundred times the best one: the index has the scale of
    the references and of the best after half of the initial samples.
    """
    values = _values(record, kpi)
    finite, held = values[np.isfinite(values)], _held(record, values)
    if not len(finite):
        return 0.0, 1.0
    if kpi is INDEX:
        settled = held[min(record.n_init // 2, len(held) - 1) :]
        shown = [*settled, *record.reference_costs.values()]
        shown = [value for value in shown if np.isfinite(value)] or finite.tolist()
    else:
        shown = [*held[np.isfinite(held)].tolist(), *np.quantile(finite, _INNER).tolist()]
    low, high = _widened(min(shown), max(shown), kpi)
    near = [v for v in (kpi.at_least, kpi.at_most) if low - (high - low) < v < high + (high - low)]
    low, high = min(low, *near, high), max(high, *near, low)
    margin = 0.08 * (high - low)
    bottom = low - margin
    return (max(bottom, 0.0) if low >= 0 and bottom < 0 else bottom), high + margin


def _widened(low: float, high: float, kpi: KPI) -> tuple[float, float]:
    """Return a span of `_LEAST` visible differences or more; one of positive values stays so."""
    digits = 10.0 ** min(np.floor(np.log10(max(abs(low), abs(high)) or 1.0)) - 3, 0)  # of four
    lacking = max(_LEAST * max(kpi.step, digits) - (high - low), 0.0)
    down = lacking / 2 if low < 0 else min(lacking / 2, low)
    return low - down, high + lacking - down


def knobs(record: StudyRecord) -> Figure:
    """Draw each experiment along each knob, at its learned cost or else at its number."""
    space, best = record.scenario.space, record.result
    across = min(len(space), _KNOBS_ACROSS)
    down = -(-len(space) // across)
    figure = canvas(0.4 + 2.5 * down)
    grid = figure.subplots(down, across, squeeze=False)
    for axes in grid.flat[len(space) :]:
        axes.set_visible(False)
    learned = record.surrogate and slices_view(space, best.experiment.theta, record.thetas, record.surrogate)
    numbers = [trial.number for trial in record.trials]
    dot: dict[str, Any] = {"marker": "o", "linestyle": "", "clip_on": False}
    for k, (axes, knob) in enumerate(zip(grid.flat, space, strict=False)):
        if learned:
            x, y = learned[k]["x"], learned[k]["y"]
            axes.plot(x, y, color=BEST, linewidth=2)
            tried, height = learned[k]["samples"]["y"], np.interp(learned[k]["best"], x, y)
        else:
            tried, height = numbers, best.number
            axes.yaxis.set_major_locator(MaxNLocator(6, integer=True))
        axes.plot(record.thetas[:, k], tried, **dot, color=FAINT, alpha=0.5, ms=4, mew=0)
        theta = best.experiment.theta[k]
        axes.plot(theta, height, **dot, color=BEST, ms=8, mec="white", mew=1.2, zorder=5)
        axes.set_title(f"best {knob_number(knob, theta)}", color=BEST, fontweight="bold")
        _along(axes, knob)
    words = "learned cost, square root\n(0: the lowest shown)" if learned else "experiment"
    for axes in grid[:, 0]:
        axes.set_ylabel(words)
    return figure


def _along(axes: Axes, knob: Knob) -> None:
    """Show the whole range of a knob."""
    axes.set_xlabel(knob_axis(knob))
    if knob.scale == "log10":
        # Of negative values, matplotlib draws logarithms beyond a threshold only.
        axes.set_xscale("log") if knob.low > 0 else axes.set_xscale("symlog", linthresh=-knob.high)
        axes.xaxis.set_minor_locator(NullLocator())
    else:
        axes.xaxis.set_major_locator(MaxNLocator(5, integer=knob.integer))
    axes.set_xlim(knob.low, knob.high)


# --- Draw the open loop, from which margins are read.

_WINDOW = (-2.0, 1.2, -1.7, 1.2)  # smallest ranges of a Nyquist diagram: real, imaginary
_MARKS = {
    "gain": ("D", "gain margin"),
    "gain reduction": ("s", "gain may fall by"),
    "phase": ("o", "phase margin"),
}
"""Marker and name of what limits the result."""


def open_loop(found: Sequence[Margins | str], kpis: Sequence[KPI], plant: Plant) -> bytes:
    """Return a PNG with the Nyquist diagram of the result and of the tuning before; empty without one.

    Of several inputs each has a curve, with the other loops closed. A plant that is another one at its
    target is drawn where the result has the larger M_s.

    Args:
        found: Margins of the result, then perhaps of the tuning before.
        kpis: KPIs, among which a limit of M_s may be.
        plant: Plant, whose inputs and unit of time are named.
    """
    inputs, unit = [c.name for c in plant.inputs], plant.time_unit
    place, at = _weaker(found[0])
    result, *others = (at(m).loop if isinstance(m, Margins) else None for m in found)
    if result is None:
        return b""
    with style():
        figure = canvas(2.1, 4.1)
        axes = figure.subplots()
        circle = np.exp(1j * np.linspace(0, 2 * np.pi, 361))
        axes.plot(circle.real, circle.imag, color=FAINT, linewidth=0.8, linestyle=(0, (1, 2)))
        for kpi in (k for k in kpis if k.name == "M_s" and k.margin and np.isfinite(k.at_most)):
            ring, words = circle / kpi.at_most - 1, f"limit $M_s$ ≤ {number(kpi.at_most)}"
            axes.plot(ring.real, ring.imag, color=LIMIT, linewidth=1.1, linestyle=(0, (5, 3)), label=words)
        drawn = [(loop, "before", FIRST, 1.1) for loop in others if loop is not None]
        for loop, words, color, width in (*drawn, (result, "result", BEST, 1.7)):
            for i, name in enumerate(inputs):
                L, dashes = loop.L[:, i], "-" if not i else look(i - 1)[1]
                label = words if len(inputs) == 1 else f"{words}, {name}"
                axes.plot(L.real, L.imag, color=color, linewidth=width, linestyle=dashes, label=label)
        _marks(axes, result, unit)
        axes.plot(-1, 0, "+", color=INK, markersize=9)
        axes.set_title(f"Nyquist{place}, sampled every {number(np.pi / result.omega[-1])} {unit}")
        axes.set_aspect("equal", adjustable="box")
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8)
        return png(figure)


def _weaker(result: Margins | str) -> tuple[str, Callable[[Margins], Margins]]:
    """Return where the result has the larger M_s, in words, and what reads the margins there."""
    if isinstance(result, str) or result.target is None:
        return "", lambda m: m
    if result.target.loop is not None and result.target.M_s > result.M_s:
        return " at the target", lambda m: m.target or m
    return " at the start", lambda m: m


def _marks(axes: Axes, loop: OpenLoop, unit: str) -> None:
    """Mark where margins are read, with their frequencies, and show what is around these points."""
    left, right, low, high = _WINDOW
    for name, (omega, L) in loop.points.items():
        marker, words = _MARKS[name]
        phase, decibels = round(abs(np.angle(-L, deg=True)), 1), round(abs(20 * np.log10(abs(L))), 2)
        size = f"{number(phase)}°" if name == "phase" else f"{number(decibels)} dB"
        label = f"{words} {size}\nat {number(omega)} rad/{unit}"
        axes.plot(L.real, L.imag, marker, color=BEST, markersize=5, label=label)
        left = min(left, max(1.2 * L.real, 4 * left))
    axes.set_xlim(left, right)
    axes.set_ylim(low * (right - left) / 3.2, high * (right - left) / 3.2)


# --- List and draw the figures of a report, with captions and texts for people who cannot see them.


@dataclass(frozen=True, slots=True)
class Drawn:
    """A picture and the content of its file."""

    picture: Picture
    alt: str
    content: bytes
    caption: str = ""


def draw(record: StudyRecord, extra: Sequence[Picture] = ()) -> list[Drawn]:
    """Draw every picture that applies, starting with the scenario's own ones in `extra`."""
    if record.best is None:
        return []
    drawn = []
    with style():
        for picture in (*extra, *PICTURES):
            if picture.applies(record):
                made = picture.draw(record)
                content = made if isinstance(made, bytes) else png(made)
                words = picture.caption
                caption = words if isinstance(words, str) else words(record)
                drawn.append(Drawn(picture, picture.alt(record), content, caption))
    return drawn


def _best_theta(record: StudyRecord) -> str:
    return theta_text(record.scenario.space, record.result.experiment.theta)


def _best_alt(record: StudyRecord) -> str:
    best = record.result.experiment
    kpis = [f"{k.title} {measured(k, best)} {k.unit}".rstrip() for k in record.kpis if k.name in best.kpis]
    against = ", ".join(record.compared_with)
    return (
        f"Time plots of the best run ({_best_theta(record)}) against the {against}. Best: {', '.join(kpis)}."
    )


def _best_caption(record: StudyRecord) -> str:
    """Return what the lines mean, and the shaded bands if there are any."""
    runs = [run for c in curves_of(record) for run in c.experiment.runs or (c.experiment,)]
    channels = [plot.channel for plot in panels_of(record.scenario, *runs)]
    shaded = any(c.target is not None and c.band is not None for c in channels)
    band = "Shaded: the accepted band around a target. " if shaded else ""
    return (
        f"The best run beside what it is compared with. {band}Dashed: limits. A dot ends a run, a cross an "
        "interrupted one."
    )


def _course_alt(record: StudyRecord) -> str:
    kpis, sides = [], (record.before, record.result)
    for kpi in drawn_kpis(record):
        if kpi is INDEX:
            texts = [number(trial.cost) for trial in sides]
        else:
            texts = [measured(kpi, trial.experiment) for trial in sides]
        kpis.append(f"{kpi.title} {' to '.join(texts)} {kpi.unit}".rstrip())
    return (
        f"Plots of the KPIs of {len(record.trials)} experiments. From the {record.baseline} "
        f"to the best: {', '.join(kpis)}."
    )


def _knobs_alt(record: StudyRecord) -> str:
    names = ", ".join(record.scenario.space.names)
    return f"Plots of {len(record.trials)} θ along {names}; the best is {_best_theta(record)}."


def _knobs_caption(record: StudyRecord) -> str:
    if record.surrogate is None:
        return "Each experiment at its number, along the whole range of each knob. Blue: the best."
    return (
        "The cost that the agent has learned, along each knob through the best θ (blue). Dots: the "
        "experiments, at their own learned cost. The agent learns from the answers alone, unless "
        "it gets scores. The cost has no unit: only its order has a meaning."
    )


PICTURES: tuple[Picture, ...] = (
    Picture(
        "best_trajectory.png",
        "Best trajectory",
        _best_caption,
        _best_alt,
        lambda record: best_against(record) or b"",
        lambda record: bool(record.scenario.panels) and bool(curves_of(record)),
    ),
    Picture(
        "course.png",
        "How it went",
        "KPIs of each experiment and of the best so far, in the order tried.",
        _course_alt,
        course,
        lambda record: bool(drawn_kpis(record)),
    ),
    Picture("tried.png", "What was tried and learned", _knobs_caption, _knobs_alt, knobs),
)
