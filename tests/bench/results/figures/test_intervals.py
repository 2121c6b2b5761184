"""Figures with a row for each agent: final worth, and who beats the baseline."""

import numpy as np
import pytest

from prefcal_bench.results import figures
from prefcal_bench.results.curves import curves_of, frame_of
from prefcal_bench.results.figures import looks
from prefcal_bench.results.statistics import random_search
from prefcal_bench.results.tables import Worths
from support.worths import study, walks


def material(results):
    curves = curves_of(frame_of(results))
    return Worths(curves, "GLISp"), curves.settings, looks(curves.agents)


def texts(axes):
    return [text.get_text() for text in axes.texts]


def test_the_summary_is_sorted_by_worth_which_is_written_beside_it():
    results = [study(a, seed=s, worth=(1, w + s)) for a, w in (("GLISp", 20), ("Own", 300))
               for s in range(3)]  # fmt: skip
    axes = figures.summary(*material(results)).axes[0]
    assert [t.get_text() for t in axes.get_yticklabels()] == ["Own", "GLISp"]
    assert [text.split()[0] for text in texts(axes)] == ["301", "21"]
    assert axes.get_xscale() == "log"


def test_a_dashed_line_is_at_the_worth_of_random_search():
    axes = figures.summary(*material(walks({"GLISp": 1.2}, n_max=50, seeds=2))).axes[0]
    (theory,) = [one for one in axes.lines if one.get_linestyle() == "--"]
    assert theory.get_xdata()[0] == pytest.approx(random_search(50))


def test_the_label_tells_every_number_of_experiments_and_its_theory():
    results = [*walks({"GLISp": 1.2}, n_max=20), *walks({"GLISp": 1.2}, n_max=50)]
    label = figures.summary(*material(results)).get_supxlabel()
    assert "after 20 and 50 experiments" in label
    assert "in theory, 37 and 90;" in label


def test_the_marker_of_an_agent_that_sees_values_is_hollow():
    axes = figures.summary(*material([study(), study("GLIS", questions=(0, 0))])).axes[0]
    faces = {
        one.get_markerfacecolor() for one in axes.lines if one.get_marker() not in ("", "None")
    }
    assert "white" in faces
    assert len(faces) == 2


def test_each_setting_has_a_panel_and_all_have_one_scale():
    figure = figures.summary(
        *material(walks({"GLISp": 1.2}, tastes=("weights", "limits", "narrow")))
    )
    shown = [axes for axes in figure.axes if axes.axison]
    assert len(shown) == 3
    assert len({axes.get_xlim() for axes in shown}) == 1


def test_the_heat_map_is_bold_where_the_interval_excludes_an_even_chance():
    results = [study(a, seed=s, worth=(1, w)) for a, w in (("GLISp", 9), ("Own", 99), ("B", 9))
               for s in range(3)]  # fmt: skip
    worths, settings, _ = material(results)
    axes = figures.improvements(worths, settings).axes[0]
    weights = {t.get_text(): t.get_fontweight() for t in axes.texts if "%" in t.get_text()}
    assert weights == {"100 %": "bold", "50 %": "normal"}
    (image,) = axes.images
    assert np.ma.filled(image.get_array(), np.nan).ravel().tolist() == [0.5, 1.0]


def test_many_settings_have_numbers_alone():
    tastes = [f"taste{k}" for k in range(12)]
    worths, settings, _ = material(walks({"GLISp": 1.2, "Own": 1.0}, tastes=tastes, n_max=5))
    axes = figures.improvements(worths, settings).axes[0]
    assert len(axes.texts) == 12
    assert not any("%" in text for text in texts(axes))
