"""The sentence on why an experiment is shown: plain, and true in every case."""

import numpy as np
import pytest

from prefcal_agents.screening.reason import Reason
from prefcal_agents.utility.bank import Bank
from prefcal_scenarios.app.screening import good_on_average, why
from support.looks import toy

LEARNED = Reason(0.64, ("final",), ("t_f",), ("final",))
NOTHING = Reason(0.5, ("final",), ("t_f",), ())


def test_it_names_what_was_preferred_and_what_it_costs():
    assert why(LEARNED, toy, side="Left") == (
        "Left is shown because you preferred final level nearer to its target: it has that, but "
        "higher settling time t_f (chance that you prefer it: 64 %)."
    )
    both = Reason(0.9, ("final", "t_f"), (), ("t_f", "final"))
    assert why(both, toy, side="Right") == (
        "Right is shown because you preferred final level nearer to its target and lower settling "
        "time t_f: it has both (chance that you prefer it: 90 %)."
    )


def test_what_was_preferred_but_it_lacks_is_not_called_the_reason():
    said = why(Reason(0.1, ("t_f",), ("final",), ("final",)), toy, side="Left")
    assert said == (
        "Left shows how much final level nearer to its target matters to you: it has lower "
        "settling time t_f, but final level farther from its target (chance that you prefer it: "
        "10 %)."
    )
    assert "because" not in said


def test_before_anything_is_learned_no_preference_and_no_chance_is_claimed():
    said = why(NOTHING, toy, side="Left", good=True)
    assert said == (
        "Nothing learned yet: left is good in all KPIs on average; it has final level nearer to "
        "its target, but higher settling time t_f."
    )
    other = why(NOTHING, toy, side="Left")
    assert "good" not in other
    assert other.startswith("Nothing learned yet: left shows what matters to you; ")


def test_a_requested_one_is_shown_since_it_was_asked_for():
    for reason in (LEARNED, NOTHING):
        said = why(reason, toy, side="Right", requested=True, good=True)
        assert said.startswith("Right is shown because you asked for it: it has final level nearer")
        assert "preferred" not in said


@pytest.mark.parametrize(
    ("better", "worse", "words"),
    [
        ((), (), "its KPIs are about those of the best so far"),
        ((), ("t_f",), "it has higher settling time t_f"),
        (("t_f",), (), "it has lower settling time t_f"),
        (("t_f",), ("iae",), "it has lower settling time t_f, but higher iae"),
        (("iae_level",), (), "it has lower iae level"),
    ],
)
def test_every_kpi_has_words(better, worse, words):
    said = why(Reason(0.5, better, worse, ()), toy, requested=True)
    assert (
        said
        == f"This one is shown because you asked for it: {words} (chance that you prefer it: 50 %)."
    )


def test_no_more_than_two_kpis_are_named_on_either_side():
    names = ("t_f", "final", "a", "b")
    said = why(Reason(0.5, names, (), ()), toy, requested=True)
    assert "lower settling time t_f and final level nearer to its target (" in said
    said = why(Reason(0.5, (), names, ()), toy, requested=True)
    assert "higher settling time t_f and final level farther from its target (" in said


def test_good_on_average_is_the_best_quarter_by_mean_rank():
    kpis = np.column_stack([np.arange(8.0), [0, 1, 2, 3, 4, 5, 6, np.inf]])
    bank = Bank(np.zeros((8, 1)), np.zeros((8, 1)), ("a", "b"), kpis, np.zeros(8, dtype=bool))
    assert [good_on_average(bank, row) for row in range(8)] == [True, True, *[False] * 6]
