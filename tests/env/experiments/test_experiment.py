"""Experiments: checked at birth, frozen, equal by value, timings excluded."""

import pickle
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest

from prefcal_env.errors import ExperimentError
from prefcal_env.experiments.experiment import Channel, Channels, End, Experiment, FrozenMapping

CHANNELS = Channels(x=(Channel("position", "m"),), u=(Channel("force", "N"),), y=(Channel("position", "m"),))


def experiment(**changes):
    fields = {
        "theta": np.array([1.0, 2.0]),
        "t": np.array([0.0, 0.5, 1.0]),
        "x": np.array([[0.0], [1.0], [2.0]]),
        "u": np.array([[1.0], [1.0], [0.0]]),
        "t_control": np.array([0.0, 0.5]),
        "u_control": np.array([[1.0], [0.0]]),
        "y_ref": np.zeros((2, 1)),
        "iterations": np.array([3, 4]),
        "solve_time": np.array([1e-4, 2e-4]),
        "solved": np.array([True, True]),
        "channels": CHANNELS,
        "end": End.TIME_UP,
        "kpis": {"peak": 2.0},
        "signals": {"gap": np.array([3.0, 2.0, np.nan])},
    }
    return Experiment(**{**fields, **changes})


def test_equal_by_value_timings_excluded():
    assert experiment() == experiment(solve_time=np.array([9.0, 9.0]))
    assert experiment() != experiment(kpis={"peak": 2.1})
    assert experiment() != experiment(x=np.array([[0.0], [1.0], [2.5]]))
    assert experiment() != experiment(signals={"gap": np.zeros(3)})
    assert experiment() != experiment(end=End.UNSAFE)
    assert experiment() != "experiment"


def test_other_kpis_leave_the_rest_of_an_experiment_as_it_is():
    e = experiment()
    assert e.with_kpis({"peak": 3.0}) == experiment(kpis={"peak": 3.0})
    assert e.kpis == {"peak": 2.0}
    for wrong in (None, {"peak": "high"}, {1: 2.0}):
        with pytest.raises(ExperimentError, match=r"a mapping|a name and a number"):
            e.with_kpis(wrong)


def test_survives_pickling():
    assert pickle.loads(pickle.dumps(experiment())) == experiment()


def test_cannot_be_changed():
    e = experiment()
    with pytest.raises(ValueError, match="read-only"):
        e.x[0, 0] = 1
    with pytest.raises(ValueError, match="read-only"):
        e.signals["gap"][0] = 1
    with pytest.raises(AttributeError):
        e.end = End.UNSAFE
    with pytest.raises(TypeError):
        e.kpis["peak"] = 0.0


def test_does_not_share_the_callers_arrays():
    x = np.array([[0.0], [1.0], [2.0]])
    e = experiment(x=x)
    x[0] = 7
    assert e.x[0, 0] == 0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"x": np.zeros((3, 2))}, r"x must have shape \(3, 1\), got \(3, 2\)"),
        ({"u_control": np.zeros((3, 1))}, r"u_control must have shape \(2, 1\)"),
        ({"signals": {"gap": np.zeros(2)}}, r"signals\['gap'\] must have shape \(3,\)"),
        ({"x": np.array([[0.0], [np.nan], [2.0]])}, "x must be finite"),
        ({"t": np.array([0.0, 0.5, 0.5])}, "t must increase"),
        ({"solved": np.array([True])}, "solved must have shape"),
        ({"theta": np.zeros((2, 2))}, "theta must have shape"),
        ({"theta": np.zeros(0)}, "theta must have shape"),
        ({"end": "settled"}, "end must be one of"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(change, message):
    with pytest.raises(ExperimentError, match=message):
        experiment(**change)


def test_states_at_the_sampling_instants():
    np.testing.assert_array_equal(experiment().at_control(), [[0.0], [1.0], [2.0]])


def test_interrupted_ends():
    stopped = (End.CUT_SHORT, End.UNSAFE, End.FAILED)
    assert [e.interrupted for e in End] == [e in stopped for e in End]


def test_a_channel_with_crossed_limits_is_refused():
    with pytest.raises(ExperimentError, match=r"'force': low must be below high, got .* N"):
        Channel("force", "N", low=1.0, high=0.0)


def test_channel_label_has_the_unit():
    assert Channel("force", "N").label == "force [N]"
    assert Channel("ratio").label == "ratio"


def test_a_channel_is_converted_with_its_limits_target_and_band():
    warm = Channel("T", "°F", low=32.0, target=68.0, band=9.0).scaled(5 / 9, -160 / 9)
    assert (warm.low, warm.target, warm.band) == pytest.approx((0.0, 20.0, 5.0))
    assert warm.high == np.inf
    turned = Channel("force", "N", low=-1.0, high=3.0, band=0.5).scaled(-2.0)
    assert turned == Channel("force", "N", low=-6.0, high=2.0, band=1.0)


def test_variants_are_part_of_the_value():
    assert replace(experiment(), runs=(experiment(),)) != experiment()


def test_a_frozen_mapping_refuses_every_change_and_survives_a_copy():
    kept = FrozenMapping({"a": 1.0, "b": np.arange(2.0)})
    for change in (
        lambda: kept.update(a=2.0),
        lambda: kept.pop("a"),
        lambda: kept.setdefault("c", 0.0),
        lambda: kept.clear(),
        lambda: kept.__setitem__("a", 2.0),
        lambda: kept.__delitem__("a"),
        lambda: kept.__ior__({"a": 2.0}),
    ):
        with pytest.raises(TypeError, match="cannot be changed"):
            change()
    assert pickle.loads(pickle.dumps(kept)) == deepcopy(kept) == kept
    assert type(deepcopy(kept)) is FrozenMapping
