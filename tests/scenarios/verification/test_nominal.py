"""What KPIs are with other draws of the sensor noise than that of the study, which may favor a tuning."""

from dataclasses import replace
from itertools import count
from types import SimpleNamespace

import numpy as np
import pytest

from prefcal_env.experiments.experiment import End
from prefcal_env.sources.source import Function
from prefcal_scenarios import load
from prefcal_scenarios.runs import Simulated
from prefcal_scenarios.scenario import KPI
from prefcal_scenarios.verification import verify
from prefcal_scenarios.verification.nominal import DRAWS, Noise, Redrawn, compare_draws, noise_of, run_again

SETTLING = KPI("settling", "settling time", "s", at_most=5.0)
OVERSHOOT = KPI("overshoot", "overshoot", "%", better="lower")
M_S = KPI("M_s", "maximum sensitivity M_s", at_most=2.0, margin=True)
PLAIN = KPI("power", "power", "W")


def run(end=End.TIME_UP, **kpis):
    return SimpleNamespace(end=end, kpis=kpis)


def runs(name, values):
    return [run(**{name: value}) for value in values]


def compared(kpi, own, *drawn, unit="s"):
    return compare_draws([kpi], runs(kpi.name, own), [runs(kpi.name, each) for each in drawn], unit)


def test_medians_and_spans_stand_beside_each_other_with_how_often_it_is_better():
    after, before = [2.0] * 5 + [3.0] * 10 + [4.0] * 5, [12.0] * 10 + [14.0] * 10
    found = compared(OVERSHOOT, (2.5, 13.0), after, before)
    assert found.rows == (("overshoot [%]", "3 (2 to 4)", "13 (12 to 14)", "20 of 20"),)
    assert (found.unsteady, found.remarks) == ({}, ())
    assert found.texts == (
        "with the next 20 seeds, before → after: median (lowest to highest)",
        "overshoot [%]: 13 (12 to 14) → 3 (2 to 4), better with 20 of 20",
    )
    alone = compared(OVERSHOOT, (2.5,), after)
    assert alone.rows == (("overshoot [%]", "3 (2 to 4)"),)
    assert alone.texts[0] == "with the next 20 seeds: median (lowest to highest)"
    assert not Redrawn()
    assert Redrawn().texts == ()


@pytest.mark.parametrize(
    ("fewer", "own", "said"),
    [
        (20, (1.0, 2.0), ""),
        (19, (1.0, 2.0), ""),
        (18, (1.0, 2.0), "better with 18 of 20"),
        (2, (3.0, 2.0), "worse with 18 of 20"),
        (1, (3.0, 2.0), ""),
        (10, (2.0, 2.0), ""),  # the study has no change that could be noise
    ],
)
def test_a_change_is_noise_if_fewer_than_19_of_20_draws_have_it(fewer, own, said):
    after = [1.0] * fewer + [3.0] * (DRAWS - fewer)
    found = compared(OVERSHOOT, own, after, [2.0] * DRAWS)
    assert found.unsteady == ({"overshoot": said} if said else {})


def test_the_same_value_is_neither_better_nor_worse():
    found = compared(OVERSHOOT, (1.0, 2.0), [2.0] * DRAWS, [2.0] * DRAWS)
    assert found.unsteady == {"overshoot": "better with 0 of 20"}


@pytest.mark.parametrize(
    ("own", "missed", "said"),
    [
        (4.0, 0, ()),
        (4.0, 3, ("settling time ≤ 5 s is kept with 17 of 20 draws",)),
        (4.0, 20, ("settling time ≤ 5 s is kept with 0 of 20 draws",)),
        (6.0, 3, ("settling time ≤ 5 s is kept with 17 of 20 draws",)),
        (6.0, 0, ("settling time ≤ 5 s is kept with 20 of 20 draws",)),
        (6.0, 20, ()),  # the table says already that it is not kept
    ],
)
def test_a_limit_that_only_some_draws_keep_is_said(own, missed, said):
    values = [*np.linspace(3.9, 4.1, DRAWS - missed), *np.linspace(5.9, 6.1, missed)]
    remarks = compared(SETTLING, (own,), values).remarks
    assert tuple(each for each in remarks if "kept" in each) == said


def test_a_value_that_the_draw_of_the_study_alone_has_is_said():
    after, before = np.linspace(2.0, 3.0, DRAWS), np.linspace(11.0, 12.0, DRAWS)
    found = compared(SETTLING, (3.4, 14.2), after, before)
    assert found.remarks == (
        "settling time before is 14.2 s with the draw of the study alone, 11 to 12 s with the others",
    )
    lucky = compared(SETTLING, (1.2,), after).remarks
    assert lucky == ("settling time is 1.2 s with the draw of the study alone, 2 to 3 s with the others",)
    never = compared(SETTLING, (3.0,), [*after[:-2], np.inf, np.inf])
    assert never.rows[0][1].endswith("to never)")
    assert "settling time is never with 2 of 20 draws" in never.remarks


def test_noise_that_the_study_lacks_is_told_with_what_it_makes_much_worse():
    after, before = np.linspace(300.0, 400.0, DRAWS), np.linspace(30.0, 40.0, DRAWS)
    own, drawn = runs("overshoot", (140.0, 20.0)), [runs("overshoot", each) for each in (after, before)]
    found = compare_draws([OVERSHOOT], own, drawn, "s", "the noise of step.csv, 0.4 °C")
    assert found.lacking == "the noise of step.csv, 0.4 °C"
    assert found.texts[0] == (
        "with 20 draws of the noise of step.csv, 0.4 °C, before → after: median (lowest to highest)"
    )
    # The tuning before rises by less than twice.
    assert found.remarks == ("overshoot is 140 % without that noise, 300 to 400 % with it",)
    assert found.unsteady == {}


def test_runs_that_end_early_are_counted_and_have_no_kpis():
    after = [*runs("overshoot", [1.0] * 18), run(End.UNSAFE, overshoot=0.0), run(End.FAILED)]
    found = compare_draws(
        [OVERSHOOT], runs("overshoot", (1.0, 2.0)), [after, runs("overshoot", [2.0] * 20)], "s"
    )
    assert found.rows == (("overshoot [%]", "1", "2", "18 of 20"),)
    assert found.remarks == ("with 2 of 20 draws, the run ends early",)
    none = compare_draws([OVERSHOOT], runs("overshoot", (1.0,)), [[run(End.UNSAFE)] * 20], "s")
    assert none.rows == (("overshoot [%]", "–"),)


def test_margins_have_no_noise_and_what_has_no_goal_is_not_better():
    own = [run(M_s=1.5, power=2.0), run(M_s=1.8, power=3.0)]
    found = compare_draws([M_S, PLAIN, SETTLING], own, [own[:1] * DRAWS, own[1:] * DRAWS], "s")
    assert found == Redrawn((("power [W]", "2", "3"),))


def test_runs_have_the_seeds_that_follow_that_of_the_study():
    lag = load("lag")
    theta = lag.space.decode(np.full(len(lag.space), 0.5))
    assert noise_of(lag.source) == Noise()
    ((first, *rest),) = run_again(lag.source, [theta], 7)
    assert len(rest) == DRAWS - 1
    assert first.kpis == lag.run(theta, seed=8).kpis
    assert rest[-1].kpis == lag.run(theta, seed=27).kpis
    assert len({each.kpis["overshoot"] for each in (first, *rest)}) == DRAWS
    assert noise_of(load("cstr").source) is None


def test_nobody_waits_for_runs_that_take_long_and_an_error_of_own_code_is_said():
    made, lag = [], load("lag")
    theta = lag.space.decode(np.full(len(lag.space), 0.5))

    def slow(theta, seed=0):
        made.append(seed)
        return lag.run(theta, seed=seed)

    ticks = (5.0 * k for k in count())
    said = run_again(Function(slow), [theta], 0, clock=lambda: next(ticks))
    assert said == "20 runs take more than 20 s: prefcal verify makes them"
    assert made == [1, 2]

    def fails(theta, seed=0):
        raise RuntimeError(f"no plant {seed}")

    assert run_again(Function(fails), [theta], 0) == "a run failed: no plant 1"


def test_a_verification_makes_the_same_runs_for_the_result_and_the_tuning_before():
    lag = load("lag")
    thetas = [lag.space.decode(np.full(len(lag.space), share)) for share in (0.5, 0.4)]
    found = verify(lag, thetas[0], 2, start=thetas[1], noise=4, jobs=1)
    drawn = run_again(lag.source, thetas, 4)
    own = [Simulated.of(lag.run(theta, seed=4)) for theta in thetas]
    assert found.with_other_noise == compare_draws(lag.kpis, own, drawn, found.tuning.time_unit)
    values = [each.kpis["overshoot"] for each in drawn[0]]
    assert [run.kpis["overshoot"] for run in found.tuning.draws] == values
    assert len(found.runs) == 2
    assert [len(row) for row in found.with_other_noise.rows] == [4] * len(found.with_other_noise.rows)


def test_runs_that_were_interrupted_say_nothing_of_noise():
    lag = load("lag")
    found = verify(lag, lag.space.decode(np.full(len(lag.space), 0.5)), 2, jobs=1)
    cut = replace(found, tuning=replace(found.tuning, draws=found.tuning.draws[:5]))
    assert found.with_other_noise
    assert not cut.with_other_noise
