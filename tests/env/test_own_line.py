"""Errors of people's code as text, whatever their classes do."""

from prefcal_env.errors import PlantError
from prefcal_env.wording import in_words


class MuteError(Exception):
    def __str__(self):
        raise RuntimeError("never mind")


def test_an_error_whose_message_cannot_be_read_has_words_all_the_same():
    assert in_words(MuteError()) == "MuteError: it has no readable message"


def test_ours_are_shown_as_they_are_and_others_with_their_type():
    assert in_words(PlantError("too hot")) == "too hot"
    assert in_words(KeyError("pump")) == "KeyError: 'pump'"
