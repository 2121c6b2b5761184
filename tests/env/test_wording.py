"""Names that were probably meant, and errors of people's code as text."""

import pytest

from prefcal_env.errors import PlantError
from prefcal_env.wording import did_you_mean, in_words

SCENARIOS = ("cstr", "overtake", "quadruple-tank")


@pytest.mark.parametrize(
    ("word", "names", "meant"),
    [
        ("cst", SCENARIOS, "cstr"),
        ("CSTR", SCENARIOS, "cstr"),
        ("overtke", SCENARIOS, "overtake"),
        ("quadruple_tank", SCENARIOS, "quadruple-tank"),
        ("Ts", ("T_s", "N_p", "log Q_Δu"), "T_s"),
        ("glips", ("glis", "glisp", "random"), "glisp"),  # letters that changed places
    ],
)
def test_the_nearest_name_is_offered(word, names, meant):
    assert did_you_mean(word, names) == f" Did you mean {meant!r}?"


@pytest.mark.parametrize("word", ["nowhere", "", "x"])
def test_nothing_is_offered_where_nothing_resembles_it(word):
    assert did_you_mean(word, SCENARIOS) == ""


def test_without_names_there_is_no_hint():
    assert did_you_mean("mine", []) == ""


class MuteError(Exception):
    def __str__(self):
        raise RuntimeError("never mind")


def test_an_error_whose_message_cannot_be_read_has_words_all_the_same():
    assert in_words(MuteError()) == "MuteError: it has no readable message"


def test_ours_are_shown_as_they_are_and_others_with_their_type():
    assert in_words(PlantError("too hot")) == "too hot"
    assert in_words(KeyError("pump")) == "KeyError: 'pump'"
