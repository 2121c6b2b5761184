"""Scenarios of standard controllers: PID and LQR."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from prefcal_app import load_controller
from prefcal_env import LQG, LQR, Channel, End, FunctionPlant, Knob, Move, PlantEnv, Task, rollout
from prefcal_env.controllers import as_data
from prefcal_env.envs.varied_loop import LAG, LOAD
from prefcal_env.errors import ScenarioError
from prefcal_env.experiments.events import staying_time
from prefcal_env.plants.plant import Plant
from prefcal_env.plants.systems import system_of
from prefcal_env.sources.source import env_of
from prefcal_scenarios.described.design import process_of
from prefcal_scenarios.described.lqr_scenario import lqr_scenario
from prefcal_scenarios.described.pid_scenario import pid_scenario
from prefcal_scenarios.described.steps import Mark, marks_of
from prefcal_scenarios.verification.nominal import margins_at

VALVE = Channel("valve", "%", 0, 100)
PLANTS = {
    "lag with dead time": Plant.of(([0.8], [20, 1]), delay=6.0, inputs=[VALVE], outputs=["T"]),
    "dead time": Plant.of(([1.0], [0.1, 1]), delay=5.0),
    "integrator": Plant.of(([0.05], [1, 0]), delay=2.0),
    "double lag": Plant.of(([1.0], [1, 2, 1])),
    "oscillating": Plant.of(([1.0], [1, 0.2, 1])),
    "unstable": Plant.of(([1.0], [5, -1]), delay=0.4),
    "non-minimum phase": Plant.of(([-1.0, 1.0], [1, 3, 3, 1])),
    "negative gain": Plant.of(([-2.0], [10, 1]), delay=1.0),
}


@pytest.mark.parametrize("name", PLANTS)
def test_the_middle_of_the_ranges_is_stable_and_random_tunings_are_often_sane(name):
    scenario = pid_scenario(PLANTS[name])
    space = scenario.space
    middle = scenario.run(space.decode(np.full(len(space), 0.5)))
    assert middle.end is End.TIME_UP
    assert middle.kpis["M_s"] < 3
    assert np.isfinite(middle.kpis["settling_time"])
    drawn = np.random.default_rng(0).random((200, len(space)))
    measure = scenario.run.kpis
    stable = [np.isfinite(measure.laws.sensitivity(space.decode(z))) for z in drawn]
    assert np.mean(stable) >= 0.4
    ended = [scenario.run(space.decode(z)).kpis for z in drawn[:40]]
    good = [k.get("settling_time", np.inf) + k.get("recovery", np.inf) < np.inf for k in ended]
    assert np.mean(good) >= 0.2


@pytest.mark.parametrize(
    ("system", "limits"),
    [
        (([0.8], [20.0, 12.0, 1.0]), (0, 100)),  # two lags
        (([0.02], [3.0, 1.0, 0.0]), (-50, 50)),  # a level behind a slow valve
        (([2.0], [0.5, 1.0, 0.0]), (-2, 2)),  # the angle of a drive
        (([1.0], [1.0, 0.8, 1.0]), (-10, 10)),  # a spring with little damping
    ],
)
def test_the_middle_of_a_plant_without_dead_time_hardly_overshoots_and_settles_soon(system, limits):
    scenario = pid_scenario(Plant.of(system, inputs=[Channel("u", "", *limits)]))
    middle = scenario.run(scenario.references["MIGO"]).kpis
    assert middle["overshoot"] < 15
    drawn = np.random.default_rng(0).random((100, len(scenario.space)))
    fastest = min(scenario.run(scenario.space.decode(z)).kpis["settling_time"] for z in drawn)
    assert middle["settling_time"] < 5 * fastest


@pytest.mark.parametrize("name", ["lag with dead time", "integrator", "non-minimum phase"])
def test_the_ranges_hold_the_tunings_of_known_rules(name):
    scenario = pid_scenario(PLANTS[name])
    assert {"SIMC", "Ziegler-Nichols", "MIGO"} <= set(scenario.references)
    for theta in scenario.references.values():
        inside = scenario.space.encode(theta)[:2]
        assert np.all((inside > 0) & (inside < 1))


@pytest.mark.parametrize("slow", [50.0, 300.0])
def test_a_slow_mode_that_a_zero_hides_does_not_slow_down_sampling(slow):
    # 0.9/(s + 1) + 0.1/(slow s + 1): nine tenths of the response are those of the fast lag.
    num, den = [0.9 * slow + 0.1, 1.0], np.convolve([1, 1], [slow, 1])
    both = pid_scenario(Plant.of((num, den), delay=0.2)).run.kpis.design
    assert both.T_s == pid_scenario(Plant.of(([0.9], [1, 1]), delay=0.2)).run.kpis.design.T_s == 0.05
    # Without the zero it is the slow mode that is controlled.
    assert pid_scenario(Plant.of(([1.0], den), delay=0.2)).run.kpis.design.T_s >= 0.2


def test_a_sensitivity_peak_above_2_misses_an_objective():
    scenario = pid_scenario(PLANTS["lag with dead time"])
    peak = scenario.kpis[-1]
    assert (peak.name, peak.at_most, peak.goal) == ("M_s", 2.0, "lower")
    middle = scenario.references["MIGO"]
    assert peak.met_by(scenario.run(middle))
    assert peak.met_by(scenario.run(middle * [2, 1, 1, 1])) is False


def test_a_plant_that_allows_no_robust_tuning_has_no_such_objective():
    hard = pid_scenario(Plant.of(([1.0], [5, -1]), delay=2.0))
    peak = hard.kpis[-1]
    assert hard.run(hard.references["MIGO"]).kpis["M_s"] > 2
    assert (peak.name, peak.at_most) == ("M_s", np.inf)


def test_the_total_move_counts_the_first_move_away_from_rest():
    scenario = pid_scenario(PLANTS["lag with dead time"])
    theta = scenario.space.decode(np.full(len(scenario.space), 0.5))
    made = scenario.run(theta)
    rest = scenario.run.kpis.design.point.u[0]
    moved = np.abs(np.diff([rest, *made.u_control[:, 0]]))
    assert moved[0] > 1
    assert np.isclose(made.kpis["total_move"], moved.sum())


def test_a_direct_and_a_reversed_plant_are_controlled_in_their_directions():
    theta = np.array([1.0, 5.0, 0.0, 1.0])
    for name, sign in (("lag with dead time", 1), ("negative gain", -1)):
        assert np.sign(pid_scenario(PLANTS[name]).controller(theta).parameters["K_p"]) == sign


@pytest.mark.parametrize("scale", ["linear", "log10"])
@pytest.mark.parametrize("ends", [(0.5, 5.0), (-5.0, -0.5)])
def test_k_p_is_that_of_the_controller_whichever_sign_its_range_has(ends, scale):
    given = Knob("K_p", *ends, "1", scale=scale)
    scenario = pid_scenario(PLANTS["negative gain"], knobs=[given])
    knob = next(iter(scenario.space))
    assert (knob.low, knob.high) == (-5.0, -0.5)
    for z in (0.0, 0.3, 1.0):
        theta = scenario.space.decode(np.full(4, z))
        pid = scenario.controller(theta).parameters
        assert pid["K_p"] == theta[0] < 0
        # The loop of a lag with gain -2 and K_p < 0 is that of gain 2 and -K_p.
        mirrored = pid_scenario(Plant.of(([2.0], [10, 1]), delay=1.0))
        turned = mirrored.run(theta * [-1, 1, 1, 1])
        assert scenario.run(theta).kpis["M_s"] == pytest.approx(turned.kpis["M_s"])


def test_names_of_tunings_have_the_sign_of_the_controller():
    scenario = pid_scenario(PLANTS["negative gain"])
    assert {"MIGO", "SIMC"} <= scenario.references.keys()
    for theta in scenario.references.values():
        assert scenario.controller(theta).parameters["K_p"] == theta[0] < 0
    assert "Negative" in next(iter(scenario.space)).about


@pytest.mark.parametrize(
    ("name", "ends"),
    [("negative gain", (-1.0, 5.0)), ("lag with dead time", (-5.0, -0.5)), ("lag with dead time", (-1, 5))],
)
def test_a_range_of_k_p_with_the_wrong_sign_is_refused(name, ends):
    with pytest.raises(ScenarioError, match=r"'K_p': K_p must be (nega|posi)tive .* got -\d to -?[\d.]+ 1"):
        pid_scenario(PLANTS[name], knobs=[Knob("K_p", *ends, "1")])


def test_a_tank_starts_at_rest_inside_its_limits():
    tank = FunctionPlant(
        lambda x, u, d: [0.02 * u[0] - 0.1 * np.sqrt(np.maximum(x[0], 0))],
        states=[Channel("level", "m", 0, 10)],
        inputs=[VALVE],
    )
    e = pid_scenario(tank, reference={"level": 5.0}).run(np.array([10.0, 10.0, 0.1, 1.0]))
    assert 0 < e.x[0, 0] < 10
    assert e.y_ref[0, 0] == 5.0


INTEGRATORS = {
    "level": Plant.of(([0.05], [1, 0]), delay=2.0, inputs=[VALVE], outputs=[Channel("level", "%", 0, 100)]),
    "falling": Plant.of(([-0.05], [1, 0]), inputs=[VALVE], outputs=[Channel("level", "%", 0, 100)]),
    "drum": Plant.of(
        ([0.9], [3, 1, 0]), delay=0.5, inputs=[VALVE], outputs=[Channel("level", "cm", -50, 50)]
    ),
    "slow": Plant.of(([1e-9], [1, 0]), inputs=[VALVE], outputs=[Channel("level", "m", 0, 2)]),
    "sampled": Plant.of(
        signal.dlti([0.05], [1, -1], dt=1.0), inputs=[VALVE], outputs=[Channel("y", "", 0, 9)]
    ),
}


@pytest.mark.parametrize("name", INTEGRATORS)
def test_an_integrator_starts_where_it_rests_within_the_limits_of_its_output(name):
    plant = INTEGRATORS[name]
    scenario = pid_scenario(plant)
    task = scenario.run.env.task
    # It rests only with the valve closed, x' = K u.
    assert task.u0 == pytest.approx([0.0], abs=1e-9)
    y, level = plant.g(task.x0, task.u0, np.zeros(0)).item(), plant.outputs[0]
    later = plant.hold(task.x0, task.u0, np.zeros(0), np.array([100.0]))[-1]
    assert plant.g(later, task.u0, np.zeros(0)).item() == pytest.approx(
        y, abs=1e-6 * (level.high - level.low)
    )
    assert y == pytest.approx((level.low + level.high) / 2)
    # From there, the valve can only open: the step and the load are those that it can follow.
    aim = float(task.reference(0.0)[0])
    assert (aim < y) == (name == "falling")
    assert task.disturbance(task.horizon).item() < 0
    assert scenario.run(scenario.references["MIGO"]).end is End.TIME_UP
    assert "only with" in scenario.brief


def test_an_integrator_with_a_rest_inside_the_range_of_its_input_starts_there():
    tank = FunctionPlant(
        lambda x, u, d: [0.02 * (u[0] - 40)], states=[Channel("level", "%", 0, 100)], inputs=[VALVE]
    )
    scenario = pid_scenario(tank)
    assert scenario.run.env.task.u0 == pytest.approx([40.0])
    assert scenario.run.env.task.x0 == pytest.approx([50.0])
    assert "only with" not in scenario.brief


def test_two_outputs_get_two_paired_loops():
    A, B = np.diag([-1.0, -0.5]), np.array([[0.2, 1.0], [1.0, 0.1]])
    scenario = pid_scenario(Plant.of((A, B, np.eye(2), np.zeros((2, 2)))))
    assert scenario.space.names[:5] == ("K_p_1", "T_i_1", "T_d_1", "b_1", "K_p_2")
    made = scenario.controller(scenario.references["MIGO"])
    assert [(p.output, p.input) for p in made.pids] == [(0, 1), (1, 0)]
    e = scenario.run(scenario.references["MIGO"])
    assert e.end is End.TIME_UP
    assert {kpi.name for kpi in scenario.kpis} <= set(e.kpis)


@pytest.mark.parametrize(
    ("num", "den"),
    [
        ([1], [1, 0]),  # a sample of dead time
        ([0.5, 0.5], [1, 0]),  # a mean of two samples
        ([0.5], [1, 0.5]),  # alternates
        ([0.1], [1, -1, 0]),  # integrates, a sample late
        ([0.005, 0.005], [1, -2, 1]),  # a double integrator
    ],
)
def test_a_discrete_plant_without_a_continuous_equivalent_is_controlled(num, den):
    scenario = pid_scenario(Plant.of(signal.dlti(num, den, dt=0.5)))
    kpis = scenario.run(scenario.references["MIGO"]).kpis
    assert kpis["M_s"] < 1.7
    assert np.isfinite([kpis["settling_time"], kpis["recovery"]]).all()


def test_a_sampled_double_integrator_is_tuned_as_the_continuous_one():
    A, B = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])
    C, D = np.array([[1.0, 0.0]]), np.zeros((1, 1))
    exact = signal.cont2discrete((A, B, C, D), 0.1)
    for system in ((*exact[:4], 0.1), signal.dlti([0.005, 0.005], [1, -2, 1], dt=0.1)):
        found = process_of(system_of(system))
        assert (found.integrators, found.lags) == (2, ())
        assert found.gain == pytest.approx(1.0, rel=0.01)
        scenario = pid_scenario(Plant.of(system))
        K_p = scenario.space.knobs[0]
        assert 0.01 < K_p.low < K_p.high < 100
        assert scenario.references["MIGO"][0] == pytest.approx(np.sqrt(K_p.low * K_p.high), rel=1.0)
        assert scenario.controller(scenario.references["MIGO"]).T_s < 1.0


def test_a_sampled_triple_integrator_integrates_three_times():
    found = process_of(system_of(signal.dlti([1e-3], [1, -3, 3, -1], dt=0.1)))
    assert (found.integrators, found.lags) == (3, ())


@pytest.mark.parametrize("lags", [(5.0, 2.0), (5.0, 3.0, 2.0)])
def test_a_forward_euler_model_keeps_its_lags(lags):
    dt, poles = 0.1, [1 - 0.1 / lag for lag in lags]
    model = signal.dlti([np.prod([dt / lag for lag in lags])], np.poly(poles), dt=dt)
    found = process_of(system_of(model))
    assert found.lags == pytest.approx([-dt / np.log(p) for p in poles])
    assert found.delay == 0.0
    assert found.gain == pytest.approx(1.0, rel=1e-3)


def test_only_poles_at_0_are_dead_time():
    found = process_of(system_of(signal.dlti([0.002], np.poly([0.98, 0.95, 0, 0]), dt=0.1)))
    assert found.lags == pytest.approx([-0.1 / np.log(0.98), -0.1 / np.log(0.95)])
    assert found.delay == pytest.approx(0.2)


def test_poles_at_0_are_tuned_as_the_dead_time_that_they_are():
    late = Plant.of(signal.dlti([0.1], [1, -0.9, 0, 0, 0], dt=0.5))
    delayed = Plant.of(signal.dlti([0.1], [1, -0.9], dt=0.5), delay=1.5)
    found, expected = pid_scenario(late), pid_scenario(delayed)
    assert found.references.keys() == expected.references.keys() >= {"SIMC", "Ziegler-Nichols"}
    for name, theta in expected.references.items():
        assert np.allclose(found.references[name], theta)
    # A sampled first-order lag is tuned as the lag that it samples.
    lag = pid_scenario(Plant.of(([1.0], [-0.5 / np.log(0.9), 1]), delay=1.5))
    assert np.allclose(lag.references["SIMC"][0], expected.references["SIMC"][0], rtol=0.3)


def test_a_column_with_a_dead_time_for_each_entry_is_tuned():
    entries = [[([12.8], [16.7, 1]), ([-18.9], [21.0, 1])], [([6.6], [10.9, 1]), ([-19.4], [14.4, 1])]]
    column = Plant.of(entries, delay=[[1.0, 3.0], [7.0, 3.0]])
    scenario = pid_scenario(column)
    middle = scenario.run(scenario.references["MIGO"]).kpis
    assert np.isfinite(list(middle.values())).all()
    # The linear model of the KPI M_s is the plant that is simulated.
    model = scenario.run.kpis.laws.plant
    T_s = model.dt
    states, y = np.zeros(len(model.A)), []
    for _ in range(30):
        y.append(model.C @ states)
        states = model.A @ states + model.B @ np.ones(2)
    task = Task(x0=column.x0, u0=np.zeros(2), y_ref=np.zeros(2), horizon=29 * T_s, dense_step=T_s)
    held = type("Held", (), {"T_s": T_s, "move": lambda _, m: Move(np.ones(2))})()
    assert np.allclose(rollout(PlantEnv(column, task), held, np.ones(1)).y, y)


def test_the_sensitivity_of_coupled_loops_is_that_of_their_margins():
    # At the outputs it is 1.8: the same name had two values on one page.
    lags, mixed = np.diag([-0.2, -0.125, -0.1, -0.25]), np.array([[1.2, 0, 1.0, 0], [0, 0.7, 0, 1.0]])
    plant = Plant.of((lags, [[0.2, 0], [0, 0.125], [0, 0.03], [0.05, 0]], mixed, np.zeros((2, 2))))
    scenario = pid_scenario(plant)
    theta = np.array([6.37, 0.301, 0.194, 0.2, 60.0, 0.221, 0.012, 0.03])
    assert scenario.run(theta).kpis["M_s"] == pytest.approx(1.98, abs=0.01)
    assert margins_at(scenario.source.varied(), theta).M_s == pytest.approx(1.98, abs=0.01)


@pytest.mark.parametrize("make", [pid_scenario, lqr_scenario])
def test_the_sensitivity_behind_a_lag_is_that_of_the_margins_there(make):
    scenario = make(PLANTS["lag with dead time"])
    known, theta = scenario.source.varied(), next(iter(scenario.references.values()))
    found = []
    for lag in (0.0, 1.5):
        source = known.at({LAG: lag})
        loop = replace(known.loop, task=env_of(source).task)
        found.append((source.run(theta).kpis["M_s"], margins_at(replace(known, loop=loop), theta).M_s))
    (own, same), (slower, same_slower) = found
    assert own == pytest.approx(same, rel=1e-3)
    assert slower == pytest.approx(same_slower, rel=1e-3)
    assert abs(slower - own) > 0.02 * own


@pytest.mark.parametrize("delay", [0.0, 1.0])
def test_a_pure_gain_with_limits_is_controlled(delay):
    scenario = pid_scenario(Plant.of(2.0, inputs=[VALVE], delay=delay))
    kpis = scenario.run(scenario.references["MIGO"]).kpis
    assert kpis["M_s"] < 1.7
    assert np.isfinite([kpis["settling_time"], kpis["recovery"]]).all()
    assert scenario.references["MIGO"][0] > 0


def test_own_knobs_and_horizon_replace_what_is_found():
    plant = PLANTS["double lag"]
    scenario = pid_scenario(plant, knobs=[Knob("K_p", 1, 5)], horizon=30.0, title="Mine")
    assert (scenario.space.knobs[0].low, scenario.space.knobs[0].high) == (1, 5)
    assert scenario.run(np.array([2.0, 1.0, 0.1, 1.0])).duration == pytest.approx(30.0, abs=0.1)
    assert scenario.title == "Mine"
    assert scenario.run.kpis.design.loops[0].load > 0  # also in a given time a load acts


def test_a_file_with_an_lqg_is_loaded_without_the_plant(tmp_path):
    lqr = LQR(PLANTS["double lag"], [1.0, 1.0], [0.5], T_s=0.1, integral=["y"], Q_i=[2.0])
    data = as_data(LQG(lqr, [0.1], [0.1, 0.2]))
    path = tmp_path / "best.json"
    content = {"format": 1, "scenario": "gone.py:plant", "theta": {}, "settings": data}
    path.write_text(json.dumps(content))
    assert as_data(load_controller(path)) == data


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"reference": {"levle": 1.0}}, "no output of plant"),
        ({"reference": {"y": 0.0}}, "is where the experiment"),
        ({"knobs": [Knob("K", 1, 2)]}, "no knob of this PID"),
        ({"horizon": -1.0}, "horizon must be above 0"),
    ],
)
def test_what_does_not_fit_is_refused(wrong, said):
    with pytest.raises(ScenarioError, match=said):
        pid_scenario(PLANTS["double lag"], **wrong)


@pytest.mark.parametrize("make", [pid_scenario, lqr_scenario])
def test_a_reference_that_the_input_cannot_hold_is_refused(make):
    """A gain of 0.8 reaches 0.8 of the room of the valve at most; an integrator holds any level."""
    plant = PLANTS["lag with dead time"]
    rest = plant.inputs[0]
    assert (rest.low, rest.high) == (0, 100)
    start = make(plant).run.kpis.design.loops[0]
    reach = start.start + 0.8 * (100 - start.rest)
    assert make(plant, reference={"T": reach}).run.kpis.design.loops[0].target == pytest.approx(reach)
    with pytest.raises(
        ScenarioError, match=r"T = .* out of reach: .* valve = .* %, outside its limits 0 to 100"
    ):
        make(plant, reference={"T": reach + 0.1})
    integrator = Plant.of(([0.05], [1, 0]), inputs=[Channel("valve", "%", -10, 10)], outputs=["T"])
    assert make(integrator, reference={"T": 1e3}).run.kpis.design.loops[0].target == 1e3


def saturating():
    law = lambda x, u, d: [(100 * max(u[0], 0) / (max(u[0], 0) + 30) - x[0]) / 10]  # noqa: E731
    return FunctionPlant(law, states=[Channel("y", "g/L")], inputs=[VALVE])


def with_a_singular_gain():
    rows = [[([1.0], [20, 1]), ([0.8], [15, 1])], [([0.5], [30, 1]), ([0.4], [10, 1])]]
    inputs = [Channel("a", "%", 0, 100), Channel("b", "%", 0, 100)]
    return Plant.of(rows, inputs=inputs, outputs=["L", "T"])


@pytest.mark.parametrize(
    ("plant", "reference", "said"),
    [
        (saturating(), {"y": 105.0}, r"y = 105 g/L is out of reach: .* no steady state there"),
        (with_a_singular_gain(), {"L": 110.0, "T": 70.0}, r"L = 110, T = 70 is out of reach: .* no steady"),
        (
            Plant.of(([0.8], [20, 1]), inputs=[VALVE], outputs=[Channel("T", "°C", low=-50, high=3)]),
            {"T": 3.0},
            r"the reference T = 3 °C must be inside the limits of 'T', -50 to 3 °C",
        ),
    ],
)
def test_a_reference_without_a_steady_state_is_refused(plant, reference, said):
    with pytest.raises(ScenarioError, match=said):
        pid_scenario(plant, reference=reference)


def test_two_outputs_of_a_singular_gain_are_reached_if_their_references_agree():
    found = pid_scenario(with_a_singular_gain(), reference={"L": 110.0, "T": 55.0})
    assert [loop.target for loop in found.run.kpis.design.loops] == [110.0, 55.0]


def test_an_oscillation_that_ends_in_the_band_by_chance_has_not_settled():
    scenario = pid_scenario(PLANTS["double lag"])
    run, design = scenario.run(scenario.references["MIGO"]), scenario.run.kpis.design
    assert np.isfinite(run.kpis["settling_time"])
    first = run.t < design.phase
    loop, y = design.loops[0], run.y.copy()
    y[first, 0] = loop.target + 0.5 * loop.step * np.where(np.arange(first.sum()) % 2, 1, -1)
    y[np.flatnonzero(first)[-1], 0] = loop.target  # its last sample is in the band
    assert scenario.run.kpis(replace(run, y=y))["settling_time"] == np.inf


def test_a_run_that_had_not_arrived_when_the_load_came_never_recovers():
    # The load pushes the output up: without this, the slower the loop, the sooner it "recovered".
    scenario = pid_scenario(PLANTS["lag with dead time"])
    knobs = {knob.name: knob for knob in scenario.space.knobs}
    slow = [knobs["K_p"].low, knobs["T_i"].high, 0.0, 0.0]
    run = scenario.run(np.array(slow))
    schedule = scenario.run.kpis.design
    before = run.output(0)[run.t < schedule.phase][-1]
    assert abs(before - schedule.loops[0].target) > 0.05 * abs(before - schedule.loops[0].start)
    assert run.kpis["settling_time"] == run.kpis["recovery"] == np.inf
    assert np.isfinite(scenario.run(scenario.references["MIGO"]).kpis["recovery"])


def test_an_output_that_never_leaves_its_band_needs_no_time_to_recover():
    scenario = pid_scenario(PLANTS["lag with dead time"])
    run, target = scenario.run(scenario.references["MIGO"]), scenario.run.kpis.design.loops[0].target
    late = run.t[1] / 4  # as samples that do not fall on the instant at which the load sets in
    kpis = scenario.run.kpis(replace(run, t=run.t + late, y=np.full_like(run.y, target)))
    assert (kpis["settling_time"], kpis["recovery"]) == (0.0, 0.0)


def loaded_from(run, source):
    """Return the first sample of a run at which a load acts, and the last one before."""
    task = source.loop.task
    loaded = [bool(np.any(task.disturbance(t) != task.disturbance(0.0))) for t in run.t_control.tolist()]
    first = int(np.argmax(loaded))
    return float(run.t_control[first]), float(run.t_control[first - 1])


@pytest.mark.parametrize("jitter", [0.0, 0.4])
@pytest.mark.parametrize("name", ["dead time", "negative gain", "oscillating"])
def test_a_load_is_counted_from_the_sample_at_which_it_acts(name, jitter):
    plant, scenario = PLANTS[name], pid_scenario(PLANTS[name])
    design, varied = scenario.run.kpis.design, scenario.source.varied()
    theta = scenario.references["MIGO"]
    run = varied.at({"sampling jitter": jitter} if jitter else {})(theta)
    acts, before = loaded_from(run, varied)
    assert before < design.phase * (1 - 1e-9) <= acts  # what the task states lies between the two
    assert design.acts(1, run.t_control) == acts
    late, loop = run.t >= acts, design.loops[0]
    arrives = staying_time(run.t[late], (run.output(0)[late] - loop.target) / loop.step, 0.05)
    assert run.kpis["recovery"] == pytest.approx(arrives - acts)
    if not jitter:
        assert f"From {acts:.4g} {plant.time_unit} on, a load acts" in scenario.brief
        assert design.acts(1) == pytest.approx(acts, rel=1e-12)
        told = next(factor.told for factor in varied.factors if factor.name == LOAD)
        assert told.endswith(f"at {acts:.4g} {plant.time_unit}".rstrip())
        (recovery,) = (kpi for kpi in scenario.kpis if kpi.name == "recovery")
        due = marks_of([replace(recovery, at_most=design.T_s)], run, 2 * design.phase)[-1]
        assert due.first == pytest.approx(acts + design.T_s)


def test_a_load_of_a_plant_whose_periods_do_not_divide_the_time_comes_at_the_next_one():
    design = pid_scenario(PLANTS["dead time"]).run.kpis.design
    assert (design.T_s, design.phase) == (1.0, pytest.approx(50.6))
    assert design.acts(1) == 51.0


def test_the_second_step_of_two_loops_is_said_and_counted_from_its_sample():
    scenario = lqr_scenario(LQR_PLANTS["coupled, with dead times"])
    run, design = scenario.run(scenario.references["middle"]), scenario.run.kpis.design
    stepped = float(run.t_control[np.argmax(run.y_ref[:, design.loops[1].output] == design.loops[1].target)])
    assert design.phase < stepped == pytest.approx(53.8)  # 53.68 is no multiple of 0.2
    assert "at 53.8" in scenario.brief
    own, loop = (run.t >= stepped) & (run.t < design.acts(2)), design.loops[1]
    error = (run.output(loop.output)[own] - loop.target) / loop.step
    arrives = staying_time(run.t[own], error, 0.05)
    assert run.kpis["settling_time_2"] == pytest.approx(arrives - stepped)


def test_stated_limits_have_their_place_in_a_picture():
    made = pid_scenario(PLANTS["lag with dead time"], reference={"T": 50.0})  # from 40
    limits = {"overshoot": 10.0, "settling_time": 60.0, "recovery": 1e6, "M_s": 2.0}
    kpis = tuple(replace(kpi, at_most=limits.get(kpi.name, np.inf)) for kpi in made.kpis)
    run, phase = made.source.varied().at({})(made.references["MIGO"]), made.run.kpis.design.phase
    band = Mark("T", 49.5, 50.5)
    assert 60.0 < phase < 1e6  # what is due after the end is a limit that nothing breaks by being late
    assert marks_of(kpis, run, 2 * phase) == [
        band,
        Mark("T", -np.inf, np.inf, 60.0, 60.0),
        Mark("T", 51.0, 51.0, 0.0, 128.0),  # the first sample from 127.6 s on, at which the load acts
    ]
    assert marks_of(made.kpis, run, 2 * phase) == []
    turned = made.source.varied().at({"sign of the step": -1.0})(made.references["MIGO"])
    assert Mark("T", 29.0, 29.0, 0.0, 128.0) in marks_of(kpis, turned, 2 * phase)


def test_the_brief_says_what_was_chosen():
    scenario = pid_scenario(PLANTS["lag with dead time"])
    design = scenario.run.kpis.design
    assert f"The controller moves every {design.T_s:g} s." in scenario.brief
    assert "on, a load acts: " in scenario.brief
    assert "The dead time of the input does not delay it." in scenario.brief  # which a load does not pass


TORQUE = Channel("torque", "N m", -8, 8)
PENDULUM = FunctionPlant(
    lambda x, u, d: [x[1], 9.81 * np.sin(x[0]) - 0.1 * x[1] + u[0]],
    lambda x, u, d: [x[0]],
    states=[Channel("angle", "rad"), Channel("speed", "rad/s")],
    inputs=[TORQUE],
    outputs=[Channel("angle", "rad")],
)
LQR_PLANTS = {
    "lag with dead time": Plant.of(([0.8], [20, 1]), delay=6.0, inputs=[Channel("u", "%", 0, 100)]),
    "triple integrator": Plant.of(([1.0], [1, 0, 0, 0]), inputs=[Channel("u", "", -1, 1)]),
    "unstable": PENDULUM,
    "coupled, with dead times": Plant.of(
        (-np.diag([0.1, 0.2]), [[1, 0.3], [0.2, 0.5]], np.eye(2), np.zeros((2, 2))),
        delay=[1.0, 0.5],
        output_delay=[0.0, 0.3],
    ),
}


@pytest.mark.parametrize("name", LQR_PLANTS)
def test_the_middle_settles_and_random_weights_are_often_stable(name):
    scenario = lqr_scenario(LQR_PLANTS[name])
    found = scenario.run(scenario.references["middle"])
    assert found.end is End.TIME_UP
    assert np.isfinite(list(found.kpis.values())).all()
    assert found.kpis["M_s"] <= 2
    drawn = np.random.default_rng(0).random((12, len(scenario.space)))
    kpis = [scenario.run(scenario.space.decode(z)).kpis for z in drawn]
    assert np.mean([np.isfinite(k["M_s"]) for k in kpis]) >= 0.7
    assert np.mean([np.isfinite(list(k.values())).all() for k in kpis]) >= 0.3


@pytest.mark.parametrize("form", ["state space", "transfer function"])
def test_a_sampled_double_integrator_is_controlled(form):
    A, B = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])
    exact = signal.cont2discrete((A, B, np.array([[1.0, 0.0]]), np.zeros((1, 1))), 0.1)
    system = exact if form == "state space" else signal.dlti([0.005, 0.005], [1, -2, 1], dt=0.1)
    scenario = lqr_scenario(Plant.of(system))
    found = scenario.run(scenario.references["middle"])
    assert found.kpis["M_s"] <= 2
    assert np.isfinite(list(found.kpis.values())).all()


def test_a_plant_without_states_is_refused_with_a_way_out():
    with pytest.raises(ScenarioError, match=r"has no states.*tune a PID"):
        lqr_scenario(Plant.of(2.0, inputs=[Channel("u", "%", 0, 100)]))


def test_a_larger_weight_of_the_integrated_error_recovers_sooner():
    scenario = lqr_scenario(PENDULUM)
    Q_y, Q_i = scenario.references["middle"]
    slow, fast = (scenario.run(np.array([Q_y, Q_i * k])).kpis["recovery"] for k in (0.05, 1))
    assert fast < slow


def test_the_linear_loop_of_the_sensitivity_is_the_one_that_is_simulated():
    scenario = lqr_scenario(LQR_PLANTS["coupled, with dead times"])
    theta, loop = scenario.references["middle"], scenario.run.kpis.laws
    run = scenario.run(theta)
    M, drive, y, _ = loop._loop(loop.make(theta))
    d = loop.design
    x, n = np.zeros(len(M)), round(d.phase / d.T_s)
    outputs = []
    for _ in range(n):
        outputs.append(y @ x)
        x = M @ x + drive[0][:, 0]
    step = d.loops[0].target - d.loops[0].start
    assert np.allclose(run.y[:n, 0] - d.loops[0].start, step * np.array(outputs)[:, 0], atol=1e-6)


def test_own_knobs_replace_those_found_and_others_are_refused():
    scenario = lqr_scenario(PENDULUM, knobs=[Knob("Q_y", 1, 5)], reference={"angle": 0.3})
    assert next((k.low, k.high) for k in scenario.space) == (1, 5)
    with pytest.raises(ScenarioError, match="no knob of this LQR is called 'K_p'"):
        lqr_scenario(PENDULUM, knobs=[Knob("K_p", 1, 5)])


@pytest.mark.parametrize(
    ("plant", "said"),
    [
        (Plant.of(([[0.0]], [[1.0]], [[1.0]], [[0.0]], 0.5)), "no ẋ = f"),
        (Plant.of(([1.0, 0.0], [1.0, 1.0])), "no LQR was found that settles"),
    ],
)
def test_a_plant_that_no_lqr_controls_is_refused(plant, said):
    with pytest.raises(ScenarioError, match=said):
        lqr_scenario(plant)


def in_minutes(**more):
    """Return a lag with dead time in minutes, from % to °C."""
    return Plant.of(
        ([0.8], [20, 1]), delay=6.0, inputs=[VALVE], outputs=[Channel("T", "°C")], time_unit="min", **more
    )


def test_times_of_a_knob_reach_the_controller_in_the_unit_of_the_plant():
    plain = pid_scenario(in_minutes(), knobs=[Knob("T_i", 1, 100, "min")])
    seconds = pid_scenario(in_minutes(), knobs=[Knob("T_i", 60, 6000, "s"), Knob("b", 0, 100, "%")])
    assert [k.unit for k in seconds.space] == ["%/°C", "s", "min", "%"]
    theta, other = np.array([1.6, 9.0, 0.0, 0.5]), np.array([1.6, 540.0, 0.0, 50.0])
    assert seconds.controller(other).parameters == plain.controller(theta).parameters
    assert seconds.run(other).kpis == plain.run(theta).kpis
    own = seconds.references["MIGO"]
    assert own[1] == pytest.approx(60 * plain.references["MIGO"][1], rel=0.03)


def test_weights_of_an_lqr_reach_it_in_the_unit_of_the_plant():
    plant = Plant.of(([1.0], [1, 2, 1]), time_unit="min")
    plain, seconds = lqr_scenario(plant), lqr_scenario(plant, knobs=[Knob("Q_i", 1e-6, 1e-2, "1/s²")])
    one, other = plain.controller(np.array([1.0, 3.6])), seconds.controller(np.array([1.0, 0.001]))
    np.testing.assert_allclose(one.K_i, other.K_i, rtol=1e-9)


@pytest.mark.parametrize(
    ("knob", "words"),
    [
        (Knob("K_p", 0.5, 5, "°C/%"), "its unit must be %/°C, as that of the plant, got °C/%"),
        (Knob("K_p", 0.005, 0.05, "1/K"), "got 1/K: multiply its range by 100"),
        (Knob("T_i", 1, 100, "m"), "its unit must be min, as that of the plant, got m"),
        (Knob("b", 0, 1, "%/K"), "its unit must be 1, as that of the plant, got %/K"),
    ],
)
def test_a_knob_in_a_unit_of_something_else_is_refused(knob, words):
    with pytest.raises(ScenarioError, match=words):
        pid_scenario(in_minutes(), knobs=[knob])


@pytest.mark.parametrize(
    ("u", "y", "good", "wrong", "words"),
    [
        ("", "°C", "%/K", "°C/%", "its unit must be 1/°C"),
        ("", "l/min", "%/(l/min)", "%/(m3/h)", r"its unit must be %/\(l/min\).*multiply its range by 0.06"),
        ("W", "", "W/bar", "kW/bar", "its unit must be W/bar.*multiply its range by 1000"),
        ("m3/h", "", "m3/h", "°C/%", "its unit must be m3/h"),
        ("%", "-", "%", "%/K", "its unit must be %, "),
    ],
)
def test_a_gain_fits_what_the_plant_states_of_its_units(u, y, good, wrong, words):
    """Of input and output, only one may have a unit: the gain then says the other one's."""
    plant = Plant.of(([0.8], [20, 1]), delay=6.0, inputs=[Channel("u", u, 0, 9)], outputs=[Channel("y", y)])
    assert next(iter(pid_scenario(plant, knobs=[Knob("K_p", 1, 5, good)]).space)).unit == good
    with pytest.raises(ScenarioError, match=words):
        pid_scenario(plant, knobs=[Knob("K_p", 1, 5, wrong)])


def test_a_knob_without_a_unit_has_that_of_the_plant():
    knobs = [Knob("T_i", 1, 100), Knob("K_p", 0.5, 5, "%/K", scale="log10")]
    assert [k.unit for k in pid_scenario(in_minutes(), knobs=knobs).space][:2] == ["%/K", "min"]


@pytest.mark.parametrize("factor", [[1, 0], [1, 0, 0], [1, 0, 4]])
def test_a_common_factor_changes_no_range_and_is_said(factor):
    num, den = [3.0, 1.5], [9.0, 6.0, 4.0, 1.5]
    right = pid_scenario(Plant.of((num, den)))
    made = pid_scenario(Plant.of((np.polymul(num, factor), np.polymul(den, factor))))
    for knob, same in zip(made.space, right.space, strict=True):
        assert (knob.low, knob.high) == pytest.approx((same.low, same.high), rel=0.05)
    assert "common factor" in made.brief
    assert "common factor" not in right.brief


def test_what_hides_in_matrices_stays_and_is_named_where_no_controller_is_found():
    A, B, C, D = signal.tf2ss([3, 1.5, 0], [9, 6, 4, 1.5, 0])
    with pytest.raises(ScenarioError, match=r"poles at s = .* a zero cancels 1"):
        pid_scenario(Plant.of((A, B, C, D)))


@pytest.mark.parametrize(
    ("limits", "end"),
    [
        ({}, End.TIME_UP),
        ({"high": 103.0}, End.UNSAFE),
        ({"high": 110.0}, End.TIME_UP),
        ({"low": 90.0}, End.TIME_UP),
    ],
)
def test_an_output_of_a_transfer_function_that_leaves_its_limits_ends_the_run(limits, end):
    T = Channel("T", "°C", **limits)  # it starts at 80 and overshoots its reference by 3.9
    plant = Plant.of(([1.6], [40.0, 1.0]), delay=7.0, inputs=[Channel("valve", "%", 0, 100)], outputs=[T])
    scenario = pid_scenario(plant, reference={"T": 100.0})
    made = scenario.run(scenario.references["MIGO"])
    assert made.end is end
    y = made.output(0)
    if end is End.UNSAFE:
        assert y[-1] > 103.0 >= y[:-1].max()
    else:
        assert y.max() == pytest.approx(103.9, abs=0.1)


@pytest.mark.parametrize(("system", "late"), [(([1.6], [40.0, 1.0]), 7.0), (([-4.0, 1.0], [10.0, 1.0]), 0.0)])
def test_an_output_that_is_seen_later_or_moves_with_the_input_ends_no_run_by_its_limits(system, late):
    plant = Plant.of(system, output_delay=late, outputs=[Channel("T", high=1.05)])
    scenario = pid_scenario(plant, reference={"T": 1.0})
    made = scenario.run(scenario.references["MIGO"])
    assert made.end is End.TIME_UP
    assert made.output(0).max() > 1.05
    free = pid_scenario(Plant.of(system, output_delay=late, outputs=[Channel("T")]), reference={"T": 1.0})
    assert np.array_equal(made.output(0), free.run(made.theta).output(0))


def test_limits_of_an_output_count_if_another_one_is_seen_later_but_not_if_the_input_acts_on_it_at_once():
    both = Plant.of(
        [[([1.0], [5.0, 1.0]), 0.0], [0.0, ([1.0], [5.0, 1.0])]],
        output_delay=[0.0, 5.0],
        outputs=[Channel("first", high=1.01), Channel("second", high=1.01)],
    )
    unsafe = pid_scenario(both).source.varied().loop.task.unsafe
    assert [index for index, _, high in unsafe._outputs if high == 1.01] == [0]
    plant = FunctionPlant(
        lambda x, u, d: [(u[0] - x[0]) / 10],
        lambda x, u, d: [1.5 * x[0] - 0.5 * u[0]],
        states=[Channel("x")],
        inputs=[Channel("u", low=-20, high=20)],
        outputs=[Channel("y", high=6.5)],
    )
    scenario = pid_scenario(plant, reference={"y": 5.0})
    assert scenario.run(scenario.references["MIGO"]).end is End.TIME_UP


def test_limits_of_an_output_follow_the_varied_plant():
    """A plant of a sample has the same outputs by other states: its state is τ K times the input."""
    systems = [system_of(([1.6], [tau, 1.0])) for tau in (40.0, 80.0)]
    study = Plant.of(systems[0], inputs=[Channel("valve", "%", 0, 100)], outputs=[Channel("T", high=108.0)])
    unsafe = pid_scenario(study, reference={"T": 100.0}).source.varied().loop.task.unsafe
    for system in systems:
        other = unsafe.around(Plant.of(system))
        state = np.linalg.lstsq(system.C, [107.0], rcond=None)[0]
        assert not other(state)
        assert other(state * 109 / 107)
        assert other(np.column_stack([state, state * 109 / 107])).tolist() == [False, True]
