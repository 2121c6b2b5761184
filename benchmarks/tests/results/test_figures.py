"""Figures: what is on their axes, and that something is on their pixels."""

from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from bench_support.campaigns import ends, grid, result
from bench_support.worths import study, walks
from prefcal_agents.registry import AGENTS as REGISTRY
from prefcal_bench.cells.roster import AGENTS
from prefcal_bench.results import figures
from prefcal_bench.results.campaign import campaign_of
from prefcal_bench.results.drawing import agent_styles, drawn, line_options
from prefcal_bench.results.rows import worth_rows
from prefcal_bench.results.statistics import random_search
from prefcal_scenarios.style import png, style

FACTORS = {"GLISp": 1.0, "Own": 3.0, "RandomSearch": 100.0}


@pytest.fixture(autouse=True)
def house_style():
    with style():
        yield


def pixels(figure):
    return np.array(Image.open(BytesIO(png(figure))).convert("RGB"))


def draw(results, value="gap", unit="experiments"):
    """The figure, and its panels by title."""
    campaign = campaign_of(results)
    figure = figures.against(campaign, campaign.settings[0], value, unit, "GLISp")
    return figure, {axes.get_title(loc="left"): axes for axes in figure.axes if axes.axison}


def panel(results, *given):
    """The only panel."""
    (axes,) = draw(results, *given)[1].values()
    return axes


def line(axes, label):
    (found,) = [one for one in axes.lines if one.get_label() == label]
    return found


def legend(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


def texts(axes):
    return [text.get_text() for text in axes.texts]


def test_there_is_one_panel_for_each_problem_and_one_line_for_each_agent():
    _, found = draw(grid(FACTORS))
    assert list(found) == ["bowl, 2 knobs", "valley, 3 knobs", "waves, 4 knobs"]
    for axes in found.values():
        assert {one.get_label() for one in axes.lines} >= set(FACTORS)
        assert axes.get_yscale() == "log"


def test_a_line_is_the_median_and_its_band_the_quartiles():
    axes = panel([result("A", "p", s, (8.0, 4.0, g)) for s, g in enumerate((1.0, 2.0, 4.0))])
    assert line(axes, "A").get_xdata().tolist() == [1, 2, 3]
    assert line(axes, "A").get_ydata().tolist() == [8, 4, 2]
    (band,) = [c for c in axes.collections if type(c).__name__.startswith("FillBetween")]
    vertices = band.get_paths()[0].vertices
    at_the_end = vertices[vertices[:, 0] == 3][:, 1]
    assert (at_the_end.min(), at_the_end.max()) == (1.5, 3.0)


def test_looks_do_not_depend_on_the_order_and_differ():
    names = ["GLISp", "GLISp.paper", "GLIS", "Own", "Peer", "PPO", "SAC", "RandomSearch"]
    found = agent_styles(names)
    assert found == agent_styles(reversed(names))
    assert len({style.color for style in found.values()}) == len(names)
    assert len({style.marker for style in found.values()}) == len(names)
    many = agent_styles([f"agent {i}" for i in range(20)])
    assert len(set(many.values())) == 20


def test_every_agent_of_the_project_has_a_look_of_its_own():
    looks = agent_styles([*AGENTS, "mine.py:Mine"])
    for row in REGISTRY:
        assert agent_styles([row.name]) == {row.name: looks[row.name]}, "it is that of others, too"
    assert len(set(looks.values())) == len(looks)
    assert line_options(looks["Screening"])["markersize"] > 4  # a star of 4 points is not seen


def test_gaps_at_the_floor_are_at_the_lower_end_which_says_so():
    axes = panel([*ends("A", "p", [0.0]), *ends("B", "p", [0.1])])
    bottom = axes.get_ylim()[0]
    assert line(axes, "A").get_ydata()[-1] == pytest.approx(bottom)
    assert bottom > 1e-3
    label = axes.yaxis.get_major_formatter()(axes.yaxis.get_majorticklocs()[0], 0)
    assert label == "≤$10^{-9}$"


@pytest.mark.parametrize("low", [0.9, 0.11, 3e-5])
def test_there_are_two_ticks_or_more_however_narrow_the_range(low):
    axes = panel([result("A", "p", 0, (1.0, low, low))])
    low_end, high_end = axes.get_ylim()
    inside = [t for t in axes.yaxis.get_majorticklocs() if low_end <= t <= high_end]
    assert 2 <= len(inside) <= 7


def test_infinite_gaps_are_not_drawn():
    inf = float("inf")
    axes = panel([result("A", "p", s, (inf, inf, 0.5)) for s in range(2)])
    values = line(axes, "A").get_ydata()
    assert np.isnan(values[:2]).all()
    assert values[2] == 0.5
    everywhere, _ = draw([result("A", "p", 0, (inf, inf, inf))])
    assert pixels(everywhere).size


@pytest.mark.parametrize("value", ["gap", "worth"])
def test_values_are_shown_at_the_answer_that_they_cost(value):
    held, asked = (8.0, 4.0, 2.0), (0, 2, 4)
    made = {
        "gap": result("A", "p", 0, held, questions=asked),
        "worth": study("A", "p", worth=held, questions=asked),
    }
    drawn_line = line(panel([made[value]], value, "answers"), "A")
    assert drawn_line.get_xdata().tolist() == [0, 1, 2, 3, 4]
    assert drawn_line.get_ydata() == pytest.approx([8, 8, 4, 4, 2])


def test_an_agent_that_sees_values_is_a_dashed_line_at_its_end():
    seeing = [result("GLIS", "p", s, (1.0, 0.5, 0.25), questions=(0, 0, 0)) for s in range(2)]
    figure, found = draw([*seeing, result("GLISp", "p", 0, (1.0, 0.4, 0.3))], "gap", "answers")
    assert set(line(found["p, 2 knobs"], "GLIS").get_ydata()) == {0.25}
    assert legend(figure) == ["GLISp", "GLIS", "sees values: at the end"]


def test_an_agent_that_asks_very_often_ends_at_the_edge():
    often = study("Own", worth=(2, 4, 8), questions=(0, 20, 40))
    axes = panel([study(worth=(2, 4, 8)), often], "worth", "answers")
    assert line(axes, "Own").get_xdata().max() == 2 * 3


def test_worth_has_a_panel_for_each_loop_and_all_have_one_scale():
    figure, found = draw(walks({"GLISp": 1.3, "Own": 1.0}, n_max=12), "worth")
    assert list(found) == ["servo", "steering", "boost"]
    assert len({axes.get_ylim() for axes in found.values()}) == 1
    assert {axes.get_yscale() for axes in found.values()} == {"log"}
    assert legend(figure) == ["GLISp", "Own", "random search, in theory", "initial samples"]


def test_a_line_of_worth_is_the_geometric_mean_beside_that_of_random_search():
    axes = panel([study(seed=s, worth=(2, 8 * s + 8)) for s in (0, 1)], "worth")
    assert line(axes, "GLISp").get_ydata() == pytest.approx([2, 128**0.5])
    theory = next(one for one in axes.lines if one.get_linewidth() > 3)
    assert theory.get_ydata() == pytest.approx([random_search(1), random_search(2)])


def test_the_bar_of_drift_leads_from_the_end_to_the_best_before():
    campaign = campaign_of([study(worth=(2, 32, 8)), study(loop="boost", worth=(2, 2, 8))])
    figure = figures.along(campaign, campaign.settings)
    axes = figure.axes[0]
    assert line(axes, "GLISp").get_ydata() == pytest.approx([2, 8, 8])
    (bar,) = axes.collections
    low, high = bar.get_segments()[0][:, 1]
    assert (low, high) == (pytest.approx(8), pytest.approx(16))


@pytest.mark.parametrize("top", [3.0, 40.0, 4000.0])
def test_ticks_of_worth_are_plain_numbers_of_which_there_are_two_or_more(top):
    axes = panel([study(worth=(1.5, top))], "worth")
    assert 2 <= len(axes.get_yticks()) <= 8
    assert all(float(t) >= 1 for t in axes.yaxis.get_major_formatter().format_ticks([1, 300]))


def test_many_agents_have_thin_lines_and_the_baseline_a_thick_one():
    agents = {"GLISp": 1.2, **{f"own{k}.py:A": 1.0 for k in range(9)}}
    axes = panel(walks(agents, ("servo",), seeds=2, n_max=5), "worth")
    widths = {a: line(axes, a).get_linewidth() for a in agents}
    assert widths.pop("GLISp") > max(widths.values())
    assert np.ptp(list(widths.values())) == 0


def summarized(results):
    campaign = campaign_of(results)
    return figures.summary(campaign, worth_rows(campaign), campaign.settings)


def test_the_summary_is_sorted_by_worth_which_is_written_beside_it():
    results = [study(a, seed=s, worth=(1, w + s)) for a, w in (("GLISp", 20), ("Own", 300)) for s in range(3)]
    axes = summarized(results).axes[0]
    assert [t.get_text() for t in axes.get_yticklabels()] == ["Own", "GLISp"]
    assert [text.split()[0] for text in texts(axes)] == ["301", "21"]
    assert axes.get_xscale() == "log"


def test_a_dashed_line_is_at_the_worth_of_random_search():
    axes = summarized(walks({"GLISp": 1.2}, n_max=50, seeds=2)).axes[0]
    (theory,) = [one for one in axes.lines if one.get_linestyle() == "--"]
    assert theory.get_xdata()[0] == pytest.approx(random_search(50))


def test_the_label_tells_every_number_of_experiments_and_its_theory():
    results = [*walks({"GLISp": 1.2}, n_max=20), *walks({"GLISp": 1.2}, n_max=50)]
    label = summarized(results).get_supxlabel()
    assert "after 20 and 50 experiments" in label
    assert "in theory, 37 and 90;" in label


def test_the_marker_of_an_agent_that_sees_values_is_hollow():
    axes = summarized([study(), study("GLIS", questions=(0, 0))]).axes[0]
    faces = {one.get_markerfacecolor() for one in axes.lines if one.get_marker() not in ("", "None")}
    assert "white" in faces
    assert len(faces) == 2


def test_each_setting_has_a_panel_and_all_have_one_scale():
    figure = summarized(walks({"GLISp": 1.2}, tastes=("weights", "limits", "narrow")))
    shown = [axes for axes in figure.axes if axes.axison]
    assert len(shown) == 3
    assert len({axes.get_xlim() for axes in shown}) == 1


@pytest.mark.parametrize("name", [r"a$\frac{", "_hidden", "x\x1b[2J\ny"])
def test_a_strange_name_is_drawn_as_it_stands(name):
    figure, _ = draw([result(name, "p", 0, (1.0, 0.1)), result("B", "p", 0, (1.0, 0.2))])
    assert pixels(figure).std() > 1
    assert drawn(name) in legend(figure)


def test_every_agent_of_the_roster_has_a_look_that_can_be_drawn_as_wide_as_a_page():
    image = pixels(draw([result(agent, "p", 0, (1.0, 0.1)) for agent in AGENTS])[0])
    assert image.std() > 1
    assert 1000 <= image.shape[1] <= 1400
    blue = np.abs(image.astype(int) - [10, 102, 194]).sum(axis=2) < 20  # that of GLISp
    assert blue.sum() > 50
