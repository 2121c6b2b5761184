"""Experiments, their maneuvers, grids, rollouts and panels."""

import pickle
from copy import deepcopy
from dataclasses import replace
from itertools import count

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefcal_env import Channel, Channels, End, Experiment, Maneuvers, recorded
from prefcal_env.envs import PlantEnv
from prefcal_env.envs.closed_loop import rollout
from prefcal_env.errors import ExperimentError, PlantError, ScenarioError, SettingsError
from prefcal_env.experiments.experiment import FrozenMapping, Move, instants, limiting_input
from prefcal_env.experiments.panels import Panel, by_maneuver, combined, plots_of
from prefcal_env.plants import FunctionPlant
from prefcal_env.study.fold import decode, encode
from support.short_runs import short_run
from support.tank import INFLOW, LEVEL, PI, RAIN, TANK, tank_env, tank_task

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


def test_interrupted_ends():
    stopped = (End.CUT_SHORT, End.UNSAFE, End.FAILED)
    assert [e.interrupted for e in End] == [e in stopped for e in End]


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"name": 3}, "a name and a unit, as text, got 3"),
        ({"name": "force", "unit": 3}, "a name and a unit, as text, got 'force' 3"),
        ({"name": "force", "unit": "N", "band": -1}, "'force': band must be 0 or more, got -1 N"),
    ],
)
def test_a_channel_that_cannot_be_is_refused(given, words):
    with pytest.raises(ExperimentError, match=words):
        Channel(**given)


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


@given(k=st.integers(0, 500), T_s=st.floats(0.01, 6.0), step=st.sampled_from([0.05, 0.1, 1 / 3]))
def test_instants_are_the_grid_and_the_end(k, T_s, step):
    start, end = k * T_s, (k + 1) * T_s
    t = instants(start, end, step)
    assert (t[0], t[-1]) == (start, end)
    assert np.all(np.diff(t) > 1e-10 * step)
    assert t[1:-1] == pytest.approx(np.round(t[1:-1] / step) * step, rel=1e-12)
    inside = [i * step for i in range(int(start / step), int(end / step) + 2)]
    close = 1e-6 * step
    expected = [g for g in inside if start + close < g < end - close]
    assert len(t) - 2 == len(expected)


@pytest.mark.parametrize("T_s", [0.25, 0.05, 0.1, 0.3, 1.5])
def test_sampling_instants_on_the_grid_come_once(T_s):
    steps = [instants(k * T_s, (k + 1) * T_s, 0.05)[1:] for k in range(40)]
    t = np.concatenate(steps)
    assert t == pytest.approx(np.arange(1, len(t) + 1) * 0.05)


def maneuver_run(name, error=0.0, theta=1.0, **changes):
    return replace(short_run([theta], kpis={"error": error}, **changes), maneuver=name)


def test_a_kpi_is_the_worst_of_all_maneuvers_beside_the_mean_and_each_of_them():
    made = combined([maneuver_run("step", 1.0), maneuver_run("load", 4.0)])
    assert dict(made.kpis) == {"error": 4.0, "error (mean)": 2.5, "error (step)": 1.0, "error (load)": 4.0}
    assert made.maneuver == ""
    assert list(by_maneuver(made)) == ["step", "load"]


def test_the_worst_follows_the_direction_or_the_target_of_a_kpi():
    runs = [maneuver_run("step", 1.0), maneuver_run("load", 4.0), maneuver_run("warm", 2.0)]
    assert combined(runs, higher_is_better=["error"]).kpis["error"] == 1.0
    assert combined(runs, targets={"error": 3.5}).kpis["error"] == 1.0
    assert np.isnan(combined([*runs, maneuver_run("cold", np.nan)]).kpis["error"])


def test_a_kpi_that_an_interrupted_maneuver_lacks_is_unknown():
    stopped = replace(maneuver_run("load", end=End.UNSAFE), kpis={})
    made = combined([maneuver_run("step", 1.0), stopped])
    assert dict(made.kpis) == {"error (step)": 1.0}
    assert made.end is End.UNSAFE


def test_interrupted_maneuvers_may_all_lack_a_kpi_that_should_be_high_or_near_a_target():
    runs = [maneuver_run(name, 1.0, end=End.UNSAFE) for name in ("step", "load")]
    made = combined(runs, higher_is_better=["yield"], targets={"mean level": 2.0})
    assert made.end is End.UNSAFE
    assert set(made.kpis) == {"error", "error (mean)", "error (step)", "error (load)"}


def test_a_kpi_of_one_maneuver_alone_has_no_mean():
    other = replace(maneuver_run("load"), kpis={"recovery": 3.0})
    assert set(combined([maneuver_run("step", 1.0), other]).kpis) == {
        "error",
        "recovery",
        "error (step)",
        "recovery (load)",
    }


def test_maneuvers_come_back_from_a_study_file():
    made = combined([maneuver_run("step", 1.0), maneuver_run("load", 4.0)])
    back = decode(encode(made))
    assert back == made
    assert [part.maneuver for part in back.runs] == ["step", "load"]
    assert b"maneuver" not in encode(short_run([1.0]))  # as files were before maneuvers


@pytest.mark.parametrize(
    ("runs", "words"),
    [
        ([], "one or more maneuvers"),
        ([maneuver_run("step"), maneuver_run("step")], "two maneuvers are called 'step'"),
        ([maneuver_run("")], "needs a name of its own"),
        ([maneuver_run("mean")], "other than 'mean'"),
        ([maneuver_run("step"), maneuver_run("load", theta=2.0)], "same θ"),
        ([replace(maneuver_run("step"), runs=(maneuver_run("a"),))], "single run"),
    ],
)
def test_what_cannot_be_combined_is_refused(runs, words):
    with pytest.raises(ExperimentError, match=words):
        combined(runs)


def test_one_run_performs_all_maneuvers_with_the_same_seed():
    seeds = []

    def step(theta, seed=0):
        seeds.append(seed)
        return short_run(theta, kpis={"error": 1.0})

    made = Maneuvers({"step": step, "load": step})(np.array([1.0]), seed=7)
    assert seeds == [7, 7]
    assert [part.maneuver for part in made.runs] == ["step", "load"]


@pytest.mark.parametrize(
    ("runs", "words"),
    [({}, "must map names to runs"), ({"step": 3}, "must be a function"), ({"": maneuver_run}, "name")],
)
def test_what_is_no_maneuver_is_refused(runs, words):
    with pytest.raises(ExperimentError, match=words):
        Maneuvers(runs)


def test_a_run_that_returns_nothing_is_named():
    with pytest.raises(ExperimentError, match="maneuver 'step' must return an Experiment"):
        Maneuvers({"step": lambda theta, seed=0: None})(np.array([1.0]))


THETA = np.array([1.0, 0.5])


def test_the_controller_acts_once_a_sampling_period_until_the_plant_has_settled():
    e = rollout(tank_env(), PI(1.0, 0.5), THETA)
    assert e.end is End.SETTLED
    assert np.array_equal(e.theta, THETA)
    assert e.x[-1, 0] == pytest.approx(2.0, abs=0.01)
    assert np.diff(e.t_control) == pytest.approx(0.5)
    assert e.duration == pytest.approx(e.t_control[-1] + 0.5)
    assert np.all(e.iterations == 3)
    assert e.solved.all()


def test_the_sampling_time_is_that_of_the_controller():
    e = rollout(tank_env(), PI(0.5, 0.1, T_s=0.3), THETA)
    assert np.diff(e.t_control) == pytest.approx(0.3)


def test_the_controller_hears_of_the_plant_as_it_is():
    controller = PI(1.0, 0.5)
    e = rollout(tank_env(), controller, THETA)
    assert [m.t for m in controller.heard] == e.t_control.tolist()
    assert np.array_equal([m.x for m in controller.heard], e.x[np.searchsorted(e.t, e.t_control - 1e-9)])
    assert np.array_equal([m.u for m in controller.heard][1:], e.u_control[:-1])
    assert controller.heard[0].u.tolist() == [0.0]


def test_an_unsolved_step_holds_the_last_input_and_is_marked():
    class Sometimes(PI):
        def move(self, m):
            n = len(self.heard)
            move = super().move(m)
            if n in (3, 4):
                return Move(np.array([4.0]), 99, solved=False)
            return Move(np.array([np.nan])) if n == 6 else move

    e = rollout(tank_env(), Sometimes(1.0, 0.5), THETA)
    assert np.flatnonzero(~e.solved).tolist() == [3, 4, 6]
    for n in (3, 4, 6):
        assert e.u_control[n] == e.u_control[n - 1]


def test_time_comes_from_the_clock_that_is_handed_in():
    ticks = count(0, 0.25)
    e = rollout(tank_env(), PI(1.0, 0.5), THETA, clock=lambda: next(ticks))
    assert np.all(e.solve_time == 0.25)


def test_indicators_are_of_the_finished_experiment():
    e = rollout(tank_env(), PI(1.0, 0.5), THETA, kpis=lambda e: {"duration": e.duration})
    assert e.kpis == {"duration": e.duration}


def test_wrapped_environments_are_driven_through_their_core():
    env = gym.wrappers.TimeLimit(PlantEnv(TANK, tank_task()), 3)
    assert rollout(env, PI(1.0, 0.5), THETA).end is End.SETTLED


def test_an_environment_without_the_protocol_is_refused():
    with pytest.raises(ExperimentError, match=r"\['measurement', 'apply', 'end', 'record'\]"):
        rollout(gym.make("CartPole-v1"), PI(1.0), THETA)


def test_inputs_of_the_wrong_shape_are_refused():
    class Wrong(PI):
        def move(self, m):
            return Move(np.zeros(2))

    with pytest.raises(PlantError, match=r"input u must have shape \(1,\), got \(2,\)"):
        rollout(tank_env(), Wrong(1.0), THETA)


class Forgetful(PI):
    def move(self, m):
        return super().move(m).u


class Unpaced:
    def move(self, m):
        return Move(np.zeros(1))


def test_a_controller_that_forgets_the_move_is_told_so():
    words = r"controller Forgetful \(test_experiment.py:\d+\) must return a prefcal_env.Move, got nd"
    with pytest.raises(SettingsError, match=words):
        rollout(tank_env(), Forgetful(1.0), THETA)


def test_a_controller_without_a_sampling_time_is_told_so():
    with pytest.raises(SettingsError, match="a controller needs T_s"):
        rollout(tank_env(), Unpaced(), THETA)


def test_kpis_without_a_return_are_refused():
    def kpis(experiment):
        {"level": 1.0}  # noqa: B018

    with pytest.raises(ExperimentError, match="got None: is a return missing"):
        rollout(tank_env(), PI(1.0), THETA, kpis=kpis)


def test_outputs_are_recorded_with_the_disturbances_and_inputs_that_were_held():
    plant = FunctionPlant(
        lambda x, u, d: [u[0] - x[0] / 2 + d[0]],
        lambda x, u, d: [x[0] + 100 * u[0] + 1000 * d[0]],
        states=[LEVEL],
        inputs=[INFLOW],
        outputs=[Channel("sum")],
        disturbances=[RAIN],
    )
    task = tank_task(d=lambda t: np.array([np.floor(t)]), settled=lambda s: False, horizon=2.0)
    e = rollout(PlantEnv(plant, task), PI(1.0, T_s=0.8), THETA)
    rain = np.where(e.t < 1.6, 0.0, 1.0)  # seen first at 1.6 s, held from there on
    np.testing.assert_allclose(e.y[:, 0], e.x[:, 0] + 100 * e.u[:, 0] + 1000 * rain)


BALL = Channel("ball", "m", symbol="p")
BEAM = Channel("beam", "rad")
MOTOR = Channel("motor", "V", low=-12.0, high=12.0)
Y0 = Channel("y0", "%", target=1.0, band=0.05)
T = np.arange(4.0)


def run(**changes):
    """A run whose curves all differ: ball 0 to 3, beam 10 to 13, motor 20 to 23, y0 30 to 33."""
    fields = {
        "theta": np.ones(1),
        "t": T,
        "x": np.stack([T, T + 10], axis=1),
        "u": T[:, None] + 20,
        "t_control": T,
        "u_control": T[:, None] + 20,
        "y_ref": np.zeros((4, 2)),
        "iterations": np.zeros(4, int),
        "solve_time": np.zeros(4),
        "solved": np.ones(4, bool),
        "end": End.TIME_UP,
        "signals": {"gap": T + 40},
        "channels": Channels((BALL, BEAM), (MOTOR,), (Channel("ball", "m", target=2.0, band=0.1), Y0)),
        "y": np.stack([T, T + 30], axis=1),
    }
    return Experiment(**fields | changes)


@pytest.mark.parametrize(
    ("panel", "first", "held"),
    [
        (Panel("ball"), 0, False),
        (Panel("beam"), 10, False),
        (Panel("motor"), 20, True),
        (Panel("y0"), 30, False),
        (Panel("gap"), 40, False),
        (Panel("p"), 0, False),
        (Panel("ball", "y"), 0, False),
        (Panel("beam", "x"), 10, False),
    ],
)
def test_a_panel_draws_the_channel_that_it_names(panel, first, held):
    plot = panel.plot(run())
    assert plot.values(run())[0] == first
    assert plot.held == held


def test_a_channel_is_found_anew_in_an_experiment_with_another_order():
    e = run()
    turned = replace(e, x=e.x[:, ::-1], channels=replace(e.channels, x=(BEAM, BALL)), y=None)
    assert Panel("beam").plot(e).values(turned)[0] == 10


def test_an_experiment_that_lacks_the_curve_has_no_values_there():
    bare = replace(run(), y=None, signals={})
    assert np.isnan(Panel("y0").plot(run()).values(bare)).all()
    assert np.isnan(Panel("gap").plot(run()).values(bare)).all()


def test_a_state_that_is_an_output_shows_the_outputs_target():
    channel = Panel("ball").plot(run()).channel
    assert (channel.target, channel.band, channel.symbol) == (2.0, 0.1, "p")


def test_a_panel_states_what_differs_from_its_channel_and_scales_the_rest():
    plot = Panel("motor", title="voltage", unit="mV", scale=1000.0, high=9000.0).plot(run())
    assert plot.channel == Channel("voltage", "mV", low=-12000.0, high=9000.0)
    assert plot.values(run())[0] == 20000.0
    assert Panel("motor", title="voltage", unit="mV", high=9000.0).plot(run()) == plot
    with pytest.raises(ScenarioError, match="its unit must be V, or one that V converts into by a factor"):
        Panel("motor", unit="A").plot(run())
    upside_down = Panel("motor", unit="-V", scale=-1.0).plot(run()).channel
    assert (upside_down.low, upside_down.high) == (-12.0, 12.0)


@pytest.mark.parametrize(
    ("panel", "words"),
    [
        (
            Panel("beem"),
            r"there are states 'ball', 'beam'; inputs 'motor'; outputs 'ball', "
            r"'y0'; signals 'gap'\. Did you mean 'beam'\?",
        ),
        (Panel("motor", "x"), "of kind 'x' has this name"),
        (Panel("ball", reference="asked"), r"no signal is called 'asked'.*there are 'gap'"),
        (Panel("motor", low=13.0), "low must be below high"),
    ],
)
def test_a_panel_without_a_curve_says_what_there_is(panel, words):
    with pytest.raises(ScenarioError, match=words):
        panel.plot(run())


def test_a_name_that_means_two_curves_is_refused():
    twice = run(channels=Channels((BALL, BALL), (MOTOR,), ()), y=None, y_ref=np.zeros((4, 0)))
    with pytest.raises(ScenarioError, match="2 curves have this name"):
        Panel("ball").plot(twice)
    assert [p.values(twice)[0] for p in plots_of(twice.channels)] == [0, 10, 20]
    noisy = run(y=run().y + 1.0)
    with pytest.raises(ScenarioError, match="a state and an output have this name, and differ"):
        Panel("ball").plot(noisy)
    assert Panel("ball", "y").plot(noisy).values(noisy)[0] == 1.0


def test_a_state_and_an_output_of_another_unit_need_a_kind():
    e = run()
    degrees = replace(e, channels=replace(e.channels, y=(Channel("beam", "°"), Y0)))
    with pytest.raises(ScenarioError, match="2 curves have this name"):
        Panel("beam").plot(degrees)
    assert Panel("beam", "x").plot(degrees).channel.unit == "rad"
    assert Panel("beam", "y").plot(degrees).channel.unit == "°"


def test_an_output_that_is_not_recorded_is_not_guessed():
    with pytest.raises(ScenarioError, match=r"does not record the output 'y0'.*y="):
        Panel("y0").plot(run(y=None))
    assert Panel("ball", "y").plot(run(y=None)).values(run(y=None))[0] == 0


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Panel("beam", "z"), r"kind must be one of \['x', 'u', 'y', 'signal'\].*got 'z'"),
        (lambda: Panel("beam", "states"), "got 'states'"),
        (lambda: Panel(""), "needs the name"),
        (lambda: Panel("beam", scale=57.3), "give the new one as unit="),
        (lambda: Panel("beam", unit="°", scale=0.0), "scale must be finite and not 0"),
        (lambda: Panel("beam", band=0.0), "band must be above 0"),
    ],
)
def test_an_impossible_panel_is_refused_where_it_is_written(make, words):
    with pytest.raises(ScenarioError, match=words):
        make()


def test_by_default_each_state_input_and_further_output_is_drawn_once():
    plots = plots_of(run().channels)
    assert [(p.kind, p.name) for p in plots] == [("x", "ball"), ("x", "beam"), ("u", "motor"), ("y", "y0")]


def limited(u, y, high=100.0, more=()):
    """A run of ten instants with a reference of 1, an input from 0 to `high`, and perhaps further outputs."""
    t, outputs = np.arange(10.0), {"y": np.array(y, dtype=float), **dict(more)}
    target = {"y": np.ones(10)}
    return recorded([1.0], t, outputs, {"valve": u}, target, limits={"valve": (0.0, high)}, kpis=None)


def test_an_input_limits_a_run_that_is_at_one_limit_while_an_output_is_away_from_its_reference():
    late, arrives = np.full(10, 0.4), [0, 0.2, 0.4, 0.6, 0.8, 1, 1, 1, 1, 1]
    assert limiting_input(limited([100.0] * 10, late)) == "valve"
    assert limiting_input(limited([100.0] * 5 + [60.0] * 5, arrives)) == "valve"  # all the way, then it rests
    assert limiting_input(limited([100.0] * 2 + [60.0] * 8, arrives)) == ""  # two of five instants
    assert (
        limiting_input(limited([0.0] * 10, np.ones(10))) == ""
    )  # it rests at a limit, and nothing is wanted
    assert limiting_input(limited([100.0, 0.0] * 5, late)) == ""  # from end to end: an oscillation
    assert limiting_input(limited([100.0] * 10, late, high=np.inf)) == ""
    assert limiting_input(limited([99.99] * 10, late)) == ""
    alone = recorded([1.0], np.arange(10.0), {"y": late}, {"valve": [100.0] * 10}, kpis=None)
    assert limiting_input(alone) == ""  # without a reference, nothing is away from it


def test_an_offset_outside_of_the_band_is_not_the_fault_of_the_limit_on_the_way():
    """At first, the largest error is 20, and the input is at its limit; then an offset of 0.5 stays."""
    run = limited([100.0] * 2 + [60.0] * 8, [21.0, 11.0] + [1.5] * 8)
    assert limiting_input(run) == "valve"  # 3 % of 20 would be less than is away
    y = replace(run.channels.y[0], band=0.2)
    assert limiting_input(replace(run, channels=replace(run.channels, y=(y,)))) == ""


def test_of_several_maneuvers_one_that_an_input_limits_is_enough():
    calm, limit = limited([60.0] * 10, np.ones(10)), limited([100.0] * 10, np.full(10, 0.4))
    assert limiting_input(replace(calm, runs=(calm, limit))) == "valve"
