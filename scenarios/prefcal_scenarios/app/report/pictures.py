"""Which figures a report has, their names, and how they read to those who cannot see."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from io import BytesIO

from matplotlib.figure import Figure

from prefcal_scenarios.app.presentation.style import save, style
from prefcal_scenarios.app.presentation.wording import measured, number, theta_text

from .course import course, drawn_kpis
from .progress import best_so_far
from .record import Record
from .slices import slices
from .trajectories import best_against, curves_of, side_by_side
from .tried import tried


@dataclass(frozen=True, slots=True)
class Picture:
    """One figure of a report.

    Args:
        file: Name of its file, .png or .gif.
        title: Heading.
        caption: What it shows, in a sentence or two.
        alt: What it says, for those who cannot see it; made from the study.
        draw: Makes it: a figure, or what is in the file.
        applies: Whether the study has what it needs; drawn anyway where not stated.
        markup: HTML that stands for the picture in report.html, trusted as it is: it must need
            nothing from elsewhere. None: the picture itself.
    """

    file: str
    title: str
    caption: str
    alt: Callable[[Record], str]
    draw: Callable[[Record], Figure | bytes]
    applies: Callable[[Record], bool] = lambda record: True
    markup: Callable[[Record], str] | None = None


@dataclass(frozen=True, slots=True)
class Drawn:
    """A picture, what is in its file, and the HTML that stands for it, if not itself."""

    picture: Picture
    alt: str
    content: bytes
    markup: str | None = None


def draw(record: Record, extra: Sequence[Picture] = ()) -> list[Drawn]:
    """Draw every picture that applies, first those that a scenario brings in `extra`."""
    if record.best is None:
        return []
    drawn = []
    with style():
        for picture in (*extra, *PICTURES):
            if picture.applies(record):
                markup = None if picture.markup is None else picture.markup(record)
                content = _content(picture.draw(record))
                drawn.append(Drawn(picture, picture.alt(record), content, markup))
    return drawn


def _content(made: Figure | bytes) -> bytes:
    if isinstance(made, bytes):
        return made
    buffer = BytesIO()
    save(made, buffer)
    return buffer.getvalue()


def automated(record: Record) -> str | None:
    """Name of the reference that stands for fully automated calibration, if there is one."""
    named = [name for name in record.references if "automat" in name.lower()]
    return named[0] if named else next(iter([*record.references][::-1]), None)


def _side_by_side(record: Record) -> Figure:
    other = automated(record)
    assert other is not None
    return side_by_side(record, other)


def _best_alt(record: Record) -> str:
    assert record.best is not None
    theta = theta_text(record.scenario.space, record.best.experiment.theta)
    kpis = [
        f"{k.title} {measured(k, record.best.experiment)} {k.unit}".rstrip()
        for k in record.kpis
        if k.name in record.best.experiment.kpis
    ]
    against = ", ".join(["the first experiment", *record.references])
    return f"Time plots of the best run ({theta}) against {against}. Best: {', '.join(kpis)}."


def _progress_alt(record: Record) -> str:
    assert record.best is not None
    first, last = record.incumbents[0].cost, record.incumbents[-1].cost
    return (
        f"Plot of the performance index of {len(record.trials)} experiments. The best so far "
        f"falls from {number(first)} to {number(last)}, of experiment {record.best.number}."
    )


def _course_alt(record: Record) -> str:
    assert record.best is not None
    verdicts = ", ".join(f"{words} {n}" for words, n in record.verdict_counts().items())
    kpis = [
        f"{k.title} {measured(k, record.trials[0].experiment)} to "
        f"{measured(k, record.best.experiment)} {k.unit}".rstrip()
        for k in drawn_kpis(record)
    ]
    return (
        f"Plots of the KPIs of {len(record.trials)} experiments, and of the verdicts: {verdicts}. "
        f"From the first experiment to the best: {', '.join(kpis) or 'no KPI differs'}."
    )


def _tried_alt(record: Record) -> str:
    assert record.best is not None
    theta = theta_text(record.scenario.space, record.best.experiment.theta)
    return f"Parallel coordinates of {len(record.trials)} θ; the best is {theta}."


def _slices_alt(record: Record) -> str:
    names = ", ".join(record.scenario.space.names)
    return f"Slices and planes of the learned cost over {names}, through the best θ."


def _pair_alt(record: Record) -> str:
    return (
        "Time plots side by side: the run calibrated by preferences to the left, "
        f"{automated(record)} to the right."
    )


PICTURES: tuple[Picture, ...] = (
    Picture(
        "best_trajectory.png",
        "Best trajectory",
        "The best run against the first one and against reference θ. Shaded: the accepted "
        "band around the target. Dashed: limits. A dot ends a run, a cross a stopped one.",
        _best_alt,
        best_against,
        lambda record: bool(record.scenario.panels) and bool(curves_of(record)),
    ),
    Picture(
        "best_so_far.png",
        "Best so far",
        "The performance index of each experiment, and of the best so far. An agent that asks "
        "for preferences never sees it.",
        _progress_alt,
        best_so_far,
        lambda record: record.shows_cost,
    ),
    Picture(
        "course.png",
        "How it went",
        "KPIs of each experiment and of the best so far, in the order tried, and what was "
        "answered. Green: the objectives.",
        _course_alt,
        course,
        lambda record: not record.shows_cost and bool(record.asked),
    ),
    Picture(
        "tried.png",
        "What was tried",
        "One line for each θ. Axes run over the whole range of each knob.",
        _tried_alt,
        tried,
    ),
    Picture(
        "surrogate.png",
        "What was learned",
        "The cost that the agent has learned, cut through the best θ: from the verdicts alone, "
        "unless it was told the score. Only its order has a meaning, its unit has none.",
        _slices_alt,
        slices,
        lambda record: record.surrogate is not None,
    ),
    Picture(
        "final_performance.png",
        "By preferences and fully automated",
        "What preferences have reached, beside what the minimisation of a written-down "
        "index reaches.",
        _pair_alt,
        _side_by_side,
        lambda record: (
            bool(record.scenario.panels)
            and record.scenario.cost is not None  # else nothing can be automated
            and automated(record) is not None
            and not record.scored  # both sides would be automated
        ),
    ),
)
