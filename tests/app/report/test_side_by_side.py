"""Two runs side by side stay readable, however many knobs there are."""

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from prefcal_app import figure
from prefcal_scenarios import load


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
