"""Runs are cut short by bounds that hold for every built-in scenario."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from prefcal_agents import GLISp
from prefcal_env import End, Knob, KnobSpace, Maneuvers, recorded
from prefcal_env.errors import ScenarioError, SettingsError
from prefcal_env.preferences.answer import Mark, Preference
from prefcal_env.preferences.loop import calibrate
from prefcal_scenarios import load
from prefcal_scenarios.cases.loops.family import LOOPS
from prefcal_scenarios.cutting import Chances, cut, parts
from prefcal_scenarios.kpis import INTERRUPTED, bounds_of, can_be_cut, outcome
from prefcal_scenarios.scenario import Scenario, with_found_kpis
from prefcal_scenarios.tastes import calibrators_of
from support.interviews import begin
from toy_study import toy_scenario

SLOW = ("cstr", "overtake", "mpc-oscillatory", "mpc-quadruple-tank", "mpc-boost-converter")


@pytest.mark.parametrize("name", [*LOOPS, "cstr", "overtake", "loop-17", "loop-23"])
def test_bounds_never_exceed_the_kpis_of_the_whole_run_and_never_fall(name):
    scenario, rng = load(name), np.random.default_rng(5)
    assert can_be_cut(scenario)
    for z in rng.random((2 if name in SLOW else 8, len(scenario.space))):
        whole = scenario.run(scenario.space.decode(scenario.space.snap(z)), seed=2)
        final, before = outcome(scenario, whole), dict[str, float]()
        for part in parts(whole):
            bounds = dict(bounds_of(scenario, part))
            assert bounds.keys() <= final.keys()
            for kpi, bound in bounds.items():
                slack = 1e-9 * (1.0 + abs(bound))
                assert bound <= final[kpi] + slack, kpi
                assert bound >= before.get(kpi, -np.inf) - slack, kpi
            before = bounds


def test_a_run_is_cut_at_the_first_instant_at_which_it_is_hopeless():
    scenario = load("tank")
    whole = scenario.run(scenario.space.decode(np.full(len(scenario.space), 0.5)))
    limit = 0.4 * whole.kpis["error"]
    made = cut(whole, lambda part: bounds_of(scenario, part)["error"] > limit)
    assert made.end is End.CUT_SHORT
    assert 0 < made.duration < whole.duration
    step = whole.duration / 25
    assert bounds_of(scenario, made)["error"] > limit
    assert bounds_of(scenario, next(p for p in parts(whole)))["error"] <= limit
    assert np.array_equal(made.x, whole.x[: len(made.t)])
    earlier = [p for p in parts(whole) if p.duration < made.duration - step / 2]
    assert all(bounds_of(scenario, part)["error"] <= limit for part in earlier)
    assert cut(whole, lambda part: False) is whole
    known = outcome(scenario, made)
    assert known[INTERRUPTED] == 0.0
    assert np.isfinite(list(known.values())).all()


def test_a_scenario_that_says_nothing_of_a_run_in_progress_cannot_be_cut():
    scenario = toy_scenario()
    assert not can_be_cut(scenario)
    with pytest.raises(ScenarioError, match="see `so_far` of Scenario"):
        bounds_of(scenario, scenario.run(scenario.space.decode(np.full(3, 0.5))))


def test_so_far_must_return_a_mapping():
    scenario = replace(load("tank"), so_far=lambda experiment: None)
    whole = scenario.run(scenario.space.decode(np.full(len(scenario.space), 0.5)))
    with pytest.raises(ScenarioError, match="so_far of 'tank' must return a mapping, got None"):
        bounds_of(scenario, whole)


def test_a_script_cuts_runs_short_and_the_calibrator_is_not_asked_about_them():
    scenario = load("tank")
    agent, ran = GLISp(scenario.space, n_init=8, n_max=26, seed=1), {}

    def run(theta):
        made = cut(scenario.run(theta), Chances(agent, scenario).is_hopeless)
        return ran.setdefault(theta.tobytes(), made)

    person, asked = calibrators_of(scenario)["weights"](1), []

    class Person:
        def prefer(self, challenger, incumbent):
            asked.append((challenger, incumbent))
            return person.prefer(challenger, incumbent)

    steps = list(calibrate(agent, run, Person(), partial(outcome, scenario)))
    short = [s for s in steps if s.challenger.end is End.CUT_SHORT]
    assert short
    assert all(s.answer.preference is Preference.INCUMBENT for s in short)
    assert all(Mark.CHALLENGER_CUT_SHORT in s.answer.automatic for s in short)
    assert all(End.CUT_SHORT not in (a.end, b.end) for a, b in asked)
    cut_by_record = agent.history.cut_short()
    assert cut_by_record == {i for i, e in enumerate(ran.values()) if e.end is End.CUT_SHORT}
    assert agent.best_index not in cut_by_record


class Elsewhere:
    """A run in another process, which does not tell what it runs there."""

    worker = None

    def __init__(self, run):
        self.run = run

    def __call__(self, theta, seed=0):
        return self.run(theta, seed=seed)


def plain(theta, seed=0):
    """A level that overshoots."""
    t = np.arange(20.0)
    level = 1.0 - np.exp(-t * theta[0]) * np.cos(t)
    return recorded(theta, t, {"level": level}, {"valve": np.cos(t)}, {"level": 1.0})


SPACE = KnobSpace([Knob("decay", 0.1, 1.0)])


def test_a_run_whose_kpis_are_found_can_be_cut_also_in_another_process():
    scenario = Scenario("tank", "Tank", SPACE, plain)
    moved = replace(scenario, run=Elsewhere(scenario.run))
    whole = moved.run(np.array([0.2]))
    found = with_found_kpis(moved, whole)
    for each in (scenario, moved, found):
        assert can_be_cut(each)
        final, bounds = outcome(each, whole), bounds_of(each, list(parts(whole))[12])
        assert bounds["overshoot of level"] > 0
        assert all(bound <= final[name] + 1e-9 for name, bound in bounds.items())
    assert set(bounds) < {kpi.name for kpi in found.kpis} | {INTERRUPTED}


@pytest.mark.parametrize("stated", [{}, {"kpis": ()}, {"so_far": lambda experiment: {}}])
def test_maneuvers_cannot_be_cut_also_in_another_process(stated):
    run = Maneuvers({"up": plain, "down": plain})
    scenario = Scenario("tank", "Tank", SPACE, run, **stated)
    moved = replace(scenario, run=Elsewhere(scenario.run))
    assert not can_be_cut(scenario)
    assert not can_be_cut(moved)
    with pytest.raises(SettingsError, match="several maneuvers: leave --cut-short out"):
        begin(moved, cut_short=True)
