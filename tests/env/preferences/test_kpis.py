"""What an agent may know of an experiment: numbers by name, through JSON and back."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefcal_env import Answer
from prefcal_env.errors import PreferenceError
from prefcal_env.preferences.answer import Outcome

KPIS = st.dictionaries(st.text(max_size=5), st.floats(width=64), max_size=5)


@given(KPIS)
def test_nan_is_unknown_and_all_else_stays(kpis):
    known = {name: value for name, value in kpis.items() if not np.isnan(value)}
    assert Outcome(kpis) == known
    assert list(Outcome(kpis)) == sorted(known)


@given(KPIS, st.none() | KPIS)
def test_an_answer_with_outcomes_survives_strict_json(new, old):
    answer = Answer(-1, outcomes=(new, old))
    text = json.dumps(answer.to_dict(), allow_nan=False)
    read = Answer.from_dict(json.loads(text))
    assert read == answer
    assert hash(read) == hash(answer)


def test_equal_outcomes_are_equal_and_hash_alike_whatever_their_order():
    one, two = Outcome({"a": 1, "b": 0.0}), Outcome({"b": -0.0, "a": np.float32(1)})
    assert one == two
    assert hash(one) == hash(two)
    assert one != Outcome({"a": 1})
    assert len({one, two, Outcome({"a": 2, "b": 0.0})}) == 2


def test_it_cannot_be_changed_by_the_one_who_gave_it():
    given_ = {"a": 1.0}
    outcome = Outcome(given_)
    given_["a"] = 2.0
    assert outcome["a"] == 1.0
    with pytest.raises(TypeError):
        outcome["a"] = 3.0  # type: ignore[index]


@pytest.mark.parametrize(
    "kpis", [3, "a", [("a", 1)], {"a": "1"}, {"a": None}, {1: 2.0}, {"a": [1]}, {"a": 10**400}]
)
def test_what_is_no_outcome_is_refused(kpis):
    with pytest.raises(PreferenceError):
        Outcome(kpis)
    with pytest.raises(PreferenceError):
        Answer(0, outcomes=(kpis, None))


@pytest.mark.parametrize("data", [3, [], {"a": "never"}, {"a": None}, {"a": []}, {"a": {}}])
def test_stored_data_that_is_no_outcome_is_refused(data):
    with pytest.raises(PreferenceError):
        Outcome.from_dict(data)
    with pytest.raises(PreferenceError):
        Answer.from_dict({**Answer(0).to_dict(), "outcomes": [data, None]})


@pytest.mark.parametrize("outcomes", [(1, 2, 3), ({},), "ab", 5, ({}, {}, {})])
def test_outcomes_other_than_a_pair_are_refused(outcomes):
    with pytest.raises(PreferenceError, match="outcomes"):
        Answer(0, outcomes=outcomes)
