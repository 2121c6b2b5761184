"""A rig's records: what is taken, and how everything else is refused."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefcal_env.errors import RecordError, ScenarioError, SettingsError
from prefcal_env.experiment import Channel, Channels, End
from prefcal_env.rig import Rig

CHANNELS = Channels(
    x=(Channel("temperature", "°C"), Channel("flow", "m³/h")), u=(Channel("power", "%"),),
    y=(Channel("temperature", "°C"),), time_unit="min",
)  # fmt: skip
RIG = Rig(
    CHANNELS, (200.0,), kpis=lambda e: {"peak": float(e.x[:, 0].max())},
    ranges={"temperature": (-20.0, 400.0)}, max_rows=1000,
)  # fmt: skip
THETA = np.array([1.0, 2.0])
HEAD = "time [min],temperature [°C],flow [m³/h],power [%]"
GOOD = f"{HEAD}\n0,20,1.5,100\n0.5,21,1.5,100\n1.0,23.5,1.6,90\n"


def test_a_record_becomes_an_experiment():
    e = RIG.read(GOOD, THETA)
    assert np.array_equal(e.t, [0, 0.5, 1.0])
    assert np.array_equal(e.x, [[20, 1.5], [21, 1.5], [23.5, 1.6]])
    assert np.array_equal(e.u[:, 0], [100, 100, 90])
    assert np.array_equal(e.y_ref, [[200.0]] * 3)
    assert (e.end, dict(e.kpis)) == (End.TIME_UP, {"peak": 23.5})
    assert RIG.read(GOOD, THETA, unsafe=True).end is End.UNSAFE


@pytest.mark.parametrize(
    "text",
    [
        GOOD.replace(",", ";"),
        GOOD.replace(",", ";").replace(".", ","),
        GOOD.replace(",", "\t"),
        "\ufeff" + GOOD.replace("\n", "\r\n"),
        "# logged by hand\n\n" + GOOD + "\n# end\n",
        GOOD.replace(" [°C]", "").replace(" [min]", ""),
        GOOD.replace("m³/h", "m^3/h"),
        "note,power [%],time [min],flow [m³/h],temperature [°C]\n"
        "a,100,0,1.5,20\nb,100,0.5,1.5,21\n,90,1.0,1.6,23.5\n",
        '"time [min]","temperature [°C]","flow [m³/h]","power [%]"\n'
        '"0","20","1.5","100"\n"0.5","21","1.5","100"\n"1","23.5","1.6","90"\n',
    ],
)
def test_spellings_of_the_same_record(text):
    assert RIG.read(text, THETA) == RIG.read(GOOD, THETA)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "the record is empty: expected time"),
        (HEAD, "2 rows of values or more, got 0"),
        (GOOD.replace("flow", "flaw"), "column 'flow' is missing"),
        (GOOD.replace("flow [m³/h]", "power [%]"), "column 'power' stands there 2 times"),
        (GOOD.replace("[°C]", "[K]"), "column 'temperature' is in K, expected °C"),
        (GOOD.replace("[min]", "[s]"), "column 'time' is in s, expected min"),
        (
            GOOD.replace("23.5", "warm"),
            "line 4, column 'temperature': expected a number, got 'warm'",
        ),
        (GOOD.replace("23.5", ""), "line 4, column 'temperature': expected a number, got nothing"),
        (GOOD.replace("23.5", "nan"), "line 4, column 'temperature'"),
        (GOOD.replace("23.5", "inf"), "line 4, column 'temperature'"),
        (GOOD.replace("1.0,", "0.5,"), "line 4: time must increase, got 0.5 min after 0.5 min"),
        (GOOD + "1.5,20,1,1\n9,20,1,1\n", "line 6: a gap of 7.5 min after 1.5 min, where 0.5 min"),
        (GOOD.replace("23.5", "496"), "line 4, column 'temperature': 496 °C is outside"),
        (GOOD + '1.5,"20,1,1\n', "no CSV"),
        (HEAD + "\n" + "\n".join(f"{k},20,1,1" for k in range(1001)), "may have 1000 rows"),
    ],
)
def test_what_is_wrong_with_a_record_is_refused_in_words(text, words):
    with pytest.raises(RecordError) as refused:
        RIG.read(text, THETA)
    assert words in str(refused.value)


def test_several_problems_are_told_at_once_when_refused():
    text = HEAD + "\n" + "\n".join(f"{k},x,y,1" for k in range(4))
    with pytest.raises(RecordError) as refused:
        RIG.read(text, THETA)
    assert str(refused.value).count("; ") == 5
    assert "and 3 more" in str(refused.value)


def test_a_file_that_is_no_text_is_refused():
    with pytest.raises(RecordError, match="UTF-8"):
        RIG.read_bytes(b"\xff\xfe\x00")


@given(st.text(max_size=200) | st.text(alphabet='0123456789.,;\n\t eE-+"#', max_size=200))
def test_any_text_is_read_or_refused(rows):
    for text in (rows, f"{HEAD}\n{rows}"):
        try:
            e = RIG.read(text, THETA)
        except RecordError:
            continue
        assert len(e.t) >= 2


numbers = st.floats(-1e6, 1e6)


@given(st.lists(st.tuples(st.floats(-20, 400), numbers, numbers), min_size=2, max_size=20))
def test_what_is_written_is_read_back_exactly(rows):
    lines = [RIG.template().strip()]
    lines += [",".join(map(repr, (0.5 * k, *row))) for k, row in enumerate(rows)]
    e = RIG.read("\n".join(lines), THETA)
    assert np.array_equal(np.column_stack([e.x, e.u]), np.array(rows))


def test_only_a_person_can_run_it():
    with pytest.raises(ScenarioError, match="only a person can run"):
        RIG(THETA)


def test_a_failed_run_leaves_an_experiment_without_a_record():
    e = RIG.failed(THETA)
    assert (len(e.t), e.end, dict(e.kpis)) == (0, End.FAILED, {})


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"y_ref": ()}, "y_ref must hold"),
        ({"y_ref": (np.nan,)}, "y_ref must hold"),
        ({"ranges": {"pressure": (0, 1)}}, "ranges must give"),
        ({"ranges": {"flow": (1, 1)}}, "ranges must give"),
        ({"max_gap": 1.0}, "max_gap must be above 1"),
        ({"max_rows": 1}, "max_rows 2 or more"),
        ({"channels": Channels((Channel("time"),), (), (), "s"), "y_ref": ()}, "must differ"),
    ],
)
def test_an_impossible_rig_is_refused(change, words):
    with pytest.raises(SettingsError, match=words):
        Rig(**{"channels": CHANNELS, "y_ref": (200.0,), **change})
