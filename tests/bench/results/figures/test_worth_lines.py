"""Curves of worth: what is on their axes."""

import numpy as np
import pytest

from prefcal_bench.results import figures
from prefcal_bench.results.curves import curves_of, frame_of
from prefcal_bench.results.figures import looks
from prefcal_bench.results.statistics import random_search
from prefcal_bench.results.tables import Worths
from support.worths import study, walks


def worths_of(results):
    curves = curves_of(frame_of(results))
    return Worths(curves, "GLISp")


def drawn(draw, results):
    worths = worths_of(results)
    figure = draw(worths, worths.curves.settings[0], looks(worths.curves.agents))
    return figure, panels(figure)


def panels(figure):
    return {axes.get_title(loc="left"): axes for axes in figure.axes if axes.axison}


def line(axes, label):
    (found,) = [one for one in axes.lines if one.get_label() == label]
    return found


def test_there_is_a_panel_for_each_loop_and_all_have_one_scale():
    figure, found = drawn(figures.worth_by_experiments, walks({"GLISp": 1.3, "Own": 1.0}, n_max=12))
    assert list(found) == ["servo", "steering", "boost"]
    assert len({axes.get_ylim() for axes in found.values()}) == 1
    assert {axes.get_yscale() for axes in found.values()} == {"log"}
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["GLISp", "Own", "random search, in theory", "initial samples"]


def test_a_line_is_the_geometric_mean_beside_that_of_random_search():
    _, found = drawn(
        figures.worth_by_experiments, [study(seed=s, worth=(2, 8 * s + 8)) for s in (0, 1)]
    )
    assert line(found["servo"], "GLISp").get_ydata() == pytest.approx([2, 128**0.5])
    theory = next(one for one in found["servo"].lines if one.get_linewidth() > 3)
    assert theory.get_ydata() == pytest.approx([random_search(1), random_search(2)])


def test_worth_is_shown_at_the_answer_that_it_cost():
    asking = [study(worth=(2, 4, 8), questions=(0, 2, 4)), study("Own", worth=(2, 4, 8))]
    _, found = drawn(figures.worth_by_answers, asking)
    assert line(found["servo"], "GLISp").get_ydata() == pytest.approx([2, 2, 4, 4, 8])
    assert line(found["servo"], "Own").get_ydata() == pytest.approx([2, 4, 8])


def test_an_agent_that_is_told_values_is_a_dashed_line_at_its_end():
    results = [study(), study("GLIS", worth=(3, 9), questions=(0, 0))]
    figure, found = drawn(figures.worth_by_answers, results)
    assert line(found["servo"], "GLIS").get_ydata() == pytest.approx([9, 9])
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "sees values: at the end" in labels


def test_an_agent_that_asks_very_often_ends_at_the_edge():
    often = study("Own", worth=(2, 4, 8), questions=(0, 20, 40))
    _, found = drawn(figures.worth_by_answers, [study(worth=(2, 4, 8)), often])
    assert line(found["servo"], "Own").get_xdata().max() == 2 * 3


def test_the_bar_of_drift_leads_from_the_end_to_the_best_before():
    results = [study(worth=(2, 32, 8)), study(loop="boost", worth=(2, 2, 8))]
    worths = worths_of(results)
    curves = worths.curves
    axes = panels(figures.along(worths, curves.settings, looks(curves.agents)))["weights"]
    assert line(axes, "GLISp").get_ydata() == pytest.approx([2, 8, 8])
    (bar,) = axes.collections
    low, high = bar.get_segments()[0][:, 1]
    assert (low, high) == (pytest.approx(8), pytest.approx(16))


def test_ticks_are_plain_numbers_of_which_there_are_two_or_more():
    for top in (3.0, 40.0, 4000.0):
        _, found = drawn(figures.worth_by_experiments, [study(worth=(1.5, top))])
        axes = found["servo"]
        assert 2 <= len(axes.get_yticks()) <= 8
        assert all(float(t) >= 1 for t in axes.yaxis.get_major_formatter().format_ticks([1, 300]))


def test_many_agents_have_thin_lines_and_the_baseline_a_thick_one():
    agents = {"GLISp": 1.2, **{f"own{k}.py:A": 1.0 for k in range(9)}}
    _, found = drawn(figures.worth_by_experiments, walks(agents, ("servo",), seeds=2, n_max=5))
    widths = {a: line(found["servo"], a).get_linewidth() for a in agents}
    assert widths.pop("GLISp") > max(widths.values())
    assert np.ptp(list(widths.values())) == 0
