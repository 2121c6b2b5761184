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


def test_three_reasons_of_a_worst_run_stand_under_curves_that_keep_their_size():
    scenario = load("lag")
    made = scenario.run(scenario.space.decode(np.full(len(scenario.space), 0.5)))
    names = ("settling time of temperature (within ±5 %)", "recovery time of temperature (within ±5 %)")
    reasons = "; ".join([f"{name} is infinite" for name in names] + ["overshoot misses its objective"])
    sizes = []
    for below in ("", f"Worst run 1: {reasons}."):
        drawn = figure(scenario, made, made, ("nominal", "worst run 1"), own=True, below=below)
        FigureCanvasAgg(drawn).draw()
        sizes.append([axes.get_window_extent().size for axes in drawn.axes if axes.get_visible()])
    assert np.array(sizes[1]) == pytest.approx(np.array(sizes[0]), rel=0.02)
    (said,) = [text for text in drawn.texts if "Worst run 1" in text.get_text()]
    assert said.get_text().replace("\n", " ").endswith(f"{reasons}.")
    box, whole = said.get_window_extent(), drawn.bbox
    assert box.x0 >= 0
    assert box.x1 <= whole.x1
    assert min(axes.get_window_extent().y0 for axes in drawn.axes if axes.get_visible()) > box.y1
