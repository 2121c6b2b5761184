from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefcal_app.view.question import curve, curves_view, panel_view
from prefcal_env.experiments.experiment import Channel
from prefcal_env.experiments.panels import Panel, Plot
from prefcal_scenarios.scenario import panels_of
from support.looks import LEVEL, THETA, VALVE, plain, run, toy

values = st.lists(st.floats(-1e6, 1e6).map(lambda v: round(v, 3)), min_size=1, max_size=60).map(np.array)


def test_a_scenario_without_panels_gets_one_for_each_state_and_input():
    panels = panels_of(plain, run(THETA))
    assert [(p.kind, p.channel.name) for p in panels] == [("x", "level <h>"), ("u", "valve")]
    assert panels_of(toy, run(THETA)) == panels


def test_inputs_are_steps_states_are_lines_and_no_limit_is_infinite():
    level, valve = panel_view(LEVEL), panel_view(VALVE)
    assert (level["shape"], level["low"], level["high"]) == ("line", None, None)
    assert (valve["shape"], valve["low"], valve["high"]) == ("step", 0.0, 10.0)
    assert level["title"] == "level h"
    assert panel_view(Plot(Channel("T", symbol="T"), "x", "T"))["title"] == "T"  # not said twice


@given(y=values)
def test_a_held_curve_keeps_its_ends_and_every_value_it_takes(y):
    t = np.arange(len(y), dtype=float)
    drawn = curve(t, y, held=True)
    assert (drawn["t"][0], drawn["t"][-1]) == (0.0, t[-1])
    redrawn = np.array(drawn["y"])[np.searchsorted(drawn["t"], t, side="right") - 1]
    np.testing.assert_allclose(redrawn, y, rtol=1e-5)


@given(peak=st.integers(0, 29_999), height=st.floats(2.0, 1e6))
def test_a_long_curve_is_thinned_but_keeps_its_peaks_and_ends(peak, height):
    y = np.sin(np.arange(30_000) / 900)
    y[peak] = height
    drawn = curve(np.arange(30_000.0), y, held=False)
    assert len(drawn["t"]) <= 4100
    assert max(drawn["y"]) == pytest.approx(height, rel=1e-5)
    assert (drawn["t"][0], drawn["t"][-1]) == (0.0, 29_999.0)
    assert np.all(np.diff(drawn["t"]) > 0)


def test_numbers_have_six_digits_and_no_minus_zero():
    drawn = curve(np.array([0.0, 1 / 3]), np.array([-0.0, 2e6 / 3]), held=False)
    assert drawn["t"] == [0.0, 0.333333]
    assert drawn["y"] == [0.0, 666667.0]
    assert str(drawn["y"][0]) == "0.0"


def test_a_reference_that_changes_in_time_has_the_scale_of_its_panel():
    one = run(THETA)
    ordered = np.where(one.t < 10, 1.0, 2.0)
    one = replace(one, signals={"ordered": ordered})
    panel = Panel("level <h>", unit="cm", scale=100.0, reference="ordered")
    (seen,) = curves_view(one, [panel.plot(one)])["references"]
    assert seen is not None
    assert seen["y"] == [100.0, 200.0, 200.0]
    assert curves_view(one, [LEVEL])["references"] == [None]


def test_a_curve_is_told_in_words_with_the_time_from_which_it_stays_in_its_band():
    one = run(THETA)
    outside = np.abs(one.x[:, 0] - 2.0) > 0.06
    since = one.t[np.flatnonzero(outside)[-1] + 1]
    words, others = curves_view(one, [LEVEL, VALVE])["stories"]
    assert words.startswith("level: from 8.5 to 2 m")
    assert f"inside the band around 2 from {since:.4g} h on" in words
    assert "band" not in others


@pytest.mark.parametrize(
    ("level", "words"),
    [(2.0, "inside the band around 2 all the time"), (3.0, "outside the band around 2 at the end")],
)
def test_a_curve_that_never_crosses_its_band_says_so(level, words):
    one = run(THETA)
    flat = replace(one, x=np.full_like(one.x, level))
    assert words in curves_view(flat, [LEVEL])["stories"][0]
