"""What varies of loops, of any plant, and of the case studies; and that controllers stay."""

from dataclasses import replace

import numpy as np
import pytest

from prefcal_env import FunctionPlant
from prefcal_env.controllers.margins import MarginKPIs, margins
from prefcal_env.experiments.experiment import Channel, Measurement, Move
from prefcal_env.plants.plant import Plant
from prefcal_scenarios import load
from prefcal_scenarios.cases.loops.family import LOOPS
from prefcal_scenarios.described.lqr_scenario import lqr_scenario
from prefcal_scenarios.described.pid_scenario import pid_scenario
from prefcal_scenarios.names import CLOSED_LOOPS
from prefcal_scenarios.verification import verify
from prefcal_scenarios.verification.loops import Designed, LawController, Worn
from prefcal_scenarios.verification.plants import Scaled, factors_of, varied_plant
from support.varied_loops import (
    assert_it_starts_at_rest_where_the_study_does,
    assert_without_a_variation_the_run_is_that_of_the_study,
    found,
    middle,
    varied,
)


@pytest.mark.parametrize("name", CLOSED_LOOPS)
def test_a_varied_loop_starts_at_rest_where_the_study_does(name):
    assert_it_starts_at_rest_where_the_study_does(name)


@pytest.mark.parametrize("name", ["lag", "servo", "cart-pole", "mpc-oscillatory"])
def test_without_a_variation_the_run_is_that_of_the_study(name):
    assert_without_a_variation_the_run_is_that_of_the_study(name)


@pytest.mark.parametrize("name", ["cart-pole", "mpc-oscillatory"])
def test_a_controller_is_designed_for_the_plant_of_the_study(name):
    scenario, loop = load(name), LOOPS[name]()
    factors = [f for f in found(scenario).factors if f.kind == "parameter"]
    other = varied(name, {f.name: f.high for f in factors})
    assert isinstance(other.controller, Designed)
    assert other.plant.parameters != loop.plant.parameters
    values = dict(zip(scenario.space.names, middle(scenario).tolist(), strict=True))
    T_s = values.get("T_s", loop.task.T_s)
    made = other.controller.make(values, other.plant, other.task, T_s)
    own = loop.controller.make(values, loop.plant, loop.task, T_s)
    if name == "cart-pole":
        assert np.array_equal(made.rows, own.rows)
    else:
        assert made.estimator.model.plant == loop.plant


def test_the_time_constants_of_matrices_vary_and_their_gains_but_no_definitions():
    names = [f.name for f in found(load("oscillatory")).factors if f.kind == "parameter"]
    assert names == ["time constant of speed", "time constant of actuator force", "gain of force"]
    loop = LOOPS["lag"]()
    slower = varied("lag", {"time constant of temperature": 1.1}).plant
    A, B = (np.array(M) for M in (loop.plant.parameters.A, loop.plant.parameters.B))
    assert np.array(slower.parameters.A)[0] == pytest.approx(A[0] / 1.1)
    assert np.array_equal(np.array(slower.parameters.A)[1], A[1])
    assert np.array_equal(np.array(slower.parameters.B)[1], B[1])


def test_the_other_direction_is_left_out_where_the_nominal_plant_fails_too():
    theta = middle(load("building"))
    verified = verify("building", theta, 2, jobs=1)
    assert "direction" in [f.name for f in found(load("building")).factors]
    said = any("direction is not varied" in text for text in verified.left_out)
    assert said != ("direction" in {f.name for f in verified.factors})


def test_a_compiled_law_decides_as_a_controller_what_it_decides_in_its_loop():
    for name in ("lag", "servo", "cart-pole"):
        loop = LOOPS[name]()
        loop.task.__dict__["noise"] = np.zeros(len(loop.plant.measured))
        theta = middle(load(name))
        values = dict(zip(loop.space.names, theta.tolist(), strict=True))
        T_s = values.get("T_s", loop.task.T_s)
        hold = max(round(T_s / loop.plant.max_step), 1)
        gains = loop.controller.make(values, loop.plant, loop.task, hold * loop.plant.max_step)
        law, run = LawController(gains, hold * loop.plant.max_step), loop.by_law(gains, hold, 0)
        u = loop.task.u0
        for k in range(0, 40 * hold, hold):
            y, r = run.x[k, list(loop.plant.measured)], np.asarray(loop.target.start)
            u = law.move(Measurement(0.0, run.x[k], u, np.zeros(1), r, y)).u
            assert u == pytest.approx(run.u[k])


HEATER = Plant.of(
    ([0.8], [160.0, 28.0, 1.0]),
    delay=6.0,
    inputs=[Channel("valve", "%", 0, 100)],
    outputs=[Channel("temperature", "°C")],
    name="heater",
)


def test_a_pid_on_a_plant_of_ones_own_is_varied():
    scenario = pid_scenario(HEATER)
    theta, subject = scenario.references["robust"], found(scenario)
    names = {f.name for f in subject.factors}
    assert {"all time constants", "gain of valve", "dead time", "noise", "backlash"} <= names
    same = subject.at({})(theta)
    assert same.kpis == pytest.approx(dict(scenario.run(theta).kpis))
    late = subject.at({"dead time": 12.0})(theta)
    assert late.kpis["overshoot"] > same.kpis["overshoot"]
    weak = subject.at({"gain of valve": 0.9})(theta)
    assert weak.output(0)[0] == pytest.approx(same.output(0)[0])  # it rests at the same temperature
    before = int(np.searchsorted(same.t, same.duration / 2)) - 2
    assert weak.u[before] == pytest.approx(same.u[before] / 0.9, rel=0.01)
    loaded = subject.at({"size of the load": 2.0})(theta)
    assert loaded.kpis["disturbance_peak"] == pytest.approx(2 * same.kpis["disturbance_peak"], rel=0.2)
    verified = verify(scenario, theta, 3, jobs=1)
    assert len(verified.runs) == 3
    assert verified.tuning.margins.phase > 40


def test_equations_without_named_parameters_vary_in_speed_and_gain():
    plant = FunctionPlant(
        lambda x, u, d: [-x[0] + 2.0 * u[0]], states=[Channel("x", "m")], inputs=[Channel("u", "V", -9, 9)]
    )
    scaled = Scaled(plant, 2.0, np.array([3.0]), (0.0,))
    x, u, d, t = np.array([1.0]), np.array([0.5]), np.zeros(0), np.array([0.3, 1.0])
    exact = 3.0 + (1.0 - 3.0) * np.exp(-2.0 * t)
    assert scaled.hold(x, u, d, t)[:, 0] == pytest.approx(exact, rel=1e-6)
    assert scaled.f(x, u, d) == pytest.approx([2 * (-1.0 + 3.0)])
    J = scaled.jacobians(x, u, d)
    assert (J.A.item(), J.B.item()) == (pytest.approx(-2.0), pytest.approx(12.0))
    names = [f.name for f in found(pid_scenario(plant)).factors]
    assert names[:2] == ["all time constants", "gain of u"]


def test_time_constants_of_matrices_vary_one_by_one_only_if_their_states_have_names():
    def poles(plant, name):
        made = varied_plant(plant, {name: 1.1})
        return sorted(-1 / np.linalg.eigvals(made.jacobians(np.zeros(2), np.zeros(1), np.zeros(0)).A))

    def names(plant):
        return [f.name for f in factors_of(plant) if f.kind == "parameter"]

    companion = Plant.of(([1.4], [360.0, 53.0, 1.0]))
    assert names(companion) == ["all time constants", "gain of u"]
    assert poles(companion, "all time constants") == pytest.approx([8.8, 49.5])
    parts = [[-1 / 8, 0.0], [1 / 45, -1 / 45]], [[1 / 8], [0.0]], [[0.0, 1.4]], [[0.0]]
    tanks = Plant.of(parts, states=["valve", "tank"])
    assert names(tanks) == ["time constant of valve", "time constant of tank", "gain of u"]
    assert poles(tanks, "time constant of tank") == pytest.approx([8.0, 49.5])
    discrete = Plant.of((np.eye(1) / 2, np.eye(1), np.eye(1), np.zeros((1, 1)), 1.0))
    assert names(discrete) == ["gain of u"]


def test_worn_sensors_and_actuators():
    class Echo:
        T_s = 1.0

        def move(self, m):
            return Move(10.0 * m.y)

    worn = Worn(Echo(), np.array([0.5]), np.array([1.0]), [Channel("u", "", -99, 99)])
    u = np.zeros(1)
    for y, expected in ((0.3, 4.0), (0.5, 4.0), (0.8, 9.0), (0.3, 6.0)):
        u = worn.move(Measurement(0.0, np.zeros(1), u, np.zeros(0), np.zeros(1), np.array([y]))).u
        assert u == pytest.approx([expected])


def test_a_controller_sees_its_own_command_within_the_range_and_not_the_backlash():
    class Listening:
        T_s = 1.0

        def __init__(self):
            self.seen = []

        def move(self, m):
            self.seen += m.u.tolist()
            return Move(m.y)

    own = Listening()
    worn = Worn(own, np.zeros(1), np.array([1.0]), [Channel("u", "", 0, 9)])
    u = np.array([5.0])
    for y in (7.0, 6.5, 20.0, 8.0):
        u = worn.move(Measurement(0.0, np.zeros(1), u, np.zeros(0), np.zeros(1), np.array([y]))).u
        u = u.clip(0, 9)  # as the plant does
    assert own.seen == [5.0, 7.0, 6.5, 9.0]


def test_margins_as_kpis_are_those_of_the_varied_plant():
    scenario = pid_scenario(HEATER)
    theta = scenario.references["robust"]
    measured = replace(scenario, run=scenario.source.measured(lambda _: MarginKPIs(scenario.run)))
    subject, found_M_s = found(measured), []
    for gain in (0.7, 1.0, 1.4):
        loop = subject.at({"gain of valve": gain}).source.function
        own = margins(loop.env.plant, loop.env.task, lambda: scenario.controller(theta))
        worn = {"gain of valve": gain, "backlash": 0.005}
        kpis = subject.at(worn)(theta).kpis
        found_M_s.append(kpis["M_s"])
        assert kpis["M_s"] == pytest.approx(own.M_s, rel=1e-3)
        assert kpis["phase_margin"] == pytest.approx(own.phase)
    nominal = measured.run(theta).kpis
    assert found_M_s[0] + 0.02 < found_M_s[1] == nominal["M_s"] < found_M_s[2] - 0.02
    lqr = lqr_scenario(HEATER)
    weights = lqr.references["robust"]
    same, other = (found(lqr).at({"gain of valve": k})(weights).kpis["M_s"] for k in (1.0, 1.4))
    assert same == pytest.approx(lqr.run(weights).kpis["M_s"])
    assert other != pytest.approx(same, rel=0.02)


def test_a_varied_plant_at_rest_elsewhere_makes_no_move_at_the_start():
    scenario = pid_scenario(HEATER)
    calm = np.array([1e-3, 1e4, 0.0, 0.0])
    total = [found(scenario).at({"gain of valve": k})(calm).kpis["total_move"] for k in (0.9, 1.0)]
    assert total[0] == pytest.approx(total[1], rel=0.2)


def test_backlash_leaves_no_lasting_error_of_integral_action():
    scenario = pid_scenario(HEATER, horizon=6000.0)
    made = found(scenario).at({"backlash": 0.005})(scenario.references["robust"])
    before = (made.t > 0.15 * made.duration) & (made.t < 0.5 * made.duration)  # of the load
    # It hunts within the play. An anti-windup that sees the gap leaves 0.3 °C.
    assert made.output(0)[before].mean() == pytest.approx(50.0, abs=0.01)


def test_the_reactor_varies_its_parameters_but_not_the_gas_constant():
    scenario = load("cstr")
    subject = found(scenario)
    names = [f.name for f in subject.factors]
    assert names[:6] == ["F V", "k 0", "H", "E", "rho Cp", "US V"]
    assert "R" not in names
    theta = scenario.references["paper, automated"]
    own, same = scenario.run(theta), subject.at({})(theta)
    assert dict(same.kpis) == pytest.approx(dict(own.kpis))
    fast = subject.at({"k 0": 3.6e7})(theta)
    assert fast.x[0, 1] == pytest.approx(8.56)  # it rests there, at a lower temperature
    assert fast.x[0, 0] < own.x[0, 0] - 0.1


def test_the_overtaking_varies_the_car_and_where_it_starts():
    scenario = load("overtake")
    subject, theta = found(scenario), scenario.references["paper, preferences"]
    assert subject.at({})(theta) == scenario.run(theta)
    longer = subject.at({"wheelbase": 4.9, "start beside the center line": 0.2})(theta)
    assert longer.x[0, 1] == 0.2
    assert longer.kpis != scenario.run(theta).kpis
