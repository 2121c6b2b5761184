import numpy as np
import pytest

from prefcal_agents.history.history import History
from prefcal_env.errors import ProtocolError
from prefcal_env.preferences.answer import Answer


def history(*answers):
    book = History()
    for h, answer in enumerate(answers):
        book = book.with_pending(np.array([float(h), 0.5])).told(Answer.of(answer), book.incumbent)
    return book


def test_preferences_name_the_samples_that_were_compared():
    taught = history(None, 1, -1, 0, None, Answer(-1, strength=3)).preferences()
    assert taught.first.tolist() == [1, 2, 3, 5]
    assert taught.second.tolist() == [0, 0, 2, 2]
    assert taught.b.tolist() == [1, -1, 0, -1]
    assert taught.weights.tolist() == [1, 1, 1, 3]
    assert taught.samples.shape == (6, 2)


def test_a_later_answer_keeps_its_rival_when_an_earlier_one_is_retracted():
    book = history(None, -1, -1).retracted(1)
    assert book.preferences().first.tolist() == [2]
    assert book.preferences().second.tolist() == [1]
    assert book.incumbent == 2


def test_the_first_answer_teaches_nothing():
    book = history(-1)
    assert len(book.preferences()) == 0
    assert book.incumbent == 0
    assert book.preferences().samples.shape == (1, 2)


def test_undo_drops_a_sample_that_was_proposed_after_the_answer():
    book = history(None, 1).with_pending(np.array([9.0, 9.0]))
    assert book.undone().samples == ((0.0, 0.5), (1.0, 0.5))
    assert book.undone().pending == (1.0, 0.5)


def test_an_empty_ledger_has_no_incumbent_and_nothing_to_undo():
    assert History().incumbent is None
    with pytest.raises(ProtocolError):
        History().undone()
