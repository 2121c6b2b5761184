"""The sentence on why an experiment is shown: plain, and true in every case."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from prefcal_agents.learned_cost import LearnedCost
from prefcal_agents.result import Influence, SmallerChange
from prefcal_agents.screening.findings import Alternative, Findings, Reason
from prefcal_app.session.study import trust_text
from prefcal_app.simulating import as_shown, at_stake, carried_by, menu_names, rival, why
from prefcal_app.simulating.why import kept, name_wishes
from prefcal_scenarios import load
from prefcal_scenarios.scenario import KPI
from support.looks import toy

BETTER = Reason(0.64, ("final",), ("t_f",))
COSTS = "final level nearer to its target, but higher settling time t_f"
CHANCE = "(chance that you prefer it: 64 %)"


@pytest.mark.parametrize(
    ("case", "words"),
    [
        ({}, f"Right has {COSTS} {CHANCE}."),
        ({"learned": False}, f"Nothing learned yet: right has {COSTS}."),  # and no chance is claimed
        ({"requested": True}, f"Right is shown because you asked for it: it has {COSTS} {CHANCE}."),
        (
            {"missed": ["final level"]},
            f"Right has {COSTS} {CHANCE}. It misses the objective for final level.",
        ),
    ],
)
def test_it_names_what_is_better_what_that_costs_and_why_it_is_shown(case, words):
    assert why(BETTER, toy, side="Right", **case) == words


@pytest.mark.parametrize(
    ("better", "worse", "words"),
    [
        ((), (), "has about the KPIs of the best so far"),
        ((), ("t_f",), "has higher settling time t_f"),
        (("t_f",), (), "has lower settling time t_f"),
        (("t_f",), ("iae",), "has lower settling time t_f, but higher iae"),
        (("iae_level",), (), "has lower iae level"),
    ],
)
def test_every_kpi_has_words(better, worse, words):
    said = why(Reason(0.5, better, worse), toy)
    assert said == f"This one {words} (chance that you prefer it: 50 %)."


def test_the_knobs_that_can_stay_are_named():
    assert kept(SmallerChange((0.5, 10.0, 1.0), (0, 2), 0.031), toy) == (
        "2 of 3 knobs can stay as before (T_s and gain) without looking noticeably worse "
        "(chance that it does: 3 %)."
    )
    assert kept(None, toy) == ""


def test_no_more_than_two_kpis_are_named_on_either_side():
    names = ("t_f", "final", "a", "b")
    said = why(Reason(0.5, names, ()), toy)
    assert "lower settling time t_f and final level nearer to its target (" in said
    said = why(Reason(0.5, (), names), toy)
    assert "higher settling time t_f and final level farther from its target (" in said


def ran(**kpis):
    """An experiment of the toy with other KPIs."""
    return toy.run([0.5, 21.0, 1.0]).with_kpis(kpis)


def test_what_reads_the_same_is_not_named():
    new, best = ran(t_f=4.0, final=2.0), ran(t_f=4.0000001, final=2.0)
    found = as_shown(Reason(0.5, ("t_f",), ("final",)), toy, new, best)
    assert (found.better_in, found.worse_in) == ((), ())


def test_what_noise_hides_is_no_reason():
    lag = load("lag")  # its temperature has noise of 0.1 °C
    best = lag.run(lag.space.decode(np.full(len(lag.space), 0.5)))
    step = abs(best.reference(0) - best.output(0)[0]).max()
    least = 100 * 0.1 / step  # % of the step
    named = {}
    for share in (0.9, 1.1):
        kpis = {**best.kpis, "overshoot": 10.0 + share * least, "disturbance_peak": 4.0 - share * 0.1}
        new = best.with_kpis(kpis)
        old = best.with_kpis({**kpis, "overshoot": 10.0, "disturbance_peak": 4.0})
        found = as_shown(Reason(0.5, ("disturbance_peak",), ("overshoot",)), lag, new, old)
        named[share] = found.better_in, found.worse_in
    assert named == {0.9: ((), ()), 1.1: (("disturbance_peak",), ("overshoot",))}


def test_a_difference_that_hardly_anybody_notices_is_not_named():
    best = ran(t_f=4.0, final=1.9)
    for t_f, named in ((3.1, ()), (2.9, ("t_f",))):
        reason = Reason(0.5, ("t_f",), (), noticed={"t_f": 1.0})
        found = as_shown(reason, toy, ran(t_f=t_f, final=1.9), best)
        assert (found.better_in, found.worse_in) == (named, ())
    alike = as_shown(reason, toy, ran(t_f=3.1, final=1.9), best)
    assert "has about the KPIs of the best so far" in why(alike, toy)


def test_a_small_difference_beyond_an_objective_is_named():
    limited = replace(toy, kpis=tuple(replace(k, at_most=4.0) if k.name == "t_f" else k for k in toy.kpis))
    reason = Reason(0.5, ("t_f",), (), noticed={"t_f": 0.1})
    found = as_shown(reason, limited, ran(t_f=3.99, final=1.9), ran(t_f=4.01, final=1.9))
    assert found.better_in == ("t_f",)
    assert as_shown(reason, limited, ran(t_f=3.97, final=1.9), ran(t_f=3.99, final=1.9)).better_in == ()


def test_times_that_differ_by_one_sample_are_not_named():
    lag = load("lag")
    best = lag.run(lag.space.decode(np.full(len(lag.space), 0.5)))
    sample = float(best.t[1] - best.t[0])
    reason = Reason(0.5, ("settling_time",), ())
    for samples, named in ((1, ()), (2, ("settling_time",))):
        new = best.with_kpis({**best.kpis, "settling_time": 40.0})
        old = best.with_kpis({**best.kpis, "settling_time": 40.0 + samples * sample})
        assert as_shown(reason, lag, new, old).better_in == named


def test_what_differs_is_named_though_it_hardly_matters_to_the_model():
    new, best = ran(t_f=4.0, final=2.0), ran(t_f=5.0, final=2.0)
    assert as_shown(Reason(0.5, (), ()), toy, new, best).better_in == ("t_f",)
    turned = as_shown(Reason(0.5, ("t_f",), ()), toy, best, new)
    assert turned.worse_in == ("t_f",)  # what was measured counts, not what was expected


def test_the_question_says_that_its_answer_hardly_changes_the_result():
    assert at_stake(0.35) == at_stake(0.05) == ""
    assert at_stake(0.03) == "Your answer hardly changes the result (chance: 3 %)."


def test_the_answer_that_carries_the_result_is_named():
    assert carried_by(Influence(4, 6, 0.3, sure=True)) == (
        "The result rests on the answer about experiment 5: if it were the other way round, "
        "experiment 7 would be the best."
    )
    found = Findings(True, 9, best=2, influences=(Influence(4, 6, 0.3, sure=True),))
    runs = {2: ran(t_f=4.0, final=2.0), 6: ran(t_f=5.0, final=2.0)}
    unit = next(kpi.unit for kpi in toy.kpis if kpi.name == "t_f")
    said = rival(found, toy, runs.__getitem__)
    assert said == f"Experiment 7 has settling time t_f 5 {unit} (result: 4 {unit})."
    assert rival(found, toy, {2: runs[2], 6: runs[2]}.__getitem__) == ""
    assert rival(replace(found, influences=()), toy, runs.__getitem__) == ""
    assert carried_by(None) == "No single answer that is in doubt would surely change the result."


@pytest.mark.parametrize(("chance", "named"), [(0.09, False), (0.1, True)])
def test_that_the_last_winner_rests_on_its_last_answer_is_said_only_if_that_is_in_doubt(chance, named):
    found = Findings(True, 40, influences=(Influence(6, 5, chance, sure=True),), best=6)
    assert (found.decisive is not None) == named


RESULT = {"t_f": 5.0, "final": 1.0, "J": 10.0}


@pytest.mark.parametrize(
    ("menu", "names"),
    [
        ([{"t_f": 4.0}], ["lower settling time t_f"]),
        # The largest price is named, and what is never reached is the largest.
        ([{"t_f": 4.0, "final": 1.1, "J": 15.0}], ["lower settling time t_f, but higher cost J"]),
        ([{"J": 9.0, "final": 1.1, "t_f": np.inf}], ["lower cost J, but higher settling time t_f"]),
        # Nothing that can be read is gained.
        ([{"final": 2.0}, {}], ["", ""]),
        # Two that would be called the same: another gain names the second, or it is left out.
        ([{"t_f": 4.0}, {"t_f": 3.0, "J": 9.0}], ["lower settling time t_f", "lower cost J"]),
        ([{"t_f": 4.0}, {"t_f": 3.9}], ["lower settling time t_f", ""]),
    ],
)
def test_candidates_are_named_by_what_they_gain_and_at_what_price(menu, names):
    gains = ["t_f", "J", "final"]
    others = [Alternative((0.5, 10.0, 1.0), tuple(n for n in gains if n in kpis)) for kpis in menu]
    scenario = replace(toy, kpis=(*toy.kpis, KPI("J", "cost J", better="lower")))
    assert menu_names(others, [RESULT | kpis for kpis in menu], RESULT, scenario) == names


@pytest.mark.parametrize(
    ("wishes", "words"),
    [
        ({"t_f": 0.981}, "lower settling time t_f (98 %)"),
        (
            {"t_f": 0.9, "iae": 0.85, "final": 0.8},
            "lower settling time t_f (90 %), lower iae (85 %) and final level nearer to its target (80 %)",
        ),
        ({"margin": 0.9}, "higher stability margin (90 %)"),
    ],
)
def test_what_was_wanted_is_said_with_its_certainty_and_without_a_limit(wishes, words):
    margin = KPI("margin", "stability margin", "dB", better="higher")
    scenario = SimpleNamespace(kpis=(*toy.kpis, margin))
    index = LearnedCost({}, predicted=9, answers=9)
    found = Findings(over=True, simulated=9, wishes=tuple(wishes.items()))
    assert name_wishes(found, scenario, index) == f"The answers fit these wishes: {words}."
    nothing = Findings(over=True, simulated=9)
    assert name_wishes(nothing, scenario, index) == name_wishes(nothing, scenario, None) == ""
    # "Above 99 %" from four answers stood beside "3 of 4, which is not clearly better than chance".
    poor = replace(index, predicted=3, answers=4)
    assert trust_text(poor).startswith("A weighted sum of the KPIs predicted 3 of 4 answers that it had not")
    assert name_wishes(found, scenario, poor) == (
        "Which KPIs decided the answers is not said: of the 4 that prefer a side, 3 could be predicted from "
        "the KPIs and the other answers, and guessing may do as well."
    )
    assert name_wishes(found, scenario, None) == "The answers are too few to say which KPIs decided them."


def test_what_was_noticed_only_beyond_a_stated_limit_is_said_as_the_limit():
    margin = KPI("margin", "stability margin", "dB", better="higher", at_least=6.0)
    scenario = SimpleNamespace(kpis=(*toy.kpis, margin))
    index = LearnedCost({}, predicted=9, answers=9)
    found = Findings(over=True, simulated=9, wishes=(("t_f", 0.9),), bounds=(("margin", 0.98),))
    said = "The answers fit these wishes: lower settling time t_f (90 %) and stability margin ≥ 6 dB (98 %)."
    assert name_wishes(found, scenario, index) == said
