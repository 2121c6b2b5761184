"""Which loops are worth tuning."""

from dataclasses import replace

import numpy as np
import pytest

from prefcal_bench.loops import family, loop
from prefcal_bench.loops.family import are_worth_comparing, is_worth_tuning
from prefcal_env.envs.task import StepSignal
from prefcal_env.errors import ScenarioError
from prefcal_env.experiments.experiment import Channel
from prefcal_scenarios.cases.loops import LOOPS


@pytest.mark.parametrize("name", LOOPS)
def test_every_named_loop_is_worth_tuning(name):
    assert is_worth_tuning(LOOPS[name]())


def test_a_loop_that_never_settles_or_is_nearly_always_unsafe_is_not():
    lag = LOOPS["lag"]()
    far = replace(lag.task, y_ref=StepSignal((lag.target.start[0] + 1000.0,)))
    assert not is_worth_tuning(replace(lag, task=far))
    tight = (Channel("temperature", "°C", 30, 41), *lag.plant.states[1:])
    assert not is_worth_tuning(replace(lag, plant=replace(lag.plant, states=tight)))


def test_a_kpi_that_hardly_differs_is_enough_to_reject():
    lag = LOOPS["lag"]()
    runs = [lag.run(lag.space.decode(z)) for z in np.random.default_rng(1).random((64, 6))]
    assert are_worth_comparing(runs)
    same = [replace(run, kpis={**run.kpis, "effort": 3.0}) for run in runs]
    assert not are_worth_comparing(same)
    nearly = [replace(same[0], kpis={**same[0].kpis, "effort": 2.0}), *same[1:]]
    assert not are_worth_comparing(nearly)


def test_parameters_are_drawn_again_until_accepted_and_at_last_nominal(monkeypatch):
    drawn = []

    def reject(many):
        def accepts(made):
            drawn.append(made)
            return len(drawn) > many

        return accepts

    family._accepted.cache_clear()
    monkeypatch.setattr(family, "is_worth_tuning", reject(2))
    found, rejected = family._accepted(5)
    assert rejected == 2
    assert found.plant == drawn[2].plant != drawn[1].plant
    family._accepted.cache_clear()
    monkeypatch.setattr(family, "is_worth_tuning", reject(10**6))
    found, rejected = family._accepted(5)
    assert rejected == family._TRIES
    assert found.plant in [make().plant for make in LOOPS.values()]
    family._accepted.cache_clear()


@pytest.mark.parametrize("seed", [-1, 1.5, "3", None])
def test_a_seed_is_a_natural_number(seed):
    with pytest.raises(ScenarioError, match="seed of a loop"):
        loop(seed)
