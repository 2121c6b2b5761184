"""What the page sends is read strictly: either it is what was agreed on, or it is refused."""

import json
from contextlib import suppress
from typing import Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import Struct

from prefcal_app.session.actions import LONGEST_TEXT, Answer, Real, Text, Whole
from prefcal_app.web.api import MalformedError, bit, digits, read_json, read_query


class Fields(Struct, forbid_unknown_fields=True):
    n: Whole
    theta: tuple[Real, ...]
    word: Literal["left", "right"]
    on: bool
    note: Text


GOOD = {"n": 3, "theta": (1.0, 2.5), "word": "left", "on": True, "note": "θ is fine\n"}


def test_an_agreed_body_is_read():
    assert read_json(json.dumps(GOOD).encode(), Fields) == Fields(**GOOD)


WRONG = {
    "n": (3.0, True, "3", None, -1, 2**53, [3]),
    "word": ("up", ["left"], None),
    "on": (1, "true"),
    "note": (3, "a\0b", "\ud800", "\x1b[31m", "x" * (LONGEST_TEXT + 1)),
    "theta": ([10**400], [True], ["1"], [None], [[1]]),
    "more": (1,),
}


@pytest.mark.parametrize("change", [{name: value} for name, values in WRONG.items() for value in values])
def test_another_value_or_field_is_refused(change):
    with pytest.raises(MalformedError, match=r"\.$"):
        read_json(json.dumps({**GOOD, **change}).encode(), Fields)


@pytest.mark.parametrize("name", GOOD)
def test_a_missing_field_is_refused_and_named(name):
    rest = {key: value for key, value in GOOD.items() if key != name}
    with pytest.raises(MalformedError, match=f"missing required field `{name}`"):
        read_json(json.dumps(rest).encode(), Fields)


def test_a_field_that_python_may_leave_out_is_not_left_out_by_a_page():
    with pytest.raises(MalformedError, match="missing required field `comment`"):
        read_json(b'{"question": 3, "choice": "left", "blind": false}', Answer)


SHORT = (
    b"",
    b"[]",
    b"3",
    b"null",
    b"{",
    b'{"n": 1',
    b'{"n": NaN}',
    b'{"n": -Infinity}',
    b"\xff",
    b"{}\0",
    b"{} {}",
)
LONG = (b"[" * 50_000, b'{"n":' * 9_000, b'{"n": ' + b"9" * 60_000 + b"}", b'{"theta": [1e999]}')


@pytest.mark.parametrize("body", [*SHORT, *LONG, '{"n": 1}'.encode("utf-16"), b"\xef\xbb\xbf{}"])
def test_what_is_no_json_object_is_refused(body):
    with pytest.raises(MalformedError):
        read_json(body, Fields)


@given(st.binary(max_size=60))
def test_any_query_is_read_or_refused(query):
    with suppress(MalformedError):
        assert read_query(query, {"after": digits, "blind": bit}).keys() <= {"after", "blind"}


def test_a_query_is_read():
    assert read_query(b"after=12&blind=1", {"after": digits, "blind": bit}) == {"after": 12, "blind": True}
    assert read_query(b"", {"after": digits}) == {}


QUERIES = (
    b"after= after=-1 after=1.0 after=1&after=1 after x=1 & after=+1 after=%D9%A3 after=%00 "
    b"blind=2 blind=true a=%ff"
)


@pytest.mark.parametrize("query", [*QUERIES.split(), b"after=" + b"9" * 40, b"&".join([b"after=1"] * 1000)])
def test_another_query_is_refused(query):
    with pytest.raises(MalformedError):
        read_query(query, {"after": digits, "blind": bit})
