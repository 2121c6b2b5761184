"""Define the overtaking's figures in the report: animation, comparison, best run alone."""

from prefcal_scenarios.app.presentation.wording import number, theta_text
from prefcal_scenarios.app.report.record import Record
from prefcal_scenarios.scenario import Picture

from .figures import comparison, final
from .film import gif
from .player import player


def _film_alt(record: Record) -> str:
    return f"Animation seen from above: the best run overtakes the obstacle. {_best(record)}"


def _film_caption(record: Record) -> str:
    above = f"above the {record.baseline.name}, " if _improved(record) else ""
    return (
        f"The best run {above}in real time, to scale. The obstacle is orange. "
        "The same as a file: overtaking.gif."
    )


def _comparison_alt(record: Record) -> str:
    assert record.best is not None
    return (
        "Path with the vehicles at five moments, speed and steering angle along the road: the "
        f"best run to the left, the {record.baseline.name} to the right. {_best(record)}"
    )


def _final_alt(record: Record) -> str:
    return (
        "Path with the vehicles at five moments, speed and steering angle along the road, of the "
        f"best run. {_best(record)}"
    )


def _best(record: Record) -> str:
    assert record.best is not None
    experiment = record.best.experiment
    kpis = experiment.kpis
    return (
        f"Best: {theta_text(record.scenario.space, experiment.theta)}; worst t_comp "
        f"{number(kpis['t_comp_worst'])} s, smallest lateral distance beside the obstacle "
        f"{number(kpis['lateral_distance'])} m, largest y_f {number(kpis['path_peak'])} m."
    )


def _improved(record: Record) -> bool:
    """Return whether the best run is not the one that it is compared with."""
    return record.best is not None and record.best.index != record.before.index


PICTURES: tuple[Picture, ...] = (
    Picture(
        "overtaking.gif",
        "The overtaking",
        _film_caption,
        _film_alt,
        gif,
        markup=player,
    ),
    Picture(
        "comparison.png",
        "Best run and the one before along the road",
        "Numbers mark five moments of the overtaking; the roads below show both vehicles there, "
        "to scale. Limits and reference of the speed change with the phase. t_comp is "
        "modeled.",
        _comparison_alt,
        comparison,
        _improved,
    ),
    Picture(
        "final_run.png",
        "The best run along the road",
        "Numbers mark five moments, as far as the run reached them; limits and reference of the "
        "speed change with the phase.",
        _final_alt,
        final,
    ),
)
"""Pictures in the order of the page."""
