"""Processors from measurements, and their files."""

import json
from dataclasses import replace

import numpy as np
import pytest

from prefcal_env.errors import SettingsError
from prefcal_env.mpc import (
    MPCSettings,
    Processor,
    StepSize,
    TimedStep,
    fit_processor,
    read_processor,
    write_processor,
)
from prefcal_env.mpc.processors import fit_error
from prefcal_env.plants.bicycle import Bicycle

TARGET = Processor("target", step=2e-3, iteration=3e-4, building=5e7, solving=2e8)


def size(N_p: int, N_u: int) -> StepSize:
    settings = MPCSettings(T_s=0.1, N_p=N_p, N_u=N_u, Q_y=np.eye(3), Q_du=np.eye(2))
    return StepSize.of(Bicycle(), settings)


def steps(processor: Processor, *horizons: tuple[int, int]) -> list[TimedStep]:
    """What `processor` takes for steps of these horizons, with 5 to 12 iterations."""
    sizes = [size(*each) for each in horizons]
    return [
        TimedStep(s, n, float(processor.t_comp(s, np.array([n]))[0]))
        for s in sizes
        for n in range(5, 13)
    ]


HORIZONS = ((10, 1), (10, 10), (20, 6), (30, 3), (30, 30))


@pytest.mark.parametrize("factor", [1.0, 1e-3, 1e6])
def test_exact_times_give_the_processor_back_whatever_its_speed(factor):
    target = TARGET.slower(factor, "target")
    found = fit_processor("target", steps(target, *HORIZONS))
    for name in ("step", "iteration", "building", "solving"):
        assert getattr(found, name) == pytest.approx(getattr(target, name), rel=1e-6)
    assert fit_error(found, steps(target, *HORIZONS)) == pytest.approx((1.0, 1.0))


def test_what_takes_no_time_leaves_rates_that_a_file_can_hold(tmp_path):
    flat = [TimedStep(s.size, s.iterations, 1e-3) for s in steps(TARGET, *HORIZONS)]
    found = fit_processor("flat", flat)
    assert found.step == pytest.approx(1e-3)
    assert read_processor(write_processor(found, tmp_path / "flat.json")) == found


def test_a_fit_needs_several_problem_sizes():
    with pytest.raises(SettingsError, match=r"3 or more problem sizes .* got 2"):
        fit_processor("target", steps(TARGET, (10, 1), (30, 3)))


@pytest.mark.parametrize("seconds", [0.0, -1.0, np.inf, np.nan])
def test_a_step_must_take_time(seconds):
    found = steps(TARGET, *HORIZONS)
    with pytest.raises(SettingsError, match="positive, finite time"):
        fit_processor("target", [*found, found[0]._replace(seconds=seconds)])


def test_a_file_keeps_every_digit(tmp_path):
    odd = replace(TARGET, name="Prüfstand θ", solving=1 / 3)
    assert read_processor(write_processor(odd, tmp_path / "target.json")) == odd


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("no JSON", "must be a JSON file"),
        ("[1, 2]", "must be a processor"),
        ('{"name": "x"}', "must be a processor"),
        ('{"prefcal processor": 2}', "must be a processor"),
        ('{"prefcal processor": 1, "name": "x"}', "must have exactly the keys building, iterat"),
        (None, "cannot read"),
    ],
)
def test_a_file_that_is_none_is_refused_with_its_path(tmp_path, text, message):
    path = tmp_path / "target.json"
    if text is not None:
        path.write_text(text)
    with pytest.raises(SettingsError, match=message) as refused:
        read_processor(path)
    assert str(path) in str(refused.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"step": "fast"}, "step must be a number, got 'fast'"),
        ({"step": True}, "step must be a number, got True"),
        ({"step": -1.0}, "step must be 0 s or more"),
        ({"solving": 0.0}, "solving must be positive"),
        ({"name": 3}, "name must be a string"),
        ({"cores": 4}, "must have exactly the keys"),
    ],
)
def test_a_value_that_cannot_be_is_refused(tmp_path, change, message):
    path = write_processor(TARGET, tmp_path / "target.json")
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(SettingsError, match=message):
        read_processor(path)


def test_a_file_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(SettingsError, match=r"cannot write .*nowhere"):
        write_processor(TARGET, tmp_path / "nowhere" / "target.json")
