import numpy as np
import pytest
from scipy import signal

from prefcal_env import Channel, End, FunctionPlant, Knob
from prefcal_env.errors import ScenarioError
from prefcal_env.plants.plant import Plant
from prefcal_scenarios.described.lqr_scenario import lqr_scenario

TORQUE = Channel("torque", "N m", -8, 8)
PENDULUM = FunctionPlant(
    lambda x, u, d: [x[1], 9.81 * np.sin(x[0]) - 0.1 * x[1] + u[0]],
    lambda x, u, d: [x[0]],
    states=[Channel("angle", "rad"), Channel("speed", "rad/s")],
    inputs=[TORQUE],
    outputs=[Channel("angle", "rad")],
)
PLANTS = {
    "lag with dead time": Plant.of(([0.8], [20, 1]), delay=6.0, inputs=[Channel("u", "%", 0, 100)]),
    "triple integrator": Plant.of(([1.0], [1, 0, 0, 0]), inputs=[Channel("u", "", -1, 1)]),
    "unstable": PENDULUM,
    "coupled, with dead times": Plant.of(
        (-np.diag([0.1, 0.2]), [[1, 0.3], [0.2, 0.5]], np.eye(2), np.zeros((2, 2))),
        delay=[1.0, 0.5],
        output_delay=[0.0, 0.3],
    ),
}


@pytest.mark.parametrize("name", PLANTS)
def test_the_middle_settles_and_random_weights_are_often_stable(name):
    scenario = lqr_scenario(PLANTS[name])
    found = scenario.run(scenario.references["robust"])
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
    found = scenario.run(scenario.references["robust"])
    assert found.kpis["M_s"] <= 2
    assert np.isfinite(list(found.kpis.values())).all()


def test_a_plant_without_states_is_refused_with_a_way_out():
    with pytest.raises(ScenarioError, match=r"has no states.*tune a PID"):
        lqr_scenario(Plant.of(2.0, inputs=[Channel("u", "%", 0, 100)]))


def test_a_larger_weight_of_the_integrated_error_recovers_sooner():
    scenario = lqr_scenario(PENDULUM)
    Q_y, Q_i = scenario.references["robust"]
    slow, fast = (scenario.run(np.array([Q_y, Q_i * k])).kpis["recovery"] for k in (0.05, 1))
    assert fast < slow


def test_the_linear_loop_of_the_sensitivity_is_the_one_that_is_simulated():
    scenario = lqr_scenario(PLANTS["coupled, with dead times"])
    theta, loop = scenario.references["robust"], scenario.run.kpis.laws
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
