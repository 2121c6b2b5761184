"""What does not fit is refused when a scenario loads, or by its first experiment, in words."""

import re
from dataclasses import replace

import numpy as np
import pytest

from prefcal_app.session import Phase
from prefcal_app.view import now_view
from prefcal_env import Channel, Channels, ClosedLoop, End, Knob, KnobSpace, Move, PlantEnv, Rig, Task
from prefcal_env.errors import ScenarioError
from prefcal_env.experiments.panels import Panel
from prefcal_env.plants import FunctionPlant
from prefcal_scenarios.scenario import KPI, Scenario, check_experiment
from support.interviews import begin, proceed, reopened
from toy_study import toy_scenario

TOY = toy_scenario()
MIDDLE = np.array([0.875, 22.0, 1.0])
BEAM = Channel("beam angle", "rad")
PLANT = FunctionPlant(
    lambda x, u, d: [x[1], u[0] - x[1]],
    lambda x, u, d: [10 * x[1] + u[0]],
    states=[Channel("ball position", "m"), BEAM],
    inputs=[Channel("motor", "V", low=-1, high=1)],
    outputs=[Channel("y0", "%")],
)
TASK = Task(x0=np.zeros(2), u0=np.zeros(1), y_ref=np.ones(1), horizon=1.0)


class Constant:
    T_s = 0.1

    def __init__(self, theta):
        self.u = theta

    def move(self, measurement):
        return Move(self.u)


class Forgetful(Constant):
    def move(self, measurement):
        return self.u


class Broken(Constant):
    def move(self, measurement):
        return Move(np.array([measurement.x[7]]))  # there are two


def own(controller=Constant, kpi_function=None, run=None, **parts):
    loop = ClosedLoop(PlantEnv(PLANT, TASK), controller, kpi_function)
    return Scenario("own", "Own", KnobSpace([Knob("K", 0, 1)]), run or loop, **parts)


def hidden(controller=Constant, kpis=None):
    """A run that says nothing of its channels before it has run."""
    loop = ClosedLoop(PlantEnv(PLANT, TASK), controller, kpis)
    return lambda theta, seed=0: loop(theta, seed)


def nothing(experiment):
    {"settled": 1.0}  # noqa: B018


def settled(experiment):
    return {"settled": 1.0}


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ({"panels": (Panel("beam angel"),)}, r"there are states.* Did you mean 'beam angle'\?"),
        ({"panels": (Panel("beam angle", "y"),)}, "of kind 'y' has this name"),
        ({"panels": (Panel("gap"),)}, "outputs 'y0'"),
        ({"panels": (Panel("y0", reference="asked"),)}, "no signal is called 'asked'"),
        ({"panels": Panel("y0")}, r"panels must be a tuple; of one write \(Panel"),
        ({"panels": ("y0",)}, r"panels must hold Panel\('level'\), got 'y0'"),
        ({"kpis": (KPI("a", "a"), KPI("a", "b"))}, r"names of KPIs must differ, got \['a'\]"),
        ({"kpis": (KPI("a", "a"),)}, "has the KPI 'a', but its run computes none"),
        ({"cost": 3.0}, "cost must be a function or None, got 3.0"),
        ({"calibrators": {"me": 1}}, "calibrator 'me' must be made by a function"),
        ({"run": 3}, "run must be a function of θ"),
    ],
)
def test_what_is_known_without_a_run_is_refused_when_the_scenario_is_made(parts, words):
    with pytest.raises(ScenarioError, match=words):
        own(**parts)


def test_a_scenario_that_fits_its_run_is_made():
    made = own(panels=[Panel("y0"), Panel("beam angle", "x"), Panel("motor")])
    e = made.run(np.array([0.5]))
    assert check_experiment(made, e.theta, e) is e
    y0, beam, motor = (panel.plot(e).values(e) for panel in made.panels)
    np.testing.assert_array_equal(beam, e.x[:, 1])
    np.testing.assert_array_equal(motor, e.u[:, 0])
    np.testing.assert_allclose(y0, 10 * e.x[:, 1] + e.u[:, 0])


def test_a_rigs_panels_and_kpis_are_known_before_a_person_runs_it():
    rig = Rig(TOY.run(MIDDLE).channels, (2.0,))
    with pytest.raises(ScenarioError, match="its run computes none"):
        replace(TOY, run=rig)
    with pytest.raises(ScenarioError, match="states 'level <h>'; inputs 'valve'"):
        replace(TOY, run=rig, kpis=(), panels=(Panel("gap"),))


def test_a_kpi_that_no_value_can_meet_is_refused():
    with pytest.raises(ScenarioError, match="at_least must not be above at_most, got 2 and 1 m"):
        KPI("a", "a", "m", at_most=1, at_least=2)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"panels": (Panel("gap"),), "run": hidden()}, "channel or signal has this name; there"),
        (
            {"kpis": (KPI("setled", "s"),), "kpi_function": settled},
            r"no run returns the KPI 'setled'; there are 'settled'.* Did you mean 'settled'\?",
        ),
        ({"kpis": (KPI("settled", "s"),), "run": hidden()}, "'settled', or any other: is kpis="),
        (
            {"kpis": (KPI("settled", "s"),), "kpi_function": nothing},
            r"nothing \(test_checks.py:\d+\) must return a mapping.*got None: is a return missing\?",
        ),
        (
            {"controller": Forgetful},
            r"move of controller Forgetful \(test_checks.py:\d+\) must return a prefcal_env.Move",
        ),
        (
            {"controller": Broken},
            r"IndexError: index 7 .*\(in test_checks.py:\d+: "
            r"return Move\(np.array\(\[measurement.x\[7\]\]\)\)",
        ),
        ({"run": lambda theta, seed=0: None}, "must return an Experiment, got NoneType: is a ret"),
    ],
)
def test_the_first_run_shows_what_does_not_fit_and_the_page_says_so(change, words):
    controller = change.get("controller", Constant)
    run = change.get("run") or hidden(controller, change.get("kpi_function"))
    parts = {name: value for name, value in change.items() if name in ("panels", "kpis")}
    interview = begin(own(run=run, **parts))
    now = proceed(interview)
    assert now.phase is Phase.FAILED
    assert re.search(words, now_view(interview)["problem"])
    assert not now.state.finished


def test_a_run_that_was_interrupted_may_leave_kpis_out_but_the_next_may_not():
    def run(theta, seed=0):
        ends.append(End.UNSAFE if not ends else End.TIME_UP)
        return replace(TOY.run(theta, seed), end=ends[-1], kpis={})

    ends = []
    interview = begin(replace(TOY, run=run))
    assert proceed(interview).phase is Phase.FAILED
    assert len(ends) == 2
    assert "or any other" in interview.now().problem


def test_later_runs_may_leave_a_kpi_out():
    def run(theta, seed=0):
        count.append(theta)
        e = TOY.run(theta, seed)
        return e if len(count) == 1 else replace(e, kpis={})

    count = []
    assert proceed(begin(replace(TOY, run=run))).phase is Phase.QUESTION


def test_a_theta_may_be_rounded_but_must_not_be_another_one():
    e = TOY.run(MIDDLE)
    assert check_experiment(TOY, MIDDLE, replace(e, theta=[0.9, 22.0, 1.0]))
    for other in ([0.3, 22.0, 1.0], [0.875, 22.0, 30.0], [22.0, 0.875, 1.0]):
        with pytest.raises(ScenarioError, match="was to be run"):
            check_experiment(TOY, MIDDLE, replace(e, theta=other))
    with pytest.raises(ScenarioError, match=r"shape \(1,\), but 3 knobs"):
        check_experiment(TOY, MIDDLE, replace(e, theta=[0.9]))


def test_experiments_from_before_a_panel_was_added_are_shown_without_it(tmp_path):
    path = tmp_path / "a.prefcal"
    interview = begin(TOY, path=path)
    proceed(interview)
    interview.file.close()
    more = replace(TOY, panels=(*TOY.panels, Panel("gap", unit="m")))
    question = now_view(reopened(more, path))["question"]
    assert question["panels"][2]["title"] == "gap"
    assert question["left"]["curves"][2] == []
    assert question["left"]["stories"][2] == "gap: no values"


def test_a_scenario_says_plainly_whether_it_may_run_unseen():
    assert replace(TOY, simulated=True).simulated
    assert not TOY.simulated
    with pytest.raises(ScenarioError, match="simulated must be True or False, got 'yes'"):
        replace(TOY, simulated="yes")


def test_nothing_runs_unseen_on_a_rig():
    rig = Rig(channels=Channels(x=(Channel("level", "m"),), u=(), y=(Channel("level", "m"),)), y_ref=(1.0,))
    with pytest.raises(ScenarioError, match="simulated must be False for a rig"):
        replace(TOY, run=rig, panels=(), kpis=(), simulated=True)
