"""Recorded curves become an experiment, or are refused by name and place."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefcal_env import Channel, End, Panel, recorded, tracking_kpis
from prefcal_env.errors import ExperimentError
from prefcal_env.experiments.panels import plots_of

T = np.linspace(0.0, 10.0, 11)
THETA = [1.0, 2.0]


def test_time_and_outputs_are_enough():
    e = recorded(THETA, T, {"level": T})
    assert (e.x.shape, e.u.shape, e.y.shape) == ((11, 0), (11, 0), (11, 1))
    assert np.array_equal(e.output(0), T)
    assert (e.end, e.duration, e.channels.time_unit) == (End.TIME_UP, 10.0, "s")
    assert np.isnan(e.y_ref).all()
    assert dict(e.kpis) == {}


def test_units_limits_bands_and_references_reach_the_channels_and_the_kpis():
    e = recorded(
        THETA,
        T,
        {"level": np.minimum(T, 3.0)},
        {"valve": T},
        {"level": 2.0},
        {"level": "m", "valve": "%"},
        {"valve": (0, None)},
        bands={"level": 0.5},
        time_unit="min",
    )
    assert e.channels.y == (Channel("level", "m", target=2.0, band=0.5),)
    assert e.channels.u == (Channel("valve", "%", low=0.0),)
    assert e.channels.time_unit == "min"
    assert dict(e.kpis) == tracking_kpis(e)
    assert e.kpis["overshoot of level"] == 1.0
    assert e.kpis["total move of valve"] == 10.0


def test_curves_of_several_time_bases_meet_at_the_union_of_their_instants():
    e = recorded(
        1.0,
        None,
        {"level": (T, 2 * T), "flow": ([0.5, 4.5, 8.0], [0.0, 4.0, 4.0])},
        {"valve": ([0.0, 4.0], [1.0, 3.0])},
    )
    assert np.array_equal(e.t, [0.5, 1, 2, 3, 4, 4.5, 5, 6, 7, 8])
    assert np.allclose(e.output(0), 2 * e.t)
    assert np.allclose(e.output(1), np.minimum(e.t - 0.5, 4.0))
    assert np.array_equal(e.u[:, 0], [1, 1, 1, 1, 3, 3, 3, 3, 3, 3])


def test_curves_of_their_own_are_brought_to_the_given_instants():
    e = recorded(1.0, T, {"level": ([-1.0, 11.0], [-1.0, 11.0])}, {"valve": ([0, 2.5], [5, 6])})
    assert np.allclose(e.output(0), T)
    assert np.array_equal(e.u[:, 0], [5, 5, 5, *[6] * 8])


def test_moves_do_not_depend_on_how_densely_outputs_are_logged():
    steps, u = np.arange(0.0, 10.0, 2.0), [0.0, 1.0, 1.0, 4.0, 2.0]
    kpis = []
    for count in (101, 1001):
        t = np.linspace(0.0, 10.0, count)
        e = recorded(1.0, t, {"level": t}, {"valve": (steps, u)})
        assert np.allclose(e.t_control, steps)
        kpis.append(dict(e.kpis))
    assert kpis[0] == kpis[1]
    assert kpis[0]["total move of valve"] == 6.0
    assert kpis[0]["RMS move of valve"] == pytest.approx(np.sqrt((1 + 0 + 9 + 4) / 4))


def test_inputs_logged_with_the_outputs_count_as_decided_at_every_instant():
    e = recorded(1.0, T, {"level": T}, {"valve": np.where(T < 5, 0.0, 1.0)})
    assert np.array_equal(e.t_control, T)


def test_a_reference_that_changes_is_drawn_and_counts():
    e = recorded(1.0, T, {"level": T}, None, {"level": ([0.0, 5.0], [0.0, 5.0])})
    assert e.channels.y[0].target is None
    assert np.array_equal(e.y_ref[:, 0], np.where(T < 5, 0.0, 5.0))
    assert e.kpis["integrated error of level"] == 0 + 1 + 2 + 3 + 4 + 0 + 1 + 2 + 3 + 4
    (plot, *_) = plots_of(e.channels, e.signals)
    assert (plot.name, plot.reference) == ("level", "level ref")
    assert Panel("level").plot(e).reference == "level ref"
    assert Panel("level", "y").plot(e).reference == "level ref"


def test_outputs_are_drawn_above_inputs_if_there_are_no_states():
    e = recorded(1.0, T, {"level": T}, {"valve": T}, signals={"note": T})
    assert [p.name for p in plots_of(e.channels)] == ["level", "valve"]


def test_a_run_that_stopped_ends_with_its_last_finite_row_and_is_unsafe():
    y, u = np.where(T < 7, T, np.nan), np.where(T < 8, T, np.inf)
    e = recorded(1.0, T, {"level": y, "flow": T}, {"valve": u}, {"level": T}, signals={"note": T})
    assert (e.duration, len(e.t), e.end) == (6.0, 7, End.UNSAFE)
    assert np.array_equal(e.signals["note"], T[:7])
    assert recorded(1.0, T, {"level": y}, end=End.TIME_UP).end is End.TIME_UP
    own = recorded(1.0, None, {"level": (T, y), "flow": (T + 0.5, T)})
    assert (own.duration, own.end) == (6.0, End.UNSAFE)


@pytest.mark.parametrize("t", [T, []])
def test_a_run_that_left_nothing_is_failed(t):
    e = recorded(1.0, t, {"level": np.full(len(t), np.nan)}, {"valve": np.ones(len(t))})
    assert (len(e.t), e.end, dict(e.kpis)) == (0, End.FAILED, {})


def test_signals_may_have_gaps():
    e = recorded(1.0, T, {"level": T}, signals={"note": np.full(11, np.nan), "late": ([5, 6], T[:2])})
    assert np.isnan(e.signals["note"]).all()
    assert np.array_equal(np.isfinite(e.signals["late"]), (T >= 5) & (T <= 6))


def test_own_kpis_take_the_place_of_generic_ones():
    assert dict(recorded(1.0, T, {"y": T}, kpis=lambda e: {"peak": e.y.max()}).kpis) == {"peak": 10}
    assert dict(recorded(1.0, T, {"y": T}, {"u": T}, kpis=None).kpis) == {}


def test_columns_and_rows_as_simulators_return_them_are_curves():
    e = recorded(np.ones(1), T.tolist(), {"a": T[:, None], "b": T[None], "c": np.arange(11)})
    assert all(np.array_equal(e.output(j), T) for j in range(3))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"outputs": {}}, "outputs must hold one curve or more"),
        ({"outputs": [T]}, "outputs must be a mapping from names to curves"),
        ({"outputs": {1: T}}, "the name of an output must be text, got 1"),
        ({"outputs": {"level": T[:5]}}, r"output 'level' must have shape \(11,\), as t, got \(5,\)"),
        ({"outputs": {"level": np.ones((11, 2))}}, r"'level' must have shape \(K,\), got \(11, 2\)"),
        ({"outputs": {"level": ["x"] * 11}}, "output 'level' must be numbers, got <U1"),
        ({"outputs": {"level": (T, T[1:])}}, r"shape \(11,\), as its times, got \(10,\)"),
        ({"outputs": {"level": (T[2:], T[2:])}}, "'level' is recorded from 2 to 10 s, but t goes"),
        ({"outputs": {"level": (T[:-2], T[2:])}}, "'level' is recorded from 0 to 8 s, but t goes"),
        ({"outputs": {"level": (T[::-1], T)}}, r"times of output 'level' must increase.*\[1\] = 9"),
        (
            {"outputs": {"level": np.where(T == 4, np.nan, T)}},
            r"output 'level' is nan at index 4 \(t = 4 s\), but 5 at index 5",
        ),
        ({"outputs": {"a": T, "b": np.full(11, np.nan)}}, "output 'b' begins with a value that"),
        ({"inputs": {"level": T}}, r"different names, got \['level'\] more than once"),
        ({"inputs": {"valve": (T[3:], T[3:])}}, "input 'valve' is recorded from 3 to 10 s"),
        ({"reference": {"levle": 2.0}}, "reference names 'levle'; .* Did you mean 'level'"),
        ({"reference": 2.0}, "reference must be a mapping by name"),
        ({"reference": {"level": (T[3:], T[3:])}}, "reference of 'level' is recorded from 3"),
        ({"reference": {"level": np.inf}}, "reference of 'level' must be finite"),
        ({"reference": {"level": "two"}}, "reference of 'level' must be numbers"),
        ({"units": {"speed": "%"}}, "units names 'speed'; there are 'level'"),
        ({"limits": {"level": 3.0}}, r"limits of 'level' must be \(low, high\)"),
        ({"limits": {"level": (2.0, 1.0)}}, "'level': low must be below high"),
        ({"bands": {"valve": 1.0}}, "bands names 'valve'"),
        ({"t": T[::-1]}, r"t must increase, but t\[1\] = 9 s comes after 10 s"),
        ({"t": [0, 1, 1, *T[3:]]}, r"t\[2\] = 1 s comes after 1 s"),
        ({"t": np.where(T == 3, np.nan, T)}, r"t\[3\] is nan"),
        ({"t": np.arange(11).astype("M8[s]")}, "use prefcal_env.from_frame for time stamps"),
        ({"t": None}, "output 'level' needs instants: give t"),
        ({"theta": "x"}, "theta must be numbers"),
        ({"theta": []}, "theta must have shape"),
    ],
)
def test_curves_that_do_not_fit_are_refused_by_name_and_place(change, words):
    given = {"theta": THETA, "t": T, "outputs": {"level": T}} | change
    with pytest.raises(ExperimentError, match=words):
        recorded(**given)


def test_curves_without_a_common_time_are_refused():
    with pytest.raises(ExperimentError, match="output 'a' ends at 1 s, before output 'b' begins at 2"):
        recorded(1.0, None, {"a": ([0, 1], [0, 1]), "b": ([2, 3], [0, 1])})


@given(
    st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=30),
    st.integers(0, 30),
    st.sampled_from([np.nan, np.inf, -np.inf]),
)
def test_what_precedes_the_end_is_kept_exactly(values, cut, nothing):
    t, y = np.arange(len(values)) / 8, np.array(values)
    y[cut:] = nothing
    kept = min(cut, len(values))
    e = recorded(1.0, t, {"level": y}, kpis=None)
    assert np.array_equal(e.y[:, 0], values[:kept])
    assert e.end is (End.TIME_UP if kept == len(values) else End.UNSAFE if kept else End.FAILED)
