"""A live rig of plain data: wrongly typed values are refused with key, value and expectation."""

import copy

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from prefcal_env.errors import KnobError, LiveError, SettingsError
from prefcal_env.worlds.live import live_rig
from worlds.live.memory import Memory

FULL = {
    "url": "opc.tcp://127.0.0.1:1",
    "duration": 10,
    "period": 1.0,
    "ready_within": 60,
    "hold": 0,
    "blind": 5.0,
    "after": "keep",
    "journal": "old.json",
    "instructions": "Look at the drain.",
    "user": "tuner",
    "password_variable": "",
    "security": "",
    "timeout": 4,
    "knobs": {
        "K_p": {
            "node": "kp",
            "low": 0.2,
            "high": 10,
            "rate": 5,
            "unit": "%",
            "scale": "log",
            "integer": False,
            "step": 0.1,
            "about": "Gain.",
        }
    },
    "outputs": {"level": {"node": "level", "unit": "m", "low": 0, "high": 2, "abort": [0, 3]}},
    "inputs": {"valve": {"node": "valve", "unit": "%", "abort": [0, 100]}},
    "references": {"level": {"node": "sp", "unit": "m"}},
    "start": {
        "set-point": {
            "node": "sp",
            "value": 1.5,
            "low": 0.5,
            "high": 1.8,
            "rate": 1,
            "unit": "m",
            "integer": False,
        }
    },
    "ready": {"level": [0.9, 1.1]},
    "done": {"level": [1.4, 1.6]},
}
NUMBERS = st.integers(-5, 5) | st.floats(allow_nan=False)
TEXTS = st.text(max_size=5)
LISTS = st.lists(st.integers(-5, 5) | TEXTS, max_size=4).filter(
    lambda v: len(v) != 2 or any(isinstance(each, str) for each in v)
)
TABLES = st.dictionaries(TEXTS, st.just(None), min_size=1, max_size=2)


def places(table, way=()):
    """Every value of nested tables: its keys and the value."""
    for key, value in table.items():
        yield (*way, key), value
        if isinstance(value, dict):
            yield from places(value, (*way, key))


def wrong_for(value):
    """Values of any type that is not the one of `value`."""
    kinds = {
        bool: NUMBERS | TEXTS | LISTS | TABLES,
        str: NUMBERS | st.booleans() | LISTS | TABLES,
        int: st.booleans() | TEXTS | LISTS | TABLES,
        float: st.booleans() | TEXTS | LISTS | TABLES,
        list: NUMBERS | st.booleans() | TEXTS | LISTS | TABLES,
        dict: NUMBERS | st.booleans() | TEXTS | LISTS,
    }
    return kinds[type(value)]


def made(description):
    return live_rig(description, plant=lambda url: Memory())


def test_a_full_description_is_a_rig():
    rig = made(FULL)
    assert rig.after == "keep"
    assert rig.knobs[0].knob.scale == "log10"
    assert rig.tags[0].abort == (0.0, 3.0)
    assert rig.start[0].value == 1.5
    assert rig.hold == 0


@settings(max_examples=400, deadline=None)
@given(st.data())
def test_any_value_of_a_wrong_type_is_refused_with_its_key(data):
    way, value = data.draw(st.sampled_from(list(places(FULL))))
    wrong = data.draw(wrong_for(value))
    description = copy.deepcopy(FULL)
    table = description
    for key in way[:-1]:
        table = table[key]
    table[way[-1]] = wrong
    with pytest.raises(SettingsError) as caught:
        made(description)
    assert way[-1] in str(caught.value)
    assert "expected" in str(caught.value).lower()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"journal": ".."}, "journal: expected a file"),
        ({"after": "leave"}, "after: expected one of 'restore', 'keep', got 'leave'"),
        ({"durration": 3}, "no key 'durration'"),
        ({"knobs": {"K": {"node": "n", "low": 1, "high": 2}}}, r"knobs\.K: 'rate' is missing"),
        (
            {"knobs": {"K": {"node": "n", "low": 1, "high": 2, "rate": 1, "integer": "no"}}},
            r"knobs\.K: integer: expected true or false, got 'no'",
        ),
        ({"outputs": {"y": {"unit": "m"}}}, r"outputs\.y: 'node' is missing"),
        ({"hold": -0.5}, "hold must be 0 s or more, got -0.5"),
    ],
)
def test_a_wrong_description_is_refused_with_its_place(change, words):
    with pytest.raises(SettingsError, match=words):
        made(FULL | change)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"node": " "}, "'sp' needs the address of its node, got ' '"),
        ({"low": 3}, r"'sp': low must be below high, got \[3.0, 2.0\] m"),
        ({"high": float("inf")}, r"'sp': low and high must be finite, got \[0.0, inf\] m"),
        ({"rate": 0}, "'sp': rate must be above 0 m per second and finite, got 0"),
        ({"value": 2.5}, r"'sp' must be in \[0.0, 2.0\] m, got 2.5"),
        ({"value": 0.5, "integer": True}, "'sp' must be an integer, got 0.5"),
        ({"scale": "log"}, "no key 'scale'. Expected node, rate, value, low, high, unit, integer"),
    ],
)
def test_a_wrong_start_value_is_refused_with_its_numbers(change, words):
    start = {"node": "sp", "low": 0, "high": 2, "rate": 1, "value": 1, "unit": "m"}
    with pytest.raises((KnobError, SettingsError), match=words):
        made(FULL | {"start": {"sp": start | change}})


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"node": ""}, "'y' needs the address of its node, got ''"),
        ({"low": 2, "high": 2}, r"limits of 'y' must be low < high, got \[2.0, 2.0\] m"),
        ({"abort": [3, 0]}, r"abort of 'y' must be low < high, got \[3.0, 0.0\] m"),
        ({"band": 1}, "no key 'band'. Expected node, unit, low, high, abort"),
    ],
)
def test_a_wrong_output_is_refused_with_its_numbers(change, words):
    with pytest.raises(SettingsError, match=words):
        made(FULL | {"outputs": {"y": {"node": "y", "unit": "m"} | change}})


@pytest.mark.servers
def test_an_address_or_a_time_limit_that_opc_ua_cannot_have_is_refused():
    pytest.importorskip("asyncua")
    with pytest.raises(LiveError, match=r"begins with opc\.tcp://, got 'http://plant'"):
        live_rig(FULL | {"url": "http://plant"})
    for wrong in (0, -1.0, float("inf"), float("nan")):
        with pytest.raises(SettingsError, match="timeout must be above 0 s"):
            live_rig(FULL | {"timeout": wrong})
