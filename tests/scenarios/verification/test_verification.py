"""What varies in a verification, what its runs share, and what is written of it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from prefcal_env import (
    PID,
    ClosedLoop,
    FunctionPlant,
    Knob,
    KnobSpace,
    Maneuvers,
    PlantEnv,
    Task,
    recorded,
    rollout,
)
from prefcal_env.controllers.margins import UNSTABLE, MarginKPIs, Margins, margins
from prefcal_env.disk import digest_of
from prefcal_env.envs.task import StepSignal
from prefcal_env.envs.varied_loop import DIRECTION, ScaledPlant, Worn, factors_of, varied_plant
from prefcal_env.errors import ScenarioError
from prefcal_env.experiments.experiment import Channel, End, Measurement, Move
from prefcal_env.plants.plant import Disturbed, Plant
from prefcal_env.preferences.answer import Reading
from prefcal_env.sources.source import Source, Varied
from prefcal_env.sources.varied import Factor, within
from prefcal_scenarios import KPI, Scenario, load
from prefcal_scenarios.cases.loops.family import LOOPS
from prefcal_scenarios.cases.loops.loop import Designed, LawController
from prefcal_scenarios.described.lqr_scenario import lqr_scenario
from prefcal_scenarios.described.pid_scenario import pid_scenario
from prefcal_scenarios.names import CLOSED_LOOPS
from prefcal_scenarios.verification import verify
from prefcal_scenarios.verification.nominal import margins_at, margins_said, remaining
from prefcal_scenarios.verification.result import Robustness, Verification, VerifiedRun
from prefcal_scenarios.verification.said import BEST, FILE, Verified, WorstRun
from prefcal_scenarios.verification.varied_runs import Perturbed, count_losses, robustly, which_keep
from prefcal_scenarios.wording import measured
from support.varied_loops import (
    assert_it_starts_at_rest_where_the_study_does,
    assert_without_a_variation_the_run_is_that_of_the_study,
    found,
    middle,
    varied,
)
from support.verified import FOUND


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


class OneWay(Source):
    """A loop whose KPI is its gain up, and `down` times its gain where the step is turned.

    With a gain below 3, runs end early.
    """

    def __init__(self, down, sign=1.0):
        self.down, self.sign = down, sign

    def run(self, theta, seed=0):
        late = theta[0] * (self.down if self.sign < 0 else 1.0)
        t = np.linspace(0.0, 1.0, 3)
        made = recorded(theta, t, {"y": t}).with_kpis({"late": float(late)})
        return replace(made, end=End.UNSAFE) if theta[0] < 3 else made

    def varied(self):
        factors = (Factor.around("mass", "parameter", 0.1), Factor(DIRECTION, "task", 1, -1, 1, ends=True))
        return Varied(factors, (), lambda values: OneWay(self.down, values.get(DIRECTION, 1.0)))


def one_way(down, theta, start=None):
    space, kpis = KnobSpace([Knob("gain", 1.0, 10.0)]), (KPI("late", "late", at_most=10.0),)
    scenario = Scenario("oneway", "One way", space, OneWay(down), kpis=kpis)
    start = None if start is None else np.array([start])
    return verify(scenario, np.array([theta]), 40, start=start, jobs=1)


def test_a_turned_step_that_only_this_tuning_fails_is_a_failure():
    # 8 misses 10 where it is turned, 4 does not: the plant can do it, so all tunings meet it.
    for theta, start in ((8.0, None), (8.0, 4.0), (4.0, 8.0), (8.0, 9.0)):
        assert DIRECTION in {f.name for f in one_way(2.0, theta, start).factors}
    judged = one_way(2.0, 8.0)
    turned = sum(each.values[DIRECTION] < 0 for each in judged.runs)
    assert 0 < turned == len(judged.failed) < 40
    assert "not varied" not in judged.headline


@pytest.mark.parametrize("theta", [8.0, 10.0])
def test_a_turned_step_that_no_tuning_can_do_is_left_out_and_the_verdict_says_so(theta):
    judged = one_way(20.0, theta)
    drawn = 1.0 + 9.0 * np.random.default_rng([0, 2**40]).random((60, 1))[:10, 0]
    assert (drawn < 3).any(), "what ends early shows nothing of the plant, in neither direction"
    assert [f.name for f in judged.factors] == ["mass"]
    said = "turned, the nominal plant fails with each of 11 tunings (late misses its objective)"
    assert dict(judged.left_out)[DIRECTION] == said
    assert judged.headline == (
        "Holds: 40 of 40 runs keep the stated limits; not varied: sign of the step, which fails nominally."
    )


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
    theta, subject = scenario.references["MIGO"], found(scenario)
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


def test_start_size_and_direction_of_the_step_vary_and_kpis_are_measured_by_the_new_one():
    scenario = pid_scenario(HEATER)
    theta, subject = scenario.references["MIGO"], found(scenario)
    assert "step" not in " ".join(dict(subject.left_out))
    nominal = scenario.run(theta)
    y0, step = nominal.output(0)[0], 10.0
    assert nominal.y_ref[0, 0] - y0 == pytest.approx(step)
    for values, start, size in (
        ({"size of the step": 1.2}, y0, 1.2),
        ({"sign of the step": -1.0, "sign of the load": -1.0}, y0, -1.0),
        ({"start": 0.1}, y0 + 0.1 * step, 1.0),
        ({"start": -0.1, "size of the step": 0.8, "sign of the step": -1.0}, y0 - 0.1 * step, -0.8),
    ):
        made = subject.at(values)(theta)
        assert made.output(0)[0] == pytest.approx(start)
        assert made.y_ref[0, 0] == pytest.approx(start + size * step)
        half = made.t < 0.49 * made.duration
        shape = (made.output(0) - start) / (size * step)
        same = (nominal.output(0) - y0) / step
        np.testing.assert_allclose(shape[half], same[half], atol=1e-6)  # the plant is linear
        for name in ("settling_time", "overshoot"):
            assert made.kpis[name] == pytest.approx(nominal.kpis[name], abs=0.01)
    turned = subject.at({"sign of the load": -1.0})(theta)
    assert turned.kpis["disturbance_peak"] == pytest.approx(nominal.kpis["disturbance_peak"], rel=0.02)
    before = nominal.u[len(nominal.u) // 2 - 5]
    assert turned.u[-1] - before == pytest.approx(before - nominal.u[-1], rel=0.01)


def drawn_from(d, y_ref=lambda t: np.array([1.2]), **channel):
    """Return a tank whose reference and draw are as given, functions of time or not."""
    plant = FunctionPlant(
        lambda x, u, d: [(u[0] - 40.0 * max(x[0], 0.0) ** 0.5 - d[0]) / 1000.0],
        states=[Channel("level", "m", target=1.2)],
        inputs=[Channel("valve", "%", 0, 100)],
        disturbances=[Channel("draw", "L/s", **channel)],
    )
    task = Task(x0=np.ones(1), u0=np.array([40.0]), y_ref=y_ref, horizon=400.0, d=d)
    loop = ClosedLoop(PlantEnv(plant, task), lambda theta: PID(theta[0], 30.0, T_s=1.0))
    return found(Scenario("tank", "A tank", KnobSpace([Knob("K_p", 1.0, 500.0)]), loop))


def test_a_load_that_is_any_function_of_time_varies_around_its_value_at_the_start():
    stepped = drawn_from(StepSignal((2.0,), ((200.0, (12.0,)),)))
    function = drawn_from(lambda t: np.array([12.0 if t >= 200.0 else 2.0]))
    for subject in (stepped, function):
        varied = {f.name: (f.low, f.high) for f in subject.factors if f.kind == "task"}
        assert varied == {"size of the load": (0.8, 1.2), "sign of the load": (-1.0, 1.0)}
        assert "load" not in " ".join(dict(subject.left_out))
        for values, after in (
            ({}, 12.0),
            ({"size of the load": 1.2}, 14.0),
            ({"size of the load": 0.8, "sign of the load": -1.0}, -6.0),
        ):
            task = subject.at(values).function.env.task
            assert task.disturbance(199.0) == pytest.approx([2.0])
            assert task.disturbance(200.0) == pytest.approx([after])
    runs = [s.at({"size of the load": 1.2})(np.array([50.0])) for s in (stepped, function)]
    np.testing.assert_array_equal(runs[0].y, runs[1].y)
    assert np.abs(runs[1].y - function.at({})(np.array([50.0])).y).max() > 1e-3


@pytest.mark.parametrize("d", [np.array([2.0]), lambda t: np.array([2.0]), StepSignal((2.0,))])
def test_a_disturbance_that_never_changes_is_no_load(d):
    subject = drawn_from(d)
    assert not any(f.kind == "task" for f in subject.factors)
    said = "none acts: no disturbance of the task changes"
    assert dict(subject.left_out)["size of the load"] == said
    loads = {"calm": subject.loop, "load": drawn_from(lambda t: np.array([t])).loop}
    both = Maneuvers({k: ClosedLoop(PlantEnv(e.plant, e.task), e.controller) for k, e in loads.items()})
    assert said not in dict(both.varied().left_out).values()  # in one of them it does act


def test_a_load_varies_within_the_limits_of_its_disturbance_and_the_verdict_says_so():
    def d(t):
        return np.array([12.0 if t >= 200.0 else 2.0])

    subject = drawn_from(d, low=0.0, high=13.0)
    assert [(f.name, f.low, f.high) for f in subject.factors if f.kind == "task"] == [
        ("size of the load", 0.8, 1.0)
    ]
    left_out = dict(subject.left_out)
    assert left_out["a larger load"] == "draw would go to 14 L/s, beyond its limit of 13 L/s"
    assert left_out["sign of the load"] == "draw would go to −8 L/s, beyond its limit of 0 L/s"
    nominal = VerifiedRun({}, 0, End.TIME_UP, {})
    tuning = Robustness(np.ones(1), nominal, "", (nominal,))
    judged = Verification("tank", (), subject.factors, subject.left_out, 1, tuning, None, ())
    left = "start, size and sign of the step, a larger load, sign of the load."
    assert f"1 of 1 runs end safely; not varied: {left}" in judged.headline
    beyond = drawn_from(d, low=0.0, high=11.0)  # what the task itself does not keep is no limit
    highest = {f.name: f.high for f in beyond.factors if f.kind == "task"}
    assert highest == {"size of the load": 1.2, "sign of the load": 1.0}


def test_a_reference_that_is_a_function_of_time_is_the_step_that_varies_and_that_shares_refer_to():
    scenario = pid_scenario(HEATER)
    own, theta = scenario.run.env, scenario.references["MIGO"]
    target = own.task.reference(0.0)
    moving = PlantEnv(own.plant, replace(own.task, y_ref=lambda t: target))
    other = replace(scenario, run=ClosedLoop(moving, scenario.controller, scenario.run.kpis))
    for values in ({}, {"size of the step": 1.2, "start": 0.1, "sign of the step": -1.0, "noise": 0.001}):
        made = [found(each).at(values)(theta) for each in (scenario, other)]
        np.testing.assert_allclose(made[0].y_ref, made[1].y_ref)
        np.testing.assert_allclose(made[0].y, made[1].y, atol=1e-6)
    late = drawn_from(np.zeros(1), lambda t: np.array([1.5 if t >= 50.0 else 1.0]))
    bias = late.at({"bias of sensors": 0.01}).function.env.task.bias
    assert bias == pytest.approx([0.005])  # of the step of 0.5 m, which comes later


def test_what_varies_says_in_words_of_what_it_is_a_share_and_which_load_and_step_the_task_has():
    factors = {f.name: f for f in found(pid_scenario(HEATER)).factors}
    units = {name: f.unit for name, f in factors.items()}
    for name in ("all time constants", "gain of valve"):
        assert units[name] == "times the modeled"
    for name in ("range of valve", "size of the load", "size of the step"):
        assert units[name] == "times the stated"
    assert units["noise"] == "of the step (standard deviation)"
    # Half of the time is at 266.2 s, and the controller moves every second.
    assert (
        factors["size of the load"].told
        == "usual, load of 5 % on valve, which its dead time does not delay, at 267 s"
    )
    # Only a dead time of the input that it acts on is one that it does not have.
    behind = Plant.of(
        ([0.8], [160.0, 1.0]), output_delay=9.0, inputs=["valve"], outputs=[Channel("T", target=5.0)]
    )
    (load_,) = (f for f in found(pid_scenario(behind)).factors if f.name == "size of the load")
    assert "dead time" not in load_.told
    assert factors["size of the step"].told == (
        "usual, step of temperature by 10 °C at the start; alone: targets from 48 to 52 °C"
    )
    noisy = next(f for f in found(load("lag")).factors if f.name == "noise")
    assert (noisy.low, noisy.high, noisy.unit) == (0.5, 2.0, "times the stated")
    function = drawn_from(lambda t: np.array([12.0 if t >= 200.0 else 2.0]))
    (load_,) = (f for f in function.factors if f.name == "size of the load")
    assert load_.told == "usual, draw by 10 L/s at about 200 s"
    stepped = drawn_from(StepSignal((2.0,), ((80.0, (12.0,)), (90.0, (0.0,)))))
    (load_,) = (f for f in stepped.factors if f.name == "size of the load")
    assert load_.told == "usual, draw by 10 L/s at 80 s"


def near(low, high, valve=(0.0, 100.0)):
    """Return what varies of a step from 40 to 50 °C between limits, and what does not."""
    outputs, inputs = [Channel("temperature", "°C", low=low, high=high)], [Channel("valve", "%", *valve)]
    plant = Plant.of(([0.8], [160.0, 28.0, 1.0]), inputs=inputs, outputs=outputs)
    subject = found(pid_scenario(plant, reference={"temperature": 50.0}))
    varied = {f.name: (f.low, f.high) for f in subject.factors if f.kind == "task"}
    return varied, dict(subject.left_out)


def test_near_a_limit_the_rest_of_the_step_varies_and_the_limit_is_named():
    varied, left_out = near(-np.inf, 61.0)  # 1.1 steps beyond the target
    assert (varied["size of the step"], varied["start"], varied["sign of the step"]) == (
        (0.8, 1.0),
        (-0.5, 0.0),
        (-1.0, 1.0),
    )
    limit = "within 13 °C of its limit of 61 °C"
    assert left_out["a larger step"] == f"temperature would go to 52 °C, {limit}"
    assert left_out["start and target moved ahead"] == f"temperature would go to 57 °C, {limit}"
    varied, left_out = near(-np.inf, 66.0)
    assert (varied["size of the step"], varied["start"]) == ((0.8, 1.2), (-0.5, 0.0))
    assert "a larger step" not in left_out
    varied, left_out = near(36.0, np.inf)
    assert (varied["size of the step"], varied["start"]) == ((0.8, 1.2), (0.0, 0.5))
    assert left_out["start and target moved back"] == (
        "temperature would go to 35 °C, beyond its limit of 36 °C"
    )
    assert left_out["sign of the step"] == ("temperature would go to 28 °C, beyond its limit of 36 °C")


def test_the_range_of_an_input_that_keeps_the_step_as_it_is_is_named():
    varied, left_out = near(-np.inf, np.inf, valve=(0.0, 64.0))  # from 25.6 to 50 °C
    assert varied["size of the step"] == (0.8, 1.0)
    assert (
        left_out["a larger step"] == "temperature 54.88 °C would need valve 68.6 %, beyond its limit of 64 %"
    )
    assert varied["start"] == (-0.5, 0.0)
    assert (
        left_out["sign of the step"]
        == "temperature −11 °C would need valve −13.75 %, beyond its limit of 0 %"
    )


GRID = [[([12.0], [16.0, 1]), ([-18.0], [20.0, 1])], [([6.5], [11.0, 1]), ([-19.0], [14.0, 1])]]
LATE = {
    "input": lambda by: Plant.of(([0.8], [20, 1]), delay=7.0 * by),
    "output": lambda by: Plant.of(([0.8], [20, 1]), output_delay=7.0 * by),
    "both": lambda by: Plant.of(([0.8], [20, 1]), delay=2.0 * by, output_delay=5.0 * by),
    "entry": lambda by: Plant.of(GRID, delay=by * np.array([[1.0, 3.0], [7.0, 3.0]])),
    "discrete": lambda by: Plant.of(signal.dlti([0.04], [1, -0.95], dt=1.0), delay=round(7.0 * by)),
}


@pytest.mark.parametrize("where", LATE)
def test_dead_time_varies_by_the_same_share_wherever_it_stands(where):
    scenario = pid_scenario(LATE[where](1.0))
    theta, subject = scenario.references["MIGO"], found(scenario)
    (factor,) = (f for f in subject.factors if f.kind == "dead time")
    least = 1.4 if where != "discrete" else 2.0  # 20 % of 7, or whole samples
    assert (factor.nominal, factor.low) == (7.0, pytest.approx(7.0 - least))
    assert factor.high == pytest.approx(7.0 + least)
    assert "dead time" not in dict(subject.left_out)
    later = subject.at({"dead time": factor.high})
    env = PlantEnv(Disturbed(LATE[where](factor.high / 7.0), range(0), range(len(theta) // 4)), _task(later))
    right = rollout(env, scenario.controller(theta), theta)
    np.testing.assert_allclose(later(theta).y, right.y, rtol=1e-9, atol=1e-12)
    assert np.abs(later(theta).y - scenario.run(theta).y).max() > 1e-3


def _task(source):
    return source.function.env.task


def test_the_dead_time_of_sensors_varies_with_that_of_the_plant():
    plant, start = Plant.of(([0.8], [20, 1]), delay=2.0), np.zeros(1)
    task = Task(x0=start, u0=start, y_ref=np.array([1.0]), horizon=60.0, measurement_delay=4.0)
    loop = ClosedLoop(PlantEnv(plant, task), lambda theta: PID(theta[0], 20.0, T_s=1.0))
    scenario = Scenario("s", "s", KnobSpace([Knob("K", 0.1, 5)]), loop, kpis=())
    (factor,) = (f for f in found(scenario).factors if f.kind == "dead time")
    assert (factor.nominal, factor.low, factor.high) == (6.0, pytest.approx(4.8), pytest.approx(7.2))
    env = found(scenario).at({"dead time": 7.2}).function.env
    assert env.task.measurement_delay == pytest.approx(4.8)
    assert env.plant.input_delay == pytest.approx((2.4,))
    assert found(scenario).at({}).function.env.task.measurement_delay == 4.0


def test_lag_and_bias_of_the_task_stay_and_what_varies_is_added():
    start = np.zeros(1)
    task = Task(x0=start, u0=start, y_ref=np.array([1.0]), horizon=60.0, lag=0.5, bias=np.array([0.1]))
    loop = ClosedLoop(PlantEnv(Plant.of(([0.8], [20, 1])), task), lambda theta: PID(theta[0], 20.0, T_s=1.0))
    scenario = Scenario("s", "s", KnobSpace([Knob("K", 0.1, 5)]), loop, kpis=())
    nominal, other = (
        found(scenario).at(values).function.env.task
        for values in ({}, {"lag of the actuators": 1.0, "bias of sensors": 0.01})
    )
    assert (nominal.lag, nominal.bias) == (0.5, [0.1])
    assert (other.lag, other.bias) == (1.5, [pytest.approx(0.11)])


def test_a_plant_whose_derivative_is_infinite_at_the_start_varies_too():
    def flows(x, u, d):
        with np.errstate(invalid="ignore"):  # a level below 0 is none
            return u - np.sqrt(x)

    tank = FunctionPlant(
        flows, states=[Channel("level", "m")], inputs=[Channel("flow", "", low=0.0, high=2.0)]
    )
    task = Task(x0=np.zeros(1), u0=np.zeros(1), y_ref=np.array([1.0]), horizon=40.0)
    loop = ClosedLoop(PlantEnv(tank, task), lambda theta: PID(theta[0], 5.0, T_s=0.5))
    scenario = Scenario("tank", "A tank", KnobSpace([Knob("K", 0.1, 5)]), loop, kpis=())
    (lag,) = (f for f in found(scenario).factors if f.name == "lag of the actuators")
    assert lag.high == pytest.approx(0.2)  # a tenth of a twentieth of the experiment


def test_dead_time_inside_the_states_of_a_plant_is_named_as_not_varied():
    scenario = pid_scenario(Plant.of(signal.dlti([0.04], [1, -0.95, 0, 0], dt=1.0)))
    said = [row for row in found(scenario).left_out if "dead time" in row[0]]
    assert said == [("dead time in the states (poles at 0)", "state it as a delay")]


def test_values_of_a_factor_with_a_step_are_whole_steps_and_include_its_ends():
    factor = Factor.around("dead time", "dead time", 0.2, 3.0, "s").stepped(1.0)
    values = [factor.value(share) for share in np.linspace(0, 0.999, 30)]
    assert sorted(set(values)) == [2.0, 3.0, 4.0]
    (wider,) = within([factor], {"dead time": (0.0, 0.5)})
    assert (wider.low, wider.high) == (3.0, 5.0)
    assert within([factor], {"dead time": 0.0}) == ()


def test_equations_without_named_parameters_vary_in_speed_and_gain():
    plant = FunctionPlant(
        lambda x, u, d: [-x[0] + 2.0 * u[0]], states=[Channel("x", "m")], inputs=[Channel("u", "V", -9, 9)]
    )
    scaled = ScaledPlant(plant, 2.0, np.array([3.0]), np.zeros(1), 1.0)
    x, u, d, t = np.array([1.0]), np.array([0.5]), np.zeros(0), np.array([0.3, 1.0])
    exact = 3.0 + (1.0 - 3.0) * np.exp(-2.0 * t)
    assert scaled.hold(x, u, d, t)[:, 0] == pytest.approx(exact, rel=1e-6)
    assert scaled.f(x, u, d) == pytest.approx([2 * (-1.0 + 3.0)])
    J = scaled.jacobians(x, u, d)
    assert (J.A.item(), J.B.item()) == (pytest.approx(-2.0), pytest.approx(12.0))
    names = [f.name for f in found(pid_scenario(plant)).factors]
    assert names[:2] == ["all time constants", "gain of u"]


@pytest.mark.parametrize(
    ("unit", "low", "high", "rests"),
    [("K", 270.0, 330.0, 300.0), ("°C", 10.0, 50.0, 30.0), ("kW", 10.0, 50.0, 0.0), ("K", 0.0, np.inf, 0.0)],
)
def test_the_gain_of_a_temperature_varies_about_the_middle_of_its_range(unit, low, high, rests):
    """A tenth of 300 K is no error of a cooler, a tenth of 300 kW is one of a heater."""
    plant = FunctionPlant(
        lambda x, u, d: [u[0] - x[0]], states=[Channel("T", "K")], inputs=[Channel("u", unit, low, high)]
    )
    (gain,) = (f for f in factors_of(plant) if f.name == "gain of u")
    assert gain.unit == "times the modeled" + (f", about {rests:g} {unit}" if rests else "")
    made, u = varied_plant(plant, {"gain of u": 0.9}), np.array([40.0])
    acts = rests + 0.9 * (40.0 - rests)
    no, at = np.zeros(0), np.array([7.0])
    assert made.f(at, u, no) == pytest.approx([acts - 7.0])
    assert made.hold(at, u, no, np.array([0.5]))[0] == pytest.approx([acts + (7.0 - acts) * np.exp(-0.5)])
    if rests:
        assert made.f(at, np.array([rests]), no) == pytest.approx([rests - 7.0]), "there, it changes nothing"


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


def test_the_plant_gets_as_much_of_an_input_as_behind_a_continuous_lag():
    class Constant:
        T_s = 0.7

        def move(self, m):
            seen.append(m.u.item())
            return Move(np.ones(1))

    seen, lag = [], 2.0
    integrator = Plant.of(([1.0], [1.0, 0.0]))
    task = Task(x0=np.zeros(1), u0=np.zeros(1), y_ref=np.ones(1), horizon=7.0, T_s=0.7, lag=lag)
    made = rollout(PlantEnv(integrator, task), Constant(), np.zeros(1))
    exact = made.t_control - lag * (1 - np.exp(-made.t_control / lag))
    assert made.output(0)[np.searchsorted(made.t, made.t_control)] == pytest.approx(exact)
    assert seen == [0.0, *[1.0] * 9]  # nobody measures the lag
    assert made.u_control == pytest.approx(np.ones((10, 1)))  # limits and moves are those of commands


def test_an_output_that_the_input_reaches_at_once_sees_the_lag():
    class Constant:
        T_s = 1.0

        def move(self, m):
            return Move(np.ones(1))

    task = Task(x0=np.zeros(0), u0=np.zeros(1), y_ref=np.ones(1), horizon=3.0, T_s=1.0, lag=2.0)
    made = rollout(PlantEnv(Plant.of(2.0), task), Constant(), np.zeros(1))
    means = [1 - 2.0 * (np.exp(-t / 2) - np.exp(-(t + 1) / 2)) for t in range(3)]
    assert made.output(0)[np.searchsorted(made.t, made.t_control)] == pytest.approx(2 * np.array(means))
    assert made.u_control == pytest.approx(np.ones((3, 1)))


@pytest.mark.parametrize(
    "scenario",
    [load("lag"), load("mpc-oscillatory"), pid_scenario(Plant.of(([1.0], [10.0, 1.0]), delay=1.0))],
    ids=["compiled law", "controller on a compiled plant", "own plant"],
)
def test_the_input_of_a_run_is_the_command_however_the_loop_is_simulated(scenario):
    known, theta = scenario.source.varied(), middle(scenario)
    longest = next(factor.high for factor in known.factors if factor.name == "lag of the actuators")
    prompt, slow = (known.at({"lag of the actuators": lag}).run(theta) for lag in (0.0, longest))
    # Before it sees what the lag does, the controller asks for the same: the actuator has not followed yet.
    assert slow.u_control[0] == pytest.approx(prompt.u_control[0], rel=1e-12)
    assert np.abs(slow.u_control - prompt.u_control).max() > 0.0


@pytest.mark.parametrize("name", ["lag", "mpc-oscillatory"])
def test_a_bias_of_the_sensors_moves_where_a_loop_settles_and_a_lag_does_not(name):
    scenario = load(name)
    theta, first = middle(scenario), load(name).run.function.__self__.plant.measured[0]
    nominal, off, slow = (
        varied(name, {"noise": 0.0, **values}).run(theta).x
        for values in ({}, {"bias of sensors": 0.01}, {"lag of the actuators": 0.1})
    )
    step = load(name).run.function.__self__.target.start[0] - nominal[0, first]
    assert (nominal - off)[-1, first] == pytest.approx(0.01 * step, rel=0.02)
    assert slow[-1, first] == pytest.approx(nominal[-1, first], abs=5e-3 * abs(step))
    assert np.abs(slow - nominal)[:, first].max() > 1e-3 * abs(step)


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


def test_usual_margins_are_offered_where_none_is_limited_and_an_unstable_loop_is_called_so():
    scenario = pid_scenario(HEATER)
    loose = replace(scenario, kpis=tuple(replace(kpi, at_most=np.inf) for kpi in scenario.kpis))
    theta = scenario.references["MIGO"]
    verdicts = []
    unstable = theta * [4.5, 0.3, 1, 1]
    for tried in (theta, theta * [2.4, 1, 1, 1], unstable):
        found = verify(loose, tried, 1, jobs=1)
        verdicts.append(found.margin_verdict)
        if tried is theta:  # 2.004 is printed as 2, and judged as that
            close = replace(found.tuning.margins, M_s=2.004, phase=29.96)
            read = replace(found, tuning=replace(found.tuning, margins=close)).margin_verdict
    assert verdicts[0] == (
        "No limit on a margin is stated. Usual are M_s ≤ 2, gain ≥ 6 dB, phase ≥ 30°: the nominal loop has "
        "them all."
    )
    assert read == verdicts[0]
    assert "the nominal loop does not have M_s ≤ 2" in verdicts[1]
    assert verdicts[2] == "The nominal loop is not stable: it has no margins."
    (M_s,) = (kpi for kpi in scenario.kpis if kpi.margin)
    assert (M_s.name, M_s.at_most) == ("M_s", 2.0)
    rows, _ = margins_said([found.tuning.margins], "s")
    assert [row[1] for row in rows] == 5 * ["✗ unstable"]  # not 0 dB, 0 s and so on
    (free,) = (kpi for kpi in loose.kpis if kpi.margin)
    swinging, calm = loose.run(unstable), loose.run(theta)
    assert (free.met_by(swinging), measured(free, swinging)) == (False, "unstable")
    assert free.met_by(calm) is None  # no limit is stated


def test_margins_of_a_plant_that_is_not_linear_are_those_of_the_target_too():
    level, valve = Channel("level", "m"), Channel("valve", "%", low=0, high=100)
    tank = FunctionPlant(lambda x, u, d: [0.004 * u[0] - 0.1 * x[0] ** 0.5], states=[level], inputs=[valve])

    class Proportional:
        T_s = 20.0

        def move(self, m):
            return Move(25.0 + 13.0 * (m.y_ref - m.y))

    def verified(plant):
        task = Task(x0=np.ones(1), u0=np.full(1, 25.0), y_ref=np.full(1, 4.0), horizon=400.0)
        loop = ClosedLoop(PlantEnv(plant, task), lambda theta: Proportional())
        return verify(loop, np.ones(1), runs=1, jobs=1)

    found = verified(tank)
    for at, h in ((found.tuning.margins, 1.0), (found.tuning.margins.target, 4.0)):
        # By hand: L(z) = K b / (z - a) is at its worst at z = -1.
        rate = 0.05 / h**0.5
        a = np.exp(-20 * rate)
        gain = (1 + a) * rate / (13 * 0.004 * (1 - a))
        assert at.gain == pytest.approx(gain, rel=1e-6)
        assert at.M_s == pytest.approx(1 / (1 - 1 / gain), rel=1e-6)
    assert found.margin_verdict == (
        "The nominal loop has no integral action: 32 % or more of a lasting disturbance at its input stays. "
        "No limit on a margin is stated. Usual are M_s ≤ 2, gain ≥ 6 dB, phase ≥ 30°: the nominal loop has "
        "them all. At its target, it does not have M_s ≤ 2 or gain ≥ 6 dB."
    )
    # By hand: 1 / (1 + L(1)), L(1) = K b / (1 - a) = 13 · 0.004 / rate; it is 49 % at the start.
    assert remaining(found.tuning.margins) == pytest.approx(1 / (1 + 13 * 0.004 / 0.025), rel=1e-3)
    rows, basis = margins_said([found.tuning.margins], "s")
    assert rows[:2] == (("gain margin at the start [dB]", "6.36"), ("gain margin at the target [dB]", "5.86"))
    assert basis.endswith("point: its start is level 1 m, valve 25 %, its target level 4 m, valve 50 %")
    # Nothing is said twice of a plant that is the same everywhere, also if only its equations are known.
    line = FunctionPlant(lambda x, u, d: [0.004 * u[0] - 0.05 * x[0] - 0.05], states=[level], inputs=[valve])
    same = verified(line)
    assert same.tuning.margins.target is None
    assert margins_said([same.tuning.margins], "s")[1].endswith("operating point")
    assert "target" not in same.margin_verdict


def test_a_gain_that_must_not_fall_is_said_in_words():
    free = Margins(gain=2.0, gain_reduction=0.0, phase=60.0, delay=1.0, M_s=1.6, disk=0.8)
    assert margins_said([free], "s")[0][0] == ("gain margin [dB]", "6.02")
    assert "fall" not in margins_said([free], "s")[1]
    held = replace(free, gain_reduction=0.25)
    rows, basis = margins_said([held, free], "s")
    assert rows[0] == ("gain margin [dB]", "6.02 up, 12.04 down", "6.02")
    words = "the gain may fall to 0.25 times its value or rise to 2 times"
    assert basis.endswith(f"linearized at the operating point; {words}")
    moved = replace(free, target=replace(held, gain=np.inf, place="y 2"), place="y 1")
    rows, basis = margins_said([moved], "s")
    assert rows[1] == ("gain margin at the target [dB]", "∞ up, 12.04 down")
    words = "at the target, the gain may fall to 0.25 times its value or rise without limit"
    assert basis.endswith(f"its start is y 1, its target y 2; {words}")
    assert "fall" not in margins_said([UNSTABLE], "s")[1]


@pytest.mark.parametrize(("target", "worse"), [(12.0, "target"), (1.0, "start")])
def test_margins_as_kpis_are_the_worse_of_start_and_target(target, worse):
    level, valve = Channel("level", "m", low=0, high=20), Channel("valve", "%", low=0, high=100)
    tank = FunctionPlant(
        lambda x, u, d: [0.004 * u[0] - 0.1 * max(x[0], 1e-9) ** 0.5],
        states=[replace(level, target=4.0)],
        inputs=[valve],
        delay=15.0,
    )
    scenario = pid_scenario(tank, reference={"level": target})
    theta = scenario.references["MIGO"] * [1.9, 1, 1, 1]
    start = margins_at(scenario.source.varied(), theta)
    peaks = {"start": start.M_s, "target": start.target.M_s}
    assert max(peaks, key=peaks.get) == worse
    run = scenario.run(theta)
    assert run.kpis["M_s"] == pytest.approx(peaks[worse], rel=5e-4)
    assert abs(peaks["start"] - peaks["target"]) > 0.02 * peaks[worse]
    kpis = MarginKPIs(scenario.run)(run)
    for name in ("phase", "delay", "disk"):
        both = getattr(start, name), getattr(start.target, name)
        assert kpis[f"{name}_margin"] == pytest.approx(min(both))
    (M_s,) = (kpi for kpi in scenario.kpis if kpi.name == "M_s")
    assert "at start or target" in M_s.about


def test_margins_as_kpis_are_those_of_the_varied_plant():
    scenario = pid_scenario(HEATER)
    theta = scenario.references["MIGO"]
    measured = replace(scenario, run=scenario.source.measured(lambda _: MarginKPIs(scenario.run)))
    subject, found_M_s = found(measured), []
    for gain in (0.7, 1.0, 1.4):
        loop = subject.at({"gain of valve": gain}).source.function
        own = margins(loop.env.plant, loop.env.task, lambda: scenario.controller(theta))
        worn = {"gain of valve": gain, "backlash": 0.01}
        kpis = subject.at(worn)(theta).kpis
        found_M_s.append(kpis["M_s"])
        assert kpis["M_s"] == pytest.approx(own.M_s, rel=1e-3)
        assert kpis["phase_margin"] == pytest.approx(own.phase)
    nominal = measured.run(theta).kpis
    assert found_M_s[0] + 0.02 < found_M_s[1] == nominal["M_s"] < found_M_s[2] - 0.02
    lqr = lqr_scenario(HEATER)
    weights = lqr.references["middle"]
    same, other = (found(lqr).at({"gain of valve": k})(weights).kpis["M_s"] for k in (1.0, 1.4))
    assert same == pytest.approx(lqr.run(weights).kpis["M_s"])
    assert other != pytest.approx(same, rel=0.02)


def test_a_varied_plant_at_rest_elsewhere_makes_no_move_at_the_start():
    scenario = pid_scenario(HEATER)
    calm = np.array([1e-3, 1e4, 0.0, 0.0])
    total = [found(scenario).at({"gain of valve": k})(calm).kpis["total_move"] for k in (0.9, 1.0)]
    assert total[0] == pytest.approx(total[1], rel=0.2)


def test_backlash_is_the_whole_gap_and_half_of_it_is_applied_as_ever():
    scenario = pid_scenario(HEATER)
    subject, theta = found(scenario), scenario.references["MIGO"]
    (factor,) = (f for f in subject.factors if f.name == "backlash")
    assert (factor.low, factor.high, factor.unit) == (0.0, 0.01, "of the range")
    assert factor.told == "usual, whole gap; inputs count behind it"
    for share in np.random.default_rng(0).random(50).tolist():
        worn = subject.at({"backlash": factor.value(share)}).function.controller(theta)
        assert worn.play.tolist() == [share * 0.005 * 100.0]  # of a valve from 0 to 100 %, bit for bit
    worn = subject.at({"backlash": 0.01}).function.controller(theta)
    commands = 50.0, 49.9, 49.1, 48.9  # the gap of 1 % is taken up first

    class Says:
        T_s, move = 1.0, lambda self, m: Move(np.array([commands[int(m.t)]]))

    worn.controller, u = Says(), np.array([40.0])
    for k, valve in enumerate((49.5, 49.5, 49.5, 49.4)):
        u = worn.move(Measurement(float(k), np.zeros(2), u, np.zeros(1), np.zeros(1), np.zeros(1))).u
        assert u == pytest.approx([valve])


def test_backlash_leaves_no_lasting_error_of_integral_action():
    scenario = pid_scenario(HEATER, horizon=6000.0)
    made = found(scenario).at({"backlash": 0.01})(scenario.references["MIGO"])
    before = (made.t > 0.15 * made.duration) & (made.t < 0.5 * made.duration)  # of the load
    # It hunts within the play. An anti-windup that sees the gap leaves 0.3 °C.
    assert made.output(0)[before].mean() == pytest.approx(50.0, abs=0.01)


def test_the_reactor_varies_its_parameters_but_not_the_gas_constant():
    scenario = load("cstr")
    subject = found(scenario)
    names = [f.name for f in subject.factors]
    assert [(f.name, f.unit) for f in subject.factors[:6]] == [
        ("feed per volume", "1/h"),
        ("rate constant", "1/h"),
        ("heat of reaction", "kcal/kgmol"),
        ("activation energy", "kcal/kgmol"),
        ("heat capacity", "kcal/(m³ K)"),
        ("heat transfer", "kcal/(m³ K h)"),
    ]
    assert "gas constant" not in names
    theta = scenario.references["paper, automated"]
    own, same = scenario.run(theta), subject.at({})(theta)
    assert dict(same.kpis) == pytest.approx(dict(own.kpis))
    fast = subject.at({"rate constant": 3.6e7})(theta)
    assert fast.x[0, 1] == pytest.approx(8.56)  # it rests there, at a lower temperature
    assert fast.x[0, 0] < own.x[0, 0] - 0.1


def test_the_overtaking_varies_the_car_and_where_it_starts():
    scenario = load("overtake")
    subject, theta = found(scenario), scenario.references["paper, preferences"]
    assert subject.at({})(theta) == scenario.run(theta)
    longer = subject.at({"wheelbase": 4.9, "start beside the center line": 0.2})(theta)
    assert longer.x[0, 1] == 0.2
    assert longer.kpis != scenario.run(theta).kpis


def test_kpis_that_a_scenario_does_not_state_are_found():
    def run(theta, seed=0, lag=2.0):
        t = np.linspace(0.0, 20.0, 201)
        return recorded(theta, t, {"y": 1 - np.exp(-t * theta[0] / lag)}, reference={"y": 1.0}, kpis=None)

    found = verify(
        Scenario("lag", "Lag", KnobSpace([Knob("gain", 0.0, 9.0)]), run), np.array([2.0]), 4, jobs=1
    )
    assert found.kpis
    assert all({kpi.name for kpi in found.kpis} <= set(run.kpis) for run in found.runs)


def step(theta, seed=0, mass=1.0, load=3.0):
    made = recorded(theta, [0.0, 1.0], {"y": [0.0, 1.0]})
    return made.with_kpis({"weight": mass * theta[0], "pull": load})


def heavy(theta, seed=0, mass=2.0):
    return step(theta, seed, mass=mass, load=0.0)


def test_all_maneuvers_meet_the_same_variation():
    runs = Maneuvers({"light": step, "heavy": heavy})
    kpis = (KPI("weight", "weight", better="lower"), KPI("pull", "pull", better="lower"))
    space = KnobSpace([Knob("gain", 0.0, 10.0)])
    scenario = Scenario("both", "Both", space, runs, kpis=kpis)
    found = verify(scenario, np.array([2.0]), 20, jobs=1)
    assert [(f.name, f.nominal) for f in found.factors] == [("mass", 1.0), ("load", 3.0)]
    for run in found.runs:
        mass = run.values["mass"]
        assert run.kpis["weight (light)"] == pytest.approx(2 * mass)
        assert run.kpis["weight (heavy)"] == pytest.approx(4 * mass)
        assert run.kpis["pull"] == run.values["load"]
    assert found.tuning.nominal.kpis == scenario.run(np.array([2.0])).kpis


READING = Reading()


@pytest.fixture(scope="module")
def lag() -> Scenario:
    return load("lag")


def snapped_middle(scenario):
    return scenario.space.decode(scenario.space.snap(np.full(len(scenario.space), 0.5)))


def test_without_a_number_a_run_is_that_of_the_scenario(lag):
    theta = snapped_middle(lag)
    assert Perturbed(lag, 0).run(theta, seed=4) == lag.run(theta, seed=4)


def test_a_robust_study_varies_all_if_a_limit_is_stated_but_what_is_turned_and_else_the_plant_alone(lag):
    factors = lag.source.varied().factors
    turned = {f.name for f in factors if f.ends}
    assert turned, "lag has a direction of its load or its step"
    limited = tuple(replace(kpi, at_most=100.0) for kpi in lag.kpis)
    own, others = robustly(factors, limited)
    assert {f.name for f in others} == turned
    assert [*own, *others] == sorted(factors, key=lambda f: f.ends)
    own, others = robustly(factors, lag.kpis)
    assert {f.kind for f in own} == {"parameter", "dead time"}
    assert {f.kind for f in others} == {"sensor", "actuator", "task"}
    margin = tuple(replace(kpi, margin=True) for kpi in limited)
    assert robustly(factors, margin) == (own, others), "no run can break the limit of a margin"
    theta = np.append(snapped_middle(lag), 3)
    some, all_of_them = (
        Perturbed(replace(lag, kpis=each), 0).run(theta).kpis for each in (lag.kpis, limited)
    )
    assert some != all_of_them


def test_each_number_is_another_plant_with_other_noise_whatever_ran_before(lag):
    theta, source = snapped_middle(lag), Perturbed(lag, 0)
    runs = [source.run(np.append(theta, k)) for k in (1, 2, 1)]
    assert runs[0].kpis == runs[2].kpis != runs[1].kpis
    assert Perturbed(lag, 0).run(np.append(theta, 2)).kpis == runs[1].kpis
    assert Perturbed(lag, 1).run(np.append(theta, 2)).kpis != runs[1].kpis
    assert runs[0].theta.tolist() == [*theta.tolist(), 1.0]


def test_they_are_not_the_runs_of_the_verification_that_follows(lag):
    theta = snapped_middle(lag)
    judged = {Perturbed(lag, 0).run(np.append(theta, k)).kpis["error"] for k in range(1, 9)}
    assert judged.isdisjoint(run.kpis["error"] for run in verify(lag, theta, 8, jobs=1).runs)


def counted(bad, *, reading=READING, thetas=(0.0,)):
    """Count runs; `bad` gives KPIs of θ and run (0: nominal), and note which runs were made."""
    made = []

    def many(points):
        made.extend(tuple(point.tolist()) for point in points)
        return [bad(point[0], int(point[1]) if len(point) > 1 else 0) for point in points]

    return which_keep(many, reading, [np.array([theta]) for theta in thetas], range(1, 41)), made


def lost(kept):
    """The numbers of the runs that do not keep the limits, a list for each θ."""
    return [(np.flatnonzero(~row) + 1).tolist() for row in kept]


def test_each_run_is_judged_by_itself():
    thetas = (0.5, 1.0, 12.0)
    found, made = counted(lambda theta, run: {"time": np.inf if run == theta else 1.0}, thetas=thetas)
    assert lost(found) == [[], [1], [12]]
    assert len(made) == 3 * 41, "each nominally and in 40 runs"


def test_a_limit_on_a_margin_is_not_judged_again_in_perturbed_runs():
    reading = Reading({"M_s": 0.01, "time": 0.1}, {"M_s": 2.0, "time": 1.0})
    made = [{"M_s": 1.9 + 0.1 * run, "time": 1.0 + (run == 30)} for run in range(41)]
    theta = [np.array([0.0])]

    def many(points):
        return [made[int(point[1]) if len(point) > 1 else 0] for point in points]

    found = [which_keep(many, reading, theta, range(1, 41), margins=each) for each in ((), ["M_s"])]
    assert [lost(kept) for kept in found] == [[[*range(2, 41)]], [[30]]]


def test_a_run_that_failed_or_was_unsafe_does_not_keep_the_limits():
    assert lost(counted(lambda theta, run: {} if run == 3 else {"time": 1.0})[0]) == [[3]]
    assert lost(counted(lambda theta, run: {"a": np.inf if run == 5 else 2.0, "b": 1.0})[0]) == [[5]]


def test_it_is_counted_by_which_kpi_perturbed_runs_are_lost():
    never, names = np.inf, ("time", "peak", "error", "M_s")
    runs = [(1.0, 1.0, never, 1.5), (2.0, 0.5, never, 3.0), (2.0, 2.0, 1.0, 3.0), (never, 0.5, 1.0, 1.5)]
    made = [*(dict(zip(names, run, strict=True)) for run in runs), {}, dict.fromkeys(names[:3], never)]

    def many(points):
        return [made[int(point[1]) if len(point) > 1 else 0] for point in points]

    reading = Reading({}, {"peak": 1.0, "error": 1.0, "M_s": 2.0})
    counts = count_losses(many, reading, np.array([0.0]), range(1, 6), margins=["M_s"])
    assert counts == {"": 2, "peak": 1, "time": 1}
    (kept,) = which_keep(many, reading, [np.array([0.0])], range(1, 6), margins=["M_s"])
    assert kept.tolist() == [True, False, False, False, False]


def test_what_never_settles_even_nominally_need_not():
    found, _ = counted(lambda theta, run: {"time": np.inf, "other": np.inf if run == 9 else 1.0})
    assert lost(found) == [[9]]


def test_what_is_unsafe_nominally_does_not_hold():
    assert not counted(lambda theta, run: {})[0].any()
    assert not counted(lambda theta, run: {"time": np.inf, "other": np.inf})[0].any()


def test_an_objective_is_a_limit_as_people_read_it():
    reading = Reading({"time": 0.1}, {"time": 1.0})
    assert lost(counted(lambda theta, run: {"time": 0.9 + 0.1 * run}, reading=reading)[0]) == [
        [*range(2, 41)]
    ]
    assert lost(counted(lambda theta, run: {"time": 1.04}, reading=reading)[0]) == [[]]
    assert lost(counted(lambda theta, run: {"time": 1.2}, reading=reading)[0]) == [[]]


FACTORS = (
    Factor("jitter", "sensor", 0.0, 0.0, 0.1),
    Factor.around("dead time", "dead time", 0.2, 6.0, "s"),
    Factor("noise", "sensor", 0.0, 0.0, 0.002, "of the step"),
    *(Factor.around(f"gain {k}", "parameter", 0.1) for k in range(5)),
)


def run_of(problems=()):
    values = {"jitter": 3.082e-5, "dead time": 7.03456, "noise": 0.00117234}
    values |= {f"gain {k}": 1.0 + 0.01 * k for k in range(5)}
    return VerifiedRun(values, 3, End.TIME_UP, {}, problems)


def test_a_worst_run_names_what_moved_most_within_its_range_with_units():
    worst = WorstRun.of(run_of(("overshoot misses its objective",)), "overshoot 12 %", FACTORS)
    assert worst.words == "overshoot 12 %"
    assert worst.text == (
        "dead time 7.035 s, noise 0.001172 of the step, gain 4 1.04, gain 3 1.03, gain 2 1.02, "
        "gain 1 1.01, jitter 3.082e−05, gain 0 1"
    )
    many = WorstRun("", {f"gain {k}": 1.0 for k in range(10)}, 3)
    assert many.text.endswith("gain 7 1 and 2 others (gain 8, gain 9)")
    assert WorstRun("", {"dead time": 7.1}, 3).text == "dead time 7.1"


def test_a_worst_run_that_keeps_the_limits_is_only_the_most_different():
    assert WorstRun.of(run_of(), "holds", FACTORS).words == "most different from nominal, but holds"


def test_a_worst_run_names_its_own_step_first_as_a_picture_shows_that():
    factors = [
        Factor("noise", "sensor", 0.0, 0.0, 0.002),
        Factor("size of the step", "task", 1.0, 0.8, 1.2),
        Factor("start", "task", 0.0, -0.5, 0.5, "of the step"),
        Factor("sign of the step", "task", 1.0, -1.0, 1.0, ends=True),
    ]
    values = {"noise": 0.002, "size of the step": 0.9, "start": -0.1, "sign of the step": 1.0}
    worst = WorstRun.of(VerifiedRun(values, 3, End.TIME_UP, {}), "holds", factors)
    assert worst.text == "size of the step 0.9, start −0.1 of the step, noise 0.002, sign of the step 1"


@pytest.fixture
def folder(tmp_path):
    (tmp_path / BEST).write_text("{}")
    return tmp_path


def test_what_is_written_is_read(folder):
    assert Verified.read(folder) is None
    found = replace(FOUND, best=digest_of(folder / BEST))
    found.write(folder)
    assert Verified.read(folder) == found


def test_a_verification_of_another_tuning_is_none(folder):
    replace(FOUND, best=digest_of(folder / BEST)).write(folder)
    (folder / BEST).write_text("{ }")
    assert Verified.read(folder) is None


@pytest.mark.parametrize("text", ["", "[]", "[" * 100_000, '{"statement": "fine"}'])
def test_a_damaged_file_is_said(folder, text):
    (folder / FILE).write_text(text)
    with pytest.raises(ScenarioError, match=r"verification\.json"):
        Verified.read(folder)


def test_a_result_that_cannot_be_kept_is_said_with_the_reason(folder):
    (folder / FILE).mkdir()
    with pytest.raises(ScenarioError, match=rf"cannot write .*{FILE}.*\. Not kept: {FOUND.statement[:20]}"):
        FOUND.write(folder)
