"""Every source keeps the contract; a run of its own can be written in a page."""

import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from contracts.sources import attended, source_contract
from prefcal_env import Channel, Channels, ClosedLoop, Maneuvers, Rig
from prefcal_env.errors import RunError, ScenarioError
from prefcal_env.experiments.kpis import Tracking
from prefcal_env.sources.source import Function, WithKPIs, source_of
from prefcal_scenarios.catalog import load
from prefcal_scenarios.isolated import OwnSource, isolation
from support.device import Device
from support.short_runs import short_run
from support.tank import pi_of, tank_env

OWN = f"{Path(__file__).parents[2] / 'scenarios' / 'toy_scenario.py'}:toy"
TOY = np.array([0.875, 22.0, 1.0])
PI = np.array([1.0, 0.5])
RIG = Rig(Channels((), (Channel("valve"),), (Channel("level"),)), (1.0,))


def a_run(theta, seed=0):
    return short_run(theta)


@source_contract
@pytest.mark.parametrize(
    ("source", "theta"),
    [
        (Function(a_run), PI),
        (WithKPIs(Function(a_run), Tracking()), PI),
        (source_of(ClosedLoop(tank_env, pi_of)), PI),
        (Maneuvers({"one": a_run, "other": a_run}), PI),
        (RIG, PI),
        (Device(), np.array([2.0, 30.0])),
        (load("cstr").source, next(iter(load("cstr").references.values()))),
        (OwnSource(OWN, None), TOY),
    ],
    ids=["function", "measured", "loop", "maneuvers", "rig", "device", "built-in", "own"],
)
def test_source(clause, source, theta):
    clause(source, theta)


@source_contract
def test_source_in_another_process(clause):
    with isolation(OWN) as isolated:
        clause(isolated(load(OWN)).source, TOY)


def test_a_run_that_was_stopped_before_it_began_says_so():
    with isolation(OWN) as isolated:
        source = isolated(load(OWN)).source
        running, waiting = source.begin(TOY), source.begin(TOY)
        waiting.stop("stopped")
        assert running.advance().kpis
        with pytest.raises(RunError, match="before it began"):
            waiting.advance()


def test_a_run_that_is_stopped_while_it_waits_for_its_worker_does_not_begin():
    with isolation(OWN) as isolated, ThreadPoolExecutor(1) as pool:
        source = isolated(load(OWN)).source
        run = source.begin(TOY)
        with source._workers[0]._running:  # another run is in progress
            waiting = pool.submit(run.advance)
            time.sleep(0.2)
            run.stop("stopped")
        with pytest.raises(RunError, match="before it began"):
            waiting.result(20)
        assert source.run(TOY).kpis


def test_more_kpis_leave_a_source_what_it_is():
    device = WithKPIs(Device(), lambda made: {**made.kpis, "one": 1.0})
    assert (device.asks, device.stops, device.afterward) == ("confirm", False, Device.afterward)
    run = device.begin(np.array([2.0, 30.0]))
    run.supply(run.changes)
    assert run.advance().kpis["one"] == 1.0


def test_what_a_function_declares_is_known_beforehand():
    loop = ClosedLoop(tank_env, pi_of)
    source = source_of(loop)
    assert source.channels == loop.channels
    assert source.controller is pi_of
    assert not source.computes_kpis
    assert source_of(a_run).computes_kpis
    assert source_of(source) is source


def test_a_run_that_asks_for_nothing_takes_nothing():
    with pytest.raises(ScenarioError, match="asks for nothing"):
        Function(a_run).begin(PI).supply(())


def test_a_device_is_attended_from_python():
    made = attended(Device(), np.array([2.0, 30.0]))
    assert made.kpis["integrated error of level"] > 0
