"""List and draw the figures of a report, with captions and texts for people who cannot see them."""

from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO

from prefcal_scenarios.presentation.style import save, style
from prefcal_scenarios.presentation.wording import measured, number, theta_text
from prefcal_scenarios.scenario import Picture

from .course import INDEX, course, drawn_kpis, knobs
from .record import StudyRecord
from .trajectories import best_against, curves_of


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
                if not isinstance(made, bytes):
                    save(made, buffer := BytesIO())
                    made = buffer.getvalue()
                words = picture.caption
                caption = words if isinstance(words, str) else words(record)
                drawn.append(Drawn(picture, picture.alt(record), made, caption))
    return drawn


def _best_theta(record: StudyRecord) -> str:
    assert record.best is not None
    return theta_text(record.scenario.space, record.best.experiment.theta)


def _best_alt(record: StudyRecord) -> str:
    assert record.best is not None
    kpis = [
        f"{k.title} {measured(k, record.best.experiment)} {k.unit}".rstrip()
        for k in record.kpis
        if k.name in record.best.experiment.kpis
    ]
    against = ", ".join(record.compared_with)
    return (
        f"Time plots of the best run ({_best_theta(record)}) against the {against}. Best: {', '.join(kpis)}."
    )


def _course_alt(record: StudyRecord) -> str:
    assert record.best is not None
    kpis = []
    for kpi in drawn_kpis(record):
        sides = (record.before, record.best)
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
        "The best run beside what it is compared with. Shaded: the accepted band around a target. "
        "Dashed: limits. A dot ends a run, a cross an interrupted one.",
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
