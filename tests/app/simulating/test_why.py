"""The sentence on why an experiment is shown: plain, and true in every case."""

import pytest

from prefcal_agents.screening.reason import Reason
from prefcal_app.simulating import as_shown, why
from support.looks import toy

BETTER = Reason(0.64, ("final",), ("t_f",))


def test_it_names_what_is_better_and_what_that_costs():
    assert why(BETTER, toy, side="Left") == (
        "Left has final level nearer to its target, but higher settling time t_f (chance that "
        "you prefer it: 64 %)."
    )


def test_before_anything_is_learned_no_preference_and_no_chance_is_claimed():
    assert why(BETTER, toy, side="Left", learned=False) == (
        "Nothing learned yet: left has final level nearer to its target, but higher settling time t_f."
    )


def test_a_requested_one_is_shown_since_it_was_asked_for():
    said = why(BETTER, toy, side="Right", requested=True)
    assert said.startswith("Right is shown because you asked for it: it has final level nearer")
    assert "answers" not in said


@pytest.mark.parametrize(
    ("better", "worse", "words"),
    [
        ((), (), "reads like the best so far in all KPIs"),
        ((), ("t_f",), "has higher settling time t_f"),
        (("t_f",), (), "has lower settling time t_f"),
        (("t_f",), ("iae",), "has lower settling time t_f, but higher iae"),
        (("iae_level",), (), "has lower iae level"),
    ],
)
def test_every_kpi_has_words(better, worse, words):
    said = why(Reason(0.5, better, worse), toy)
    assert said == f"This one {words} (chance that you prefer it: 50 %)."


def test_objectives_that_only_the_new_one_misses_are_named():
    said = why(Reason(0.5, ("t_f",), ()), toy, side="Left", missed=["final level"])
    assert said == (
        "Left has lower settling time t_f (chance that you prefer it: 50 %). It misses the "
        "objective for final level."
    )


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


def test_what_differs_is_named_though_it_hardly_matters_to_the_model():
    new, best = ran(t_f=4.0, final=2.0), ran(t_f=5.0, final=2.0)
    assert as_shown(Reason(0.5, (), ()), toy, new, best).better_in == ("t_f",)
    turned = as_shown(Reason(0.5, ("t_f",), ()), toy, best, new)
    assert turned.worse_in == ("t_f",)  # what was measured counts, not what was expected
