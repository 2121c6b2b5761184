"""List and draw the figures of a report, with captions and texts for people who cannot see them."""

from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from math import isfinite

from matplotlib.figure import Figure

from prefcal_scenarios.presentation.style import save, style
from prefcal_scenarios.presentation.wording import measured, number, theta_text
from prefcal_scenarios.scenario import Picture, panels_of

from .course import course, drawn_kpis, draws_objectives
from .progress import best_so_far
from .record import Record
from .slices import slices
from .trajectories import best_against, curves_of, side_by_side
from .tried import tried


@dataclass(frozen=True, slots=True)
class Drawn:
    """A picture and the content of its file."""

    picture: Picture
    alt: str
    content: bytes
    caption: str = ""


def draw(record: Record, extra: Sequence[Picture] = ()) -> list[Drawn]:
    """Draw every picture that applies, starting with the scenario's own ones in `extra`."""
    if record.best is None:
        return []
    drawn = []
    with style():
        for picture in (*extra, *PICTURES):
            if picture.applies(record):
                content = _content(picture.draw(record))
                words = picture.caption
                caption = words if isinstance(words, str) else words(record)
                drawn.append(Drawn(picture, picture.alt(record), content, caption))
    return drawn


def _content(made: Figure | bytes) -> bytes:
    if isinstance(made, bytes):
        return made
    buffer = BytesIO()
    save(made, buffer)
    return buffer.getvalue()


def automated(record: Record) -> str | None:
    """Return the name of the reference for fully automated calibration, if there is one."""
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
    against = ", ".join(record.compared_with)
    return f"Time plots of the best run ({theta}) against the {against}. Best: {', '.join(kpis)}."


def _best_caption(record: Record) -> str:
    """Return the caption of the best trajectory: it names only what is drawn."""
    curves = [curve.experiment for curve in curves_of(record)]
    channels = [panel.channel for panel in panels_of(record.scenario, *curves)]
    parts = [f"The best run beside the {record.baseline.name} and the reference θ."]
    if len(record.compared_with) == 1:
        parts = [f"The best run beside the {record.baseline.name}."]
    if any(c.target is not None and c.band is not None for c in channels):
        parts.append("Shaded: the accepted band around the target.")
    if any(isfinite(c.low) or isfinite(c.high) for c in channels):
        parts.append("Dashed: limits.")
    stopped = any(e.end.interrupted for e in curves)
    parts.append(
        "A dot ends a run, a cross an interrupted one." if stopped else "A dot ends a run."
    )
    return " ".join(parts)


def _course_caption(record: Record) -> str:
    """Return the caption of the course: it names only what is drawn."""
    objectives = " Green: the objectives." if draws_objectives(record) else ""
    further = any(c.query.further for c in record.asked)
    follow = " Hollow squares: follow-up comparisons of earlier experiments." if further else ""
    return (
        "KPIs of each experiment and of the best so far, in the order tried, and the answers."
        f"{objectives}{follow}"
    )


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
        f"{k.title} {measured(k, record.before.experiment)} to "
        f"{measured(k, record.best.experiment)} {k.unit}".rstrip()
        for k in drawn_kpis(record)
    ]
    return (
        f"Plots of the KPIs of {len(record.trials)} experiments, and of the verdicts: {verdicts}. "
        f"From the {record.baseline.name} to the best: {', '.join(kpis) or 'no KPI differs'}."
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
        _best_caption,
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
        _course_caption,
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
        "The cost that the agent has learned, cut through the best θ. The agent learns from the "
        "answers alone, unless it gets scores. The cost has no unit: only its order has a meaning.",
        _slices_alt,
        slices,
        lambda record: record.surrogate is not None,
    ),
    Picture(
        "final_performance.png",
        "By preferences and fully automated",
        "The result of calibration by preferences, beside the result of minimizing a "
        "predefined index.",
        _pair_alt,
        _side_by_side,
        lambda record: (
            bool(record.scenario.panels)
            and record.scenario.cost is not None  # otherwise nothing can be automated
            and automated(record) is not None
            and not record.scored  # otherwise both sides would be automated
        ),
    ),
)
