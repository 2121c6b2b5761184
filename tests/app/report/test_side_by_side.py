"""Two runs side by side stay readable, however many knobs there are."""

from dataclasses import replace
from functools import partial
from itertools import combinations

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from prefcal_app import figure
from prefcal_app.report.pictures import DrawnRun, overlaid, panel_title
from prefcal_env.experiments.experiment import Channel, End
from prefcal_env.plants.plant import Plant
from prefcal_scenarios import load
from prefcal_scenarios.described.pid_scenario import pid_scenario
from prefcal_scenarios.described.steps import Mark
from prefcal_scenarios.scenario import panels_of
from prefcal_scenarios.style import GOOD, LIMIT, WIDTH, style
from prefcal_scenarios.verification.result import VerifiedRun
from prefcal_scenarios.verification.varied_runs import replays
from prefcal_scenarios.wording import number


def over_each_other(scenario, *runs):
    """Both runs over each other, as the report draws the best one."""
    curves = [DrawnRun(run, str(k), GOOD) for k, run in enumerate(runs)]
    return overlaid(partial(panels_of, scenario), curves)


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


@pytest.mark.parametrize("wide", [112 / 25.4, WIDTH, None])
def test_long_titles_are_whole_and_touch_no_other_text(wide):
    """The load comes late, so that the time is split: beside each other, as on the sheet (in inches)."""
    valve = Channel("position of the steam valve of line 2", "%", low=0, high=100)
    out = Channel("temperature behind the second heat exchanger", "°C")
    plant = Plant.of(([0.8], [20.0, 1.0]), delay=6.0, inputs=[valve], outputs=[out])
    scenario = pid_scenario(plant, horizon=1500.0)
    both = [scenario.run(scenario.references[name]) for name in ("MIGO", "SIMC")]
    curves = [DrawnRun(run, str(k), GOOD) for k, run in enumerate(both)]
    draws = partial(panels_of, scenario)
    with style():
        drawn = figure(scenario, *both) if wide is None else overlaid(draws, curves, most=2.44, width=wide)
        FigureCanvasAgg(drawn).draw()
    shown = [axes for axes in drawn.axes if axes.get_visible()]
    assert len(shown) == (8 if wide is None else 4)
    titles = [axes.get_title("left").replace("\n", " ") for axes in shown]
    assert titles.count(f"{valve.name} [%] · limits 0 to 100") == (4 if wide is None else 1)
    texts = [axes._left_title for axes in shown if axes.get_title("left")]
    boxes = [t.get_window_extent() for t in (*texts, *(t for axes in shown for t in axes.texts))]
    assert all(box.x1 <= drawn.bbox.width for box in boxes)
    assert not any(a.overlaps(b) for a, b in combinations(boxes, 2))


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


def test_a_run_with_another_step_is_drawn_with_the_target_it_had():
    plant = Plant.of(
        ([1.6], [40.0, 1.0]), delay=7.0, inputs=[Channel("valve", "%", 0, 100)], outputs=[Channel("T", "°C")]
    )
    scenario = pid_scenario(plant, reference={"T": 100.0})
    theta = scenario.references["MIGO"]
    values = {"size of the step": 0.85, "start": 0.1, "sign of the step": -1.0}
    runs = [VerifiedRun(v, 0, End.TIME_UP, {}) for v in ({}, values)]
    nominal, varied = replays(scenario, theta, runs)
    start = nominal.output(0)[0]
    end = start + 0.1 * (100.0 - start) - 0.85 * (100.0 - start)  # as the factors say
    assert end != pytest.approx(100.0, abs=1.0)
    drawn = figure(scenario, nominal, varied, ("nominal", "worst run 1"), own=True)
    outputs = [axes for axes in drawn.axes if "T [°C]" in axes.get_title("left")]
    titles = [axes.get_title("left") for axes in outputs]
    assert titles == ["T [°C] · target 100", f"T [°C] · target {number(end)}"]
    drawn_at = [line.get_ydata()[0] for axes in outputs for line in axes.lines if line.get_color() == GOOD]
    assert drawn_at == pytest.approx([100.0, end])


def test_stated_limits_are_drawn_in_each_picture_where_they_are_in_its_run():
    scenario = pid_scenario(Plant.of(([1.6], [40.0, 1.0]), delay=7.0, outputs=["T"]))
    made, end = scenario.run(scenario.references["MIGO"]), np.inf
    marks = {
        "nominal": [Mark("T", 3.0, 3.0, 0.0, 9.0), Mark("T", 1.0, 2.0), Mark("T", -end, end, 5.0, 5.0)],
        "worst run 1": [Mark("T", 4.0, 4.0, 0.0, 9.0)],
    }
    drawn = figure(scenario, made, made, ("nominal", "worst run 1"), own=True, marks=marks)
    lines = [
        [(*line.get_xdata(), *line.get_ydata()) for line in axes.lines if line.get_color() == LIMIT]
        for axes in drawn.axes
        if axes.get_title("left").startswith("T")
    ]
    assert lines == [[(0.0, 9.0, 3.0, 3.0), (5.0, 5.0, 0, 1)], [(0.0, 9.0, 4.0, 4.0)]]
    (band,) = (patch for axes in drawn.axes for patch in axes.patches)
    assert band.get_extents().width > 0


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


@pytest.mark.parametrize("name", ["MEAN SQUARED COOLANT COMMAND", "recovery time of coolant temperature"])
def test_no_line_under_a_picture_is_cut_off(name):
    scenario = load("lag")
    made = scenario.run(scenario.space.decode(np.full(len(scenario.space), 0.5)))
    drawn = figure(scenario, made, made, below="; ".join([f"{name} misses its objective"] * 9))
    FigureCanvasAgg(drawn).draw()
    (said,) = [text for text in drawn.texts if "misses" in text.get_text()]
    assert 0 <= said.get_window_extent().x0 < said.get_window_extent().x1 <= drawn.bbox.x1


def test_titles_of_panels_keep_names_as_they_are_written():
    assert panel_title(Channel("pH", target=7.0)) == "pH · target 7"
    assert panel_title(Channel("rpm of x", "1/min")) == "rpm of x [1/min]"


def test_a_band_is_a_share_of_the_target_only_where_that_is_a_plain_number():
    bands = [(2.0, 0.06), (65.0, 0.75), (0.0, 0.5), (-4.0, 1.0), (1.0, 1.5)]
    titles = [panel_title(Channel("T", target=target, band=band)) for target, band in bands]
    assert [title.rpartition("target ")[2] for title in titles] == [
        "2 ± 3 %",
        "65 ± 0.75",
        "0 ± 0.5",
        "−4 ± 25 %",
        "1 ± 1.5",
    ]


@pytest.mark.parametrize("draw", [figure, over_each_other])
def test_a_slow_study_is_drawn_where_it_moves(draw):
    plant = Plant.of(
        ([1.6], [40.0, 1.0]), delay=7.0, inputs=[Channel("valve", "%", 0, 100)], outputs=[Channel("T", "°C")]
    )
    usual, slow = (pid_scenario(plant, reference={"T": 100.0}, horizon=h) for h in (None, 28_800.0))
    found = []
    for scenario in (usual, slow):
        made = scenario.run(scenario.references["MIGO"])
        drawn = draw(scenario, made, made)
        axes = [each for each in drawn.axes if each.get_visible()]
        found.append({each.get_xlim(): each.get_xlabel() for each in axes if each.get_xlabel()})
    (whole,) = found[0].items()
    assert whole[0][1] > 380
    assert whole[1] == "time [s]"
    step, load = found[1]
    assert step[0] == 0
    assert 50 < step[1] < 300  # it settles to 5 % after about 60 s, and 2 % after the load of 14,400 s
    assert load[0] < 14_400 < load[1] < 14_700
    assert set(found[1].values()) == {"time [s]"}
    assert drawn.get_supxlabel() == "Of 28800 s, what is not shown hardly moves."
