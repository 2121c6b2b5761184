"""Two runs side by side stay readable, however many knobs there are."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from prefcal_app import figure
from prefcal_scenarios import load
from prefcal_scenarios.wording import number


@pytest.mark.parametrize("name", ["servo", "cstr"])
def test_theta_stays_above_its_own_half_and_leaves_room_for_curves(name):
    scenario = load(name)
    low, high = (scenario.run(scenario.space.decode(np.full(len(scenario.space), z))) for z in (0.37, 0.53))
    drawn = figure(scenario, low, high)
    canvas = FigureCanvasAgg(drawn)
    canvas.draw()
    width = drawn.bbox.width
    left, right = drawn.axes[:2]
    for axes, end in ((left, right.get_window_extent().x0), (right, width)):
        assert axes.get_window_extent().width > 0.35 * width
        texts = [t for t in axes.texts if "=" in t.get_text()]
        assert len(texts) == 1
        assert texts[0].get_window_extent().x1 <= end
        assert texts[0].get_text().count("=") == len(scenario.space)


def test_a_varied_plant_has_a_target_of_its_own():
    scenario = load("lag")
    nominal = scenario.run(scenario.space.decode(np.full(len(scenario.space), 0.5)))
    (level,) = nominal.channels.y
    other = replace(level, target=-2.0 * level.target)
    varied = replace(nominal, channels=replace(nominal.channels, y=(other,)))
    for own, end in ((False, level.target), (True, other.target)):
        drawn = figure(scenario, nominal, varied, own=own)
        shown = [
            f"target {number(end)}" in axes.get_title("left") for axes in drawn.axes if axes.get_visible()
        ]
        assert sum(shown) == (1 if own else 2)
