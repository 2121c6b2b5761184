"""KPIs that a scenario states, or gets; what they say about a person."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from prefcal_agents.learned_cost import CostTerm, LearnedCost
from prefcal_app.session.study import trust_text
from prefcal_env import (
    Channel,
    Channels,
    ClosedLoop,
    End,
    Knob,
    KnobSpace,
    Maneuvers,
    Move,
    PlantEnv,
    Rig,
    Task,
)
from prefcal_env.errors import ScenarioError
from prefcal_env.experiments.kpis import Tracking, found_kpis
from prefcal_env.plants import FunctionPlant
from prefcal_env.sources.source import Function, WithKPIs
from prefcal_scenarios import KPI, load, outcome, simulate_many, simulator
from prefcal_scenarios.runs import INTERRUPTED, FailedRun, reading, screened
from prefcal_scenarios.scenario import Scenario, finds_kpis, with_found_kpis
from support.interviews import answer_all, begin
from toy_study import toy_scenario

TOY = toy_scenario()
FINE, UNSAFE = TOY.run(np.array([0.4, 20, 1.0])), TOY.run(np.array([0.4, 20, 80.0]))


def test_agents_are_told_the_scenario_s_kpis_with_a_direction_lower_is_better():
    known = outcome(TOY, FINE)
    assert known["t_f"] == FINE.kpis["t_f"]
    assert known["final"] == pytest.approx(abs(FINE.kpis["final"] - 2.0))  # from the middle
    assert "total move of valve" not in known  # a generic one
    assert outcome(replace(TOY, kpis=()), FINE)["total move of valve"] > 0
    assert known[INTERRUPTED] == 0.0
    assert "largest" not in known  # no objective: nobody knows which way is better


def test_of_a_run_that_was_stopped_everything_is_as_bad_as_can_be():
    known = outcome(TOY, UNSAFE)
    assert UNSAFE.end is End.UNSAFE
    assert set(known) == set(outcome(TOY, FINE))
    assert all(v == np.inf for name, v in known.items() if name != INTERRUPTED)
    assert known[INTERRUPTED] == 1.0


def test_agents_are_told_what_to_aim_at_where_a_margin_has_a_limit():
    phase = KPI("phase", "phase margin", "°", at_least=45.0, margin=True)
    kpis = (phase, KPI("M_s", "M_s", at_most=2.0, margin=True), KPI("time", "time", "s", at_most=9.0))
    told = reading(replace(TOY, kpis=kpis))
    assert told.limits == {"phase": -45.0, "M_s": 2.0, "time": 9.0}
    assert told.aims == {"phase": -49.5, "M_s": 1.8}


def test_the_kpis_of_a_run_that_was_cut_short_are_unknown():
    assert dict(outcome(TOY, replace(FINE, end=End.CUT_SHORT))) == {}


def test_screened_are_the_kpis_with_a_direction_if_any_has_one():
    assert {*screened(TOY, FINE)} == {kpi.name for kpi in TOY.kpis if kpi.goal is not None}
    assert all(value == outcome(TOY, FINE)[name] for name, value in screened(TOY, FINE).items())
    assert dict(screened(TOY, UNSAFE)) == dict.fromkeys(screened(TOY, FINE), np.inf)
    nothing_measured = replace(UNSAFE, kpis={})
    assert screened(TOY, nothing_measured) == screened(TOY, UNSAFE)


def test_screened_are_generic_kpis_only_if_none_has_a_direction():
    bare = replace(TOY, kpis=())
    assert {**screened(bare, FINE), INTERRUPTED: 0.0} == dict(outcome(bare, FINE))
    assert len(screened(bare, FINE)) > 3
    assert dict(screened(bare, UNSAFE)) == dict.fromkeys(screened(bare, FINE), np.inf)
    [short] = simulate_many(bare, [[0.4, 20, 1.0]], jobs=1)
    with pytest.raises(ScenarioError, match="trajectories=True"):
        screened(bare, short)


def test_many_simulations_are_screened_as_single_ones_and_a_failed_one_has_no_kpis():
    thetas = np.array([[0.4, 20, 1.0], [0.4, 20, 80.0]])
    simulate = simulator(TOY)
    results = simulate_many(TOY, thetas, jobs=1)
    assert [screened(TOY, r) for r in results] == [simulate(theta) for theta in thetas]
    assert np.isinf(list(simulate(thetas[1]).values())).all()
    assert len(screened(TOY, FailedRun(thetas[0], "died", "its process ended"))) == 0


def test_a_simulator_is_made_of_a_name_and_refuses_a_run_that_is_no_experiment():
    servo = load("servo")
    middle = servo.space.decode(np.full(len(servo.space), 0.5))
    assert set(simulator("servo")(middle)) == {k.name for k in servo.kpis if k.goal is not None}
    broken = replace(TOY, run=lambda theta, seed=0: None)
    with pytest.raises(ScenarioError, match="Experiment"):
        simulator(broken)(np.array([0.4, 20, 1.0]))


@pytest.mark.parametrize(
    ("kpi", "value", "badness"),
    [
        (KPI("k", "k", at_most=3.0), 5.0, 5.0),
        (KPI("k", "k", at_least=3.0), 5.0, -5.0),
        (KPI("k", "k", at_least=3.0, at_most=5.0), 5.0, 1.0),
        (KPI("k", "k", better="higher", at_most=9.0), 5.0, -5.0),
        (KPI("k", "k", better="lower"), np.inf, np.inf),
        (KPI("k", "k", at_least=3.0), np.inf, None),  # nothing came near: no distance to speak of
        (KPI("k", "k", at_least=3.0), -np.inf, np.inf),
    ],
)
def test_badness_is_lower_for_the_better(kpi, value, badness):
    found = kpi.badness(value)
    assert np.isnan(found) if badness is None else found == badness


def test_a_kpi_is_better_lower_or_higher_or_nobody_knows():
    assert KPI("k", "k").goal is None
    with pytest.raises(ScenarioError, match="better"):
        KPI("k", "k", better="smaller")


@pytest.fixture(scope="module")
def interview():
    interview = begin(TOY, n_max=20)
    answer_all(interview, lambda number: None)
    return interview


def test_every_answer_is_recorded_with_what_happened(interview):
    for closed in interview.now().state.history.comparisons:
        new, old = closed.answer.outcomes
        assert new == outcome(TOY, interview.past.experiment(closed.challenger))
        rival = closed.incumbent
        assert old == (None if rival is None else outcome(TOY, interview.past.experiment(rival)))


DOUBT = (
    ", which is not clearly better than chance: what is said of other θ counts as far as your answers follow "
    "from the KPIs"
)


@pytest.mark.parametrize(("right", "doubt"), [(31, ""), (23, DOUBT)])
def test_how_far_a_sum_of_kpis_can_be_trusted_is_said(right, doubt):
    index = LearnedCost({"t_f": CostTerm(1.0, 0.0, 1.0)}, right, 44)
    assert trust_text(index) == (
        f"A weighted sum of the KPIs predicted {right} of 44 answers that it had not learned from{doubt}."
    )


LEVEL = Channel("level", "m")
VALVE = Channel("valve", "%", low=0, high=100)
SPACE = KnobSpace([Knob("K", 1, 100)])
FOUND = ["settling time of level", "overshoot of level", "integrated error of level", "total move of valve"]


class P:
    T_s = 0.5

    def __init__(self, theta):
        self.K = theta[0]

    def move(self, m):
        return Move(np.array([self.K * (m.y_ref[0] - m.x[0])]))


def loop(level=2.0):
    plant = FunctionPlant(lambda x, u, d: [0.02 * u[0] - 0.1 * x[0]], states=[LEVEL], inputs=[VALVE])
    task = Task(x0=np.zeros(1), u0=np.zeros(1), y_ref=np.array([level]), horizon=20.0)
    return ClosedLoop(lambda: PlantEnv(plant, task), P)


def test_a_closed_loop_with_a_set_point_gets_kpis_with_units_at_once():
    scenario = Scenario("tank", "Tank", SPACE, loop())
    assert [kpi.name for kpi in scenario.kpis] == FOUND
    assert [kpi.unit for kpi in scenario.kpis] == ["s", "m", "m s", "%"]
    assert {kpi.goal for kpi in scenario.kpis} == {"lower"}
    assert set(FOUND) <= scenario.run(np.array([30.0])).kpis.keys()


def test_a_plain_function_gets_its_kpis_from_its_first_experiment():
    made = loop()
    scenario = Scenario("tank", "Tank", SPACE, lambda theta, seed=0: made(theta, seed))
    assert finds_kpis(scenario)
    assert finds_kpis(replace(scenario, title="Other"))
    found = with_found_kpis(scenario, scenario.run(np.array([30.0])))
    assert [kpi.name for kpi in found.kpis] == FOUND


def test_the_found_kpis_of_maneuvers_are_the_worst_of_all_of_them():
    plain = {"small": loop(2.0), "large": loop(6.0)}
    for runs in (
        plain,
        {name: lambda theta, seed=0, run=run: run(theta, seed) for name, run in plain.items()},
    ):
        scenario = Scenario("tank", "Tank", SPACE, Maneuvers(runs))
        made = replace(scenario, title="Other").run(np.array([30.0]))
        each = [made.kpis[f"integrated error of level ({name})"] for name in plain]
        assert each[0] < each[1] == made.kpis["integrated error of level"]


def test_a_maneuver_without_a_set_point_leaves_the_kpis_of_the_others_known():
    scenario = Scenario("tank", "Tank", SPACE, Maneuvers({"step": loop(), "off": loop(np.nan)}))
    assert [kpi.name for kpi in scenario.kpis] == FOUND
    assert np.isfinite(scenario.run(np.array([30.0])).kpis["integrated error of level"])


def test_a_scenario_can_say_that_it_has_none_and_its_run_stays_its_own():
    run = loop()
    scenario = Scenario("tank", "Tank", SPACE, run, kpis=())
    assert not finds_kpis(scenario)
    assert scenario.run is run
    assert not scenario.run(np.array([30.0])).kpis


def test_kpis_that_are_stated_stay_alone():
    toy = toy_scenario()
    assert with_found_kpis(toy, toy.run(np.array([0.875, 22.0, 1.0]))) is toy


def test_the_records_of_a_rig_get_kpis_beside_its_own():
    level = replace(LEVEL, target=2.0, band=0.1)
    rig = Rig(Channels((level,), (VALVE,), (level,)), (2.0,), kpis=lambda e: {"mine": 1.0})
    scenario = Scenario("rig", "Rig", SPACE, rig)
    text = "time [s],level [m],valve [%]\n0,0,50\n1,1,40\n2,2,30\n3,2,30\n"
    made = scenario.run.read(text, np.array([30.0]))
    assert made.kpis["settling time of level"] == 2.0
    assert made.kpis["total move of valve"] == 20.0
    assert made.kpis["mine"] == 1.0


def test_without_a_reference_nothing_is_found():
    assert found_kpis(Channels((LEVEL,), (VALVE,), (LEVEL,))) == ()


@pytest.mark.parametrize("count", [2, 4, 9])
def test_many_outputs_leave_few_enough_kpis_to_read(count):
    outputs = tuple(Channel(f"y{i}", "m", target=1.0) for i in range(count))
    names = [kpi.name for kpi in found_kpis(Channels((), (VALVE,), outputs))]
    assert len(names) <= max(10, count)
    assert {f"settling time of y{i}" for i in range(count)} <= set(names)


def test_a_tracked_run_passes_on_what_is_no_experiment_and_can_be_pickled():
    tracked = pickle.loads(pickle.dumps(WithKPIs(Function(float), Tracking(("a",)))))
    assert tracked.kpis.names == ("a",)
    assert WithKPIs(Function(lambda theta, seed: None), Tracking())(np.zeros(1)) is None


PEAK = KPI("peak", "Peak", "m", at_most=2.5, formula="max(level) - ref(level)")


def test_a_formula_is_a_kpi_of_any_run_and_is_checked_before_it_runs():
    scenario = replace(Scenario("tank", "Tank", SPACE, loop(), kpis=(PEAK,)), title="Other")
    made = scenario.run(np.array([30.0]))
    assert made.kpis["peak"] == made.x[:, 0].max() - 2.0
    assert list(made.kpis) == ["peak"]
    assert pickle.loads(pickle.dumps(scenario.run.kpis)) == scenario.run.kpis
    wrong = replace(PEAK, formula="max(levl)")
    with pytest.raises(ScenarioError, match=r"formula of KPI 'peak': signal 'levl': .*mean 'level'"):
        replace(scenario, kpis=(wrong,))
    with pytest.raises(ScenarioError, match=r"formula 'max\(level': '\(' was never closed"):
        replace(PEAK, formula="max(level")


def test_a_formula_that_is_changed_is_computed_once_and_counts_more_than_what_the_run_returns():
    scenario = Scenario("tank", "Tank", SPACE, loop())
    assert "peak" not in scenario.run(np.array([30.0])).kpis
    one = replace(scenario, kpis=(replace(PEAK, name=FOUND[0]),))
    other = replace(one, kpis=(replace(PEAK, name=FOUND[0], formula="1 + (first(time) < 1)"),))
    assert other.run(np.array([30.0])).kpis[FOUND[0]] == 2.0
    assert other.run.source is one.run.source is scenario.run


def test_formulas_of_maneuvers_are_those_of_the_worst_one():
    scenario = Scenario(
        "tank", "Tank", SPACE, Maneuvers({"small": loop(2.0), "large": loop(6.0)}), kpis=(PEAK,)
    )
    kpis = scenario.run(np.array([30.0])).kpis
    assert kpis["peak"] == max(kpis["peak (small)"], kpis["peak (large)"])


def test_the_record_of_a_rig_has_formulas():
    level = replace(LEVEL, target=2.0, band=0.1)
    scenario = Scenario(
        "rig", "Rig", SPACE, Rig(Channels((level,), (VALVE,), (level,)), (2.0,)), kpis=(PEAK,)
    )
    made = scenario.run.read("time [s],level [m],valve [%]\n0,0,50\n1,3,40\n", np.array([30.0]))
    assert dict(made.kpis) == {"peak": 1.0}
