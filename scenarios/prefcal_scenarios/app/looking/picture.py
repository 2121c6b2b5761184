"""Draw two runs over each other, a panel per signal."""

from matplotlib.figure import Figure

from prefcal_scenarios.app.presentation.style import BEST, OTHERS
from prefcal_scenarios.app.presentation.wording import printable
from prefcal_scenarios.app.report.trajectories import Curve, overlaid

from .pair import Pair


def picture(pair: Pair) -> Figure:
    """Draw both runs over each other; references are dotted."""
    looks = ((BEST, "-"), (OTHERS[0], (0, (5, 1.6))))
    return overlaid(
        pair.panels,
        [
            Curve(run.experiment, printable(run.name).replace("$", r"\$"), color, 1.7, dashes)
            for run, (color, dashes) in zip((pair.left, pair.right), looks, strict=True)
        ],
    )
