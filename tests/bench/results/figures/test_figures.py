"""Figures: what is on their axes, and that something is on their pixels."""

from io import BytesIO

import numpy as np
import pytest
from matplotlib.colors import to_hex
from PIL import Image

from prefcal_bench.cells.duels import PAPER
from prefcal_bench.cells.roster import AGENTS
from prefcal_bench.results import figures
from prefcal_bench.results.campaign import campaign_of
from prefcal_bench.results.duelling import tallies
from prefcal_bench.results.figures.drawing import drawn, looks
from prefcal_bench.results.standing import profiles, rank
from prefcal_scenarios.presentation.style import save
from support.campaigns import duel, ends, grid, result

FACTORS = {"GLISp": 1.0, "Own": 3.0, "RandomSearch": 100.0}


def pixels(figure):
    buffer = BytesIO()
    save(figure, buffer)
    return np.array(Image.open(buffer).convert("RGB"))


def against(results, by="experiments"):
    campaign = campaign_of(results)
    draw = {
        "experiments": figures.against_experiments,
        "questions": figures.against_questions,
    }[by]
    return draw(campaign, campaign.settings[0], looks(campaign.agents))


def panels(figure):
    return {axes.get_title(loc="left"): axes for axes in figure.axes if axes.axison}


def line(axes, label):
    (found,) = [one for one in axes.lines if one.get_label() == label and len(one.get_xdata()) > 2]
    return found


def test_there_is_one_panel_for_each_problem_and_one_line_for_each_agent():
    found = panels(against(grid(FACTORS)))
    assert list(found) == ["bowl, 2 knobs", "valley, 3 knobs", "waves, 4 knobs"]
    for axes in found.values():
        assert {one.get_label() for one in axes.lines} >= set(FACTORS)
        assert axes.get_yscale() == "log"


def test_a_line_is_the_median_and_its_band_the_quartiles():
    figure = against([result("A", "p", s, (8.0, 4.0, g)) for s, g in enumerate((1.0, 2.0, 4.0))])
    axes = panels(figure)["p, 2 knobs"]
    assert line(axes, "A").get_xdata().tolist() == [1, 2, 3]
    assert line(axes, "A").get_ydata().tolist() == [8, 4, 2]
    (band,) = [c for c in axes.collections if type(c).__name__.startswith("FillBetween")]
    vertices = band.get_paths()[0].vertices
    at_the_end = vertices[vertices[:, 0] == 3][:, 1]
    assert (at_the_end.min(), at_the_end.max()) == (1.5, 3.0)


def test_an_agent_has_the_same_color_in_every_figure():
    campaign = campaign_of(grid(FACTORS))
    setting, styles = campaign.settings[0], looks(campaign.agents)
    for axes in panels(figures.against_experiments(campaign, setting, styles)).values():
        for agent in FACTORS:
            assert to_hex(line(axes, agent).get_color()) == styles[agent].color
    shares = figures.data_profiles(profiles(campaign, setting), styles)
    ranks = figures.ranking(rank(campaign, setting), styles)
    for agent in FACTORS:
        assert to_hex(line(shares.axes[0], agent).get_color()) == styles[agent].color
        assert styles[agent].color in {to_hex(one.get_color()) for one in ranks.axes[0].lines}


def test_looks_do_not_depend_on_the_order_and_differ():
    names = ["GLISp", "GLISp.paper", "GLIS", "Own", "Peer", "PPO", "SAC", "RandomSearch"]
    found = looks(names)
    assert found == looks(reversed(names))
    assert len({look.color for look in found.values()}) == len(names)
    assert len({look.marker for look in found.values()}) == len(names)
    many = looks([f"agent {i}" for i in range(20)])
    assert len(set(many.values())) == 20


def test_the_path_of_an_own_agent_is_not_drawn():
    assert drawn("somewhere/else/own.py:Mine") == "own.py:Mine"


def test_gaps_at_the_floor_are_at_the_lower_end_which_says_so():
    axes = panels(against([*ends("A", "p", [0.0]), *ends("B", "p", [0.1])]))["p, 2 knobs"]
    bottom = axes.get_ylim()[0]
    assert line_of_two(axes, "A")[-1] == pytest.approx(bottom)
    assert bottom > 1e-3
    label = axes.yaxis.get_major_formatter()(axes.yaxis.get_majorticklocs()[0], 0)
    assert label == "≤$10^{-9}$"


def line_of_two(axes, label):
    (found,) = [one for one in axes.lines if one.get_label() == label]
    return found.get_ydata()


def test_there_are_two_ticks_or_more_however_narrow_the_range():
    for low in (0.9, 0.11, 3e-5):
        axes = panels(against([result("A", "p", 0, (1.0, low, low))]))["p, 2 knobs"]
        low_end, high_end = axes.get_ylim()
        inside = [t for t in axes.yaxis.get_majorticklocs() if low_end <= t <= high_end]
        assert 2 <= len(inside) <= 7


def test_infinite_gaps_are_not_drawn():
    inf = float("inf")
    axes = panels(against([result("A", "p", s, (inf, inf, 0.5)) for s in range(2)]))["p, 2 knobs"]
    values = line(axes, "A").get_ydata()
    assert np.isnan(values[:2]).all()
    assert values[2] == 0.5
    everywhere = against([result("A", "p", 0, (inf, inf, inf))])
    assert pixels(everywhere).size


def test_gaps_are_shown_at_the_question_that_they_cost():
    results = [result("A", "p", s, (4.0, 2.0, 1.0), questions=(0, 2, 5)) for s in range(2)]
    axes = panels(against(results, "questions"))["p, 2 knobs"]
    assert line(axes, "A").get_xdata().tolist() == [0, 1, 2, 3, 4, 5]
    assert line(axes, "A").get_ydata().tolist() == [4, 4, 2, 2, 2, 1]


def test_an_agent_that_sees_values_is_a_line_at_its_end():
    seeing = [result("GLIS", "p", s, (1.0, 0.5, 0.25), questions=(0, 0, 0)) for s in range(2)]
    figure = against([*seeing, result("GLISp", "p", 0, (1.0, 0.4, 0.3))], "questions")
    axes = panels(figure)["p, 2 knobs"]
    (level,) = [one for one in axes.lines if one.get_label() == "GLIS"]
    assert set(level.get_ydata()) == {0.25}
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["GLISp", "GLIS", "sees values: median at the end"]


def test_profiles_have_a_panel_for_each_tolerance_in_percent():
    campaign = campaign_of([result("A", "p", 0, (1.0, 0.05, 0.05))])
    found = profiles(campaign, campaign.settings[0])
    figure = figures.data_profiles(found, looks(campaign.agents))
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert titles == [f"to {p} % of the initial gap" for p in ("10", "1", "0.1")]
    assert line(figure.axes[0], "A").get_ydata().tolist() == [0, 100, 100]
    assert line(figure.axes[1], "A").get_ydata().tolist() == [0, 0, 0]


def test_the_bars_of_a_ranking_are_one_critical_difference_long():
    campaign = campaign_of(grid(FACTORS))
    found = rank(campaign, campaign.settings[0])
    axes = figures.ranking(found, looks(campaign.agents)).axes[0]
    bars = [one for one in axes.lines if len(one.get_xdata()) == 2]
    assert len(bars) == len(FACTORS)
    for bar, average in zip(bars, found.average, strict=True):
        low, high = bar.get_xdata()
        assert high - low == pytest.approx(found.critical)
        assert (low + high) / 2 == pytest.approx(average)
    assert [t.get_text() for t in axes.get_yticklabels()] == ["GLISp", "Own", "RandomSearch"]


def test_a_heat_map_has_shares_and_counts_and_an_empty_diagonal():
    duels = [duel("GLISp", "Own", s, -1 if s < 3 else 1) for s in range(4)]
    duels += [duel("Own", PAPER, s, 0) for s in range(4)]
    figure = figures.heat_map(tallies(duels))
    axes = figure.axes[0]
    texts = {text.get_text() for text in axes.texts}
    assert texts == {"75 %", "3–0–1", "25 %", "1–0–3", "0 %", "0–4–0"}
    (image,) = axes.images
    net = np.ma.filled(image.get_array(), np.nan)
    assert np.array_equal(net, [[np.nan, np.nan, 0.5], [0.0, -0.5, np.nan]], equal_nan=True)


def test_seconds_are_sorted_and_written():
    measured = {"GLISp": [0.02, 0.04], "RandomSearch": [2e-4], "PPO": [0.0]}
    axes = figures.seconds(measured, looks(measured)).axes[0]
    assert [t.get_text() for t in axes.get_yticklabels()] == ["PPO", "RandomSearch", "GLISp"]
    assert {"200 µs", "30 ms"} <= {text.get_text() for text in axes.texts}


@pytest.mark.parametrize("name", [r"a$\frac{", "_hidden", "x\x1b[2J\ny"])
def test_a_strange_name_is_drawn_as_it_stands(name):
    figure = against([result(name, "p", 0, (1.0, 0.1)), result("B", "p", 0, (1.0, 0.2))])
    assert pixels(figure).std() > 1
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert drawn(name) in labels


def test_every_agent_of_the_roster_has_a_look_that_can_be_drawn():
    assert pixels(against([result(agent, "p", 0, (1.0, 0.1)) for agent in AGENTS])).std() > 1


def test_pictures_have_ink_and_the_width_of_a_page():
    campaign = campaign_of(grid(FACTORS, problems=("bowl",)))
    setting, styles = campaign.settings[0], looks(campaign.agents)
    for figure in (
        figures.against_experiments(campaign, setting, styles),
        figures.data_profiles(profiles(campaign, setting), styles),
        figures.seconds({"GLISp": [0.1]}, styles),
    ):
        image = pixels(figure)
        assert 1000 <= image.shape[1] <= 1400
        blue = np.abs(image.astype(int) - [10, 102, 194]).sum(axis=2) < 20  # that of GLISp
        assert blue.sum() > 50
