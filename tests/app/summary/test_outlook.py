"""Whether to go on, and knobs at the end of their range with the command that widens them."""

import shlex
from dataclasses import replace

import numpy as np
import pytest

from prefcal_app.cli.studies.commands import RespaceOptions
from prefcal_app.cli.studies.files import respace
from prefcal_app.session import Choice, actions
from prefcal_app.summary import at_end, begin_with, falls_outward, others_unbeaten, outlook, study_name
from prefcal_env.experiments.experiment import End
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.preferences.answer import Answer
from prefcal_env.preferences.history import History
from prefcal_env.study import StudyFile
from prefcal_env.study.file import study_path
from prefcal_scenarios import KPI
from prefcal_scenarios.wording import typed_theta
from support.histories import in_cube
from support.interviews import begin, clock, proceed
from toy_study import TOY, toy_scenario

PROMISE = "The chance that something better is left is 8 %."
SPACE = KnobSpace(
    [
        Knob("T_s", 0.25, 1.5, "h"),
        Knob("N_p", 4, 40, integer=True),
        Knob("gain", 0.01, 100.0, "m/%", scale="log10"),
        Knob("offset", -5.0, 3.0),
    ]
)
STATE = begin(toy_scenario()).file.state
MIDDLE = [0.9, 20.0, 1.0, 0.0]


def always(knob, upper):
    return True


def said(theta, promise=PROMISE, place="/tmp/mine.prefcal", scenario="cstr", missed=(), helps=always):
    state = replace(STATE, configuration={**STATE.configuration, "scenario": scenario})
    return outlook(promise, np.array(theta), SPACE, place, state, missed=missed, helps=helps)


def test_knobs_at_their_ends_are_named_with_the_command():
    found = said([0.25, 4, 1.0, 3.0])
    assert found.ends.startswith("T_s, N_p and offset of the best θ are at the end of their ranges")
    assert said([0.251, 4, 1.0, 3.0]).ends.startswith("T_s, N_p and offset of the best θ are near the end of")
    assert found.command == (
        "prefcal studies respace /tmp/mine.prefcal --knob T_s=0.125:1.5 --knob N_p=2:40 --knob offset=-5:5"
    )


def test_only_ends_are_named_beyond_which_something_better_is_expected():
    found = said([0.26, 4, 1.0, 3.0], helps=lambda knob, upper: (knob, upper) == (0, False))
    assert found.ends.startswith("T_s of the best θ is near the end of its range")
    assert said([0.28, 20, 1.0, 0.0]).ends == ""  # 2.4 % of the range inside
    assert said([0.25, 4, 1.0, 3.0], helps=lambda knob, upper: False).ends == ""


def test_a_cost_that_falls_toward_an_end_calls_for_a_wider_range():
    def cost(thetas):
        return thetas[:, 0]

    best = np.array([0.25, 20, 1.0, 3.0])
    assert falls_outward(cost, SPACE, best, 0, upper=False)
    assert not falls_outward(lambda thetas: -cost(thetas), SPACE, best, 0, upper=False)
    assert not falls_outward(cost, SPACE, best, 3, upper=True)  # flat


def test_no_sentence_contradicts_another():
    found = said([0.25, 20, 1.0, 0.0])
    assert found.promise.startswith("Within the present ranges, the chance that something better")
    assert found.ends.startswith("T_s of the best θ is at the end of its range; ")
    assert said([0.25, 20, 1.0, 0.0], "").sentences == (found.ends,)


def test_what_no_experiment_reaches_comes_first_too():
    place, why = "/tmp/mine.prefcal", {"never": ["settling time"], "helps": always}
    found = outlook(PROMISE, np.array(MIDDLE), SPACE, place, STATE, missed=["peak"], **why)
    assert found.missed.startswith("The best experiment misses the objective for peak")
    assert found.missed.endswith(" Not even the best experiment has a finite settling time.")
    alone = outlook(PROMISE, np.array(MIDDLE), SPACE, place, STATE, **why)
    assert alone.sentences[0] == "Not even the best experiment has a finite settling time."
    others = outlook(PROMISE, np.array(MIDDLE), SPACE, place, STATE, reached=[1, 3], **why)
    assert others.sentences[0] == (
        "The best experiment has no finite settling time, while experiments 1 and 3 reached that."
    )


@pytest.mark.parametrize("theta", [MIDDLE, [0.25, 20, 1.0, 0.0]])
@pytest.mark.parametrize("place", [":memory:", "/tmp/mine.prefcal"])
def test_missed_objectives_come_first(theta, place):
    found = said(theta, place=place, missed=["settling time", "overshoot", "peak"])
    assert found.sentences[0].startswith(
        "The best experiment misses the objectives for settling time, overshoot and peak: continue"
    )
    one = said(theta, place=place, missed=["overshoot"])
    assert one.sentences[0].startswith("The best experiment misses the objective for overshoot: ")
    assert PROMISE[1:] in one.promise


@pytest.mark.parametrize(
    ("theta", "range_"),
    [
        ([1.5, 20, 1.0, 0.0], "T_s=0.25:1.81"),
        ([0.9, 40, 1.0, 0.0], "N_p=4:49"),
        ([0.9, 20, 0.01, 0.0], "gain=0.001:100"),
        ([0.9, 20, 100.0, 0.0], "gain=0.01:1000"),
        ([0.9, 20, 1.0, -5.0], "offset=-7:3"),
    ],
)
def test_ranges_become_a_quarter_wider_and_positive_ones_stay_so(theta, range_):
    assert said(theta).command.endswith(f"--knob {range_}")


def test_nothing_is_beyond_zero_the_whole_of_a_share_and_one():
    knobs = [
        Knob("T_d", 0.0, 14.0, "s"),
        Knob("b", 0.0, 1.0),
        Knob("N", 1, 9, integer=True),
        Knob("K", -2.0, 1.0),
    ]
    space, place = KnobSpace(knobs), "/tmp/mine.prefcal"
    for theta in ([0.0, 0.0, 1, 0.0], [5.0, 1.0, 1, 0.0]):
        found = outlook(PROMISE, np.array(theta), space, place, STATE, helps=always)
        assert (found.ends, found.command) == ("", "")
    found = outlook(PROMISE, np.array([14.0, 1.0, 9, 1.0]), space, place, STATE, helps=always)
    assert found.ends.startswith("T_d, N and K of the best θ are at the end")
    assert found.command.endswith("--knob T_d=0:17.5 --knob N=1:11 --knob K=-2:1.75")


def test_the_other_end_of_a_range_keeps_all_its_digits():
    narrow = SPACE.narrowed({"T_s": (1 / 3, 1.5)})
    found = outlook(PROMISE, np.array([1.5, 20, 1.0, 0.0]), narrow, "/tmp/a.prefcal", STATE, helps=always)
    assert found.command.endswith(" --knob T_s=0.3333333333333333:1.79")


def test_a_frozen_knob_is_where_it_was_put():
    frozen = SPACE.narrowed({"T_s": (0.25, 0.25), "N_p": (10, 30)})
    assert [knob.name for knob, _ in at_end(frozen, np.array([0.25, 30, 1.0, 0.0]))] == ["N_p"]


def test_nobody_is_told_to_go_below_zero():
    # K_p cannot fall below 0.1 by a log scale; a PID refuses T_d = -2.5, to which a quarter more would lead.
    pid = KnobSpace([Knob("K_p", 0.1, 10.0, scale="log10"), Knob("T_d", 0.0, 10.0, "s"), Knob("b", 0.0, 1.0)])
    assert at_end(pid, np.array([1.0, 0.0, 0.0])) == []
    assert at_end(pid, np.array([0.1, 0.1, 1.0])) == [(pid.knobs[0], False), (pid.knobs[2], True)]


def test_without_a_file_there_is_no_command():
    found = said([0.25, 20, 1.0, 0.0], place=":memory:")
    assert found.command == ""
    assert found.ends.endswith("widen its range.")


def test_a_scenario_of_ones_own_is_named_and_a_study_of_the_data_folder_by_its_name():
    found = said([0.25, 20, 1.0, 0.0], scenario="my own.py:plant", place=str(study_path("mine")))
    assert found.command.startswith("prefcal studies respace mine --scenario 'my own.py:plant' --knob ")
    assert study_name("./a.prefcal") == "./a.prefcal"


def test_the_command_can_be_carried_out(tmp_path):
    toy = toy_scenario()
    path = tmp_path / "mine.prefcal"
    interview = begin(replace(toy, name=TOY), n_max=7, path=path)
    for _ in range(6):
        now = proceed(interview)
        best = max if now.question.left.experiment.theta[0] else min
        assert best
        low = now.question.left.experiment.theta[0] < now.question.right.experiment.theta[0]
        interview.do(actions.Answer(now.question.id, Choice.LEFT if low else Choice.RIGHT))
    theta = np.array([0.25, 20.0, 1.0])
    found = outlook(PROMISE, theta, toy.space, str(path), interview.file.state, helps=always)
    interview.file.close()
    words = found.command.split()
    assert words[:3] == ["prefcal", "studies", "respace"]
    space = respace(RespaceOptions(words[3], knob=tuple(words[7::2])), words[5])
    assert space.knobs[0].low == 0.125
    with StudyFile.open(path, clock=clock()) as file:
        assert file.state.configuration["within"]["T_s"] == [0.125, 1.5]


def test_where_the_range_of_an_input_ends_no_other_controller_is_advised():
    given = (PROMISE, np.array(MIDDLE), SPACE, "/tmp/mine.prefcal", STATE)
    usual, found = (
        outlook(*given, missed=["peak"], limiting=name, helps=always).missed for name in ("", "heater")
    )
    assert usual.endswith("widen the ranges or change the controller.")
    assert found == (
        "The best experiment misses the objective for peak: heater is at its limit for most of the time that "
        "an output is away from its reference: try a smaller step or load, or a larger range, before another "
        "controller."
    )


def test_what_misses_no_objective_is_named_before_any_other_advice():
    kpis = KPI("peak", "peak", at_most=1.0), KPI("t_f", "time", "s", at_most=5.0)
    space, ran = toy_scenario().space, toy_scenario().run(np.array([0.5, 21.0, 1.0]))
    (low, high), *rest = space.within

    def run(peak, t_f, first=low):
        theta = np.array([first, *(low for low, _ in rest)])
        return replace(ran, theta=theta).with_kpis({"peak": peak, "t_f": t_f})

    good, named = run(0.5, 4.0), {"experiment 1": run(0.5, 6.0), "experiment 2": run(2.0, 4.0)}
    assert begin_with(named, space, kpis) == ""
    assert begin_with({"experiment 1": replace(good, end=End.UNSAFE)}, space, kpis) == ""
    assert begin_with({"paper": run(0.5, 4.0, high + 1.0)}, space, kpis) == "", "the study cannot begin there"
    assert begin_with({"experiment 1": good, "paper": good}, space, kpis) == (
        "experiment 1, where the study began, misses none: go back to it, or continue"
    )
    keeping = begin_with({**named, "paper": good, "other": good}, space, kpis)
    typed = typed_theta(space, good.theta)
    assert keeping == (
        "paper misses none: to begin with it, repeat the command of the study with "
        f"{shlex.join(['--start', typed])}"
    )
    given = (PROMISE, np.array(MIDDLE), SPACE, "/tmp/mine.prefcal", STATE)
    for limiting in ("", "heater"):
        found = outlook(*given, missed=["peak"], limiting=limiting, keeping=keeping, helps=always)
        assert found.missed == f"The best experiment misses the objective for peak: {keeping}."


def recorded(*answers):
    """A record in which each new experiment met the best so far; 0 is "about the same"."""
    history = History()
    for h, answer in enumerate((None, *answers)):
        history = history.with_pending(in_cube([h / 50, 0.5]))
        history = history.with_answer(Answer.of(answer), history.incumbent)
    return history


def test_what_looked_alike_to_the_person_is_named_beside_the_result_and_is_no_slip():
    alike = "about the same as experiment 2: a tie does not change which one is the best."
    assert others_unbeaten(recorded(-1, 1)) == ""
    assert others_unbeaten(recorded(-1, 1, 0)) == f"The answers call experiment 4 {alike}"
    tied = recorded(-1, 0, 0)
    assert others_unbeaten(tied) == f"The answers call experiments 3 and 4 {alike}"
    # Asked again, the person saw a difference: the latest answer counts.
    again = tied.with_follow_up(Answer(1), 3, 1)
    assert others_unbeaten(again) == f"The answers call experiment 3 {alike}"
    chosen = tied.with_best(2)
    assert (chosen.incumbent, chosen.by_answers) == (2, 1)
    assert others_unbeaten(chosen) == (
        "The answers call experiments 2 and 3 about the same: all together they speak for 3."
    )
    assert others_unbeaten(chosen, robust=True) == (
        "The answers call experiments 2 and 3 about the same: of those shown that hold on the most varied "
        "plants, they prefer 3."
    )
    assert others_unbeaten(recorded(-1, 1).with_best(2)).endswith("so one of them is probably a slip.")
