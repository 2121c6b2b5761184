"""Tables as historians write them: logged on change, one row for each tag, bad values, row numbers."""

import io
import sys
import zipfile
from datetime import datetime, timedelta

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefcal_env import Channel, Channels, End, Rig, from_frame, recorded
from prefcal_env.errors import MissingExtraError, RecordError
from prefcal_env.tables.sheet import parts_of

LEVEL = [round(2 - 2 * 0.8**k, 4) for k in range(30)]
USE = {"outputs": ["level"], "inputs": ["valve"]}


def read(table, **about):
    return from_frame(table, [1.0], **about)


def wide(heading, row, count=30):
    return heading + "\n" + "".join(row(k) + "\n" for k in range(count))


# --- Columns that are logged on change.


@given(st.lists(st.tuples(st.integers(0, 29), st.floats(-50, 50)), max_size=8), st.permutations(range(3)))
def test_holding_is_the_same_as_writing_each_value_again(changes, order):
    """An input and a reference that are logged on change, as they are and written out."""
    logged = dict([(0, 1.5), *changes])
    now, rows = 0.0, {"changes": [], "written out": []}
    for k, level in enumerate(LEVEL):
        now = logged.get(k, now)
        rows["changes"].append([level, *([logged.get(k, "")] * 2)])
        rows["written out"].append([level, now, now])
    names = ["level", "level ref", "valve"]
    tables = [
        ",".join(["time", *(names[i] for i in order)])
        + "\n"
        + "".join(",".join(map(str, [k, *(row[i] for i in order)])) + "\n" for k, row in enumerate(each))
        for each in rows.values()
    ]
    one, other = (read(table, inputs=["valve"]) for table in tables)
    assert one == other
    assert (one.duration, one.end) == (29.0, End.TIME_UP)


def test_an_output_that_is_logged_on_change_goes_straight_to_the_next_value_and_keeps_the_last():
    table = wide("time,level,flow", lambda k: f"{k},{LEVEL[k]},{k if k in (0, 10, 20) else ''}")
    with pytest.raises(
        RecordError, match=r"line 3, column 'flow': .* got nothing \(and 26 more\): fill it, or"
    ):
        read(table)
    e = read(table, allow="missing")
    assert (e.duration, e.end) == (29.0, End.TIME_UP)
    assert np.array_equal(e.output(1), np.minimum(np.arange(30), 20))


def test_what_is_on_or_off_is_held():
    e = read(
        wide("time,level,pump", lambda k: f"{k},{k},{ {0: 0, 10: 1, 20: 0}.get(k, '') }"), allow="missing"
    )
    assert e.output(1).tolist() == [0] * 10 + [1] * 10 + [0] * 10


def test_a_run_that_stopped_has_no_output_from_there_on():
    e = read(wide("time,level,flow,valve", lambda k: f"{k},{'1,2' if k < 20 else ','},5"), inputs=["valve"])
    assert (e.duration, e.end) == (19.0, End.UNSAFE)
    e = read(wide("time,level,valve", lambda k: f"{k},{k if k < 20 else 'inf'},5"), inputs=["valve"])
    assert (e.duration, e.end) == (19.0, End.UNSAFE)


def test_what_holds_before_the_first_value_is_not_known():
    table = wide("time,level,valve", lambda k: f"{k},{k},{7 if k == 3 else ''}")
    with pytest.raises(
        RecordError, match=r"line 2, column 'valve': expected a number, got nothing \(and 2 more"
    ):
        read(table, inputs=["valve"])
    assert set(read(table, inputs=["valve"], allow="missing").u[:, 0]) == {7.0}


def test_an_input_of_arrays_is_held_where_it_is_nan():
    e = recorded([1.0], range(5), {"level": range(5)}, {"valve": [4, np.nan, np.nan, 2, np.nan]})
    assert (e.u[:, 0].tolist(), e.end) == ([4, 4, 4, 2, 2], End.TIME_UP)


# --- One row for each tag.


@given(
    st.lists(st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3)), min_size=3, max_size=15),
    st.sampled_from(
        ["tag,time,value", "TagName,Timestamp,Value", "_field,_time,_value", "variable,time,value"]
    ),
    st.sampled_from(["by tag", "by time", "shuffled tags"]),
    st.sampled_from(["numbers", "stamps", "milliseconds"]),
)
def test_one_row_for_each_tag_is_the_same_as_one_column_for_each(rows, heading, order, times):
    shown = {
        "numbers": lambda k: f"{k}",
        "stamps": lambda k: f"2026-10-05 09:00:{k:02d}",
        "milliseconds": lambda k: f"{1760000000000 + 1000 * k}",
    }[times]
    cells = [(tag, k, row[i]) for i, tag in enumerate(["level", "flow"]) for k, row in enumerate(rows)]
    if order == "by time":
        cells.sort(key=lambda cell: cell[1])
    elif order == "shuffled tags":
        cells = cells[len(rows) :] + cells[: len(rows)]
    long = heading + "\n" + "".join(f"{tag},{shown(k)},{value!r}\n" for tag, k, value in cells)
    table = "time,level,flow\n" + "".join(f"{shown(k)},{a!r},{b!r}\n" for k, (a, b) in enumerate(rows))
    about = {"outputs": ["level", "flow"]}
    assert read(long, **about) == read(table, **about)


def test_tags_have_times_units_and_qualities_of_their_own():
    rows = [("PV", f"{k}", LEVEL[k], "Good", "m") for k in range(30)]
    rows += [("SP", "0", 1, "Good", "m"), ("SP", "10.5", 2, "Good", "m"), ("OP", "0", 5, "Good", "%")]
    rows += [("MODE", "0", "AUTO", "Good", ""), ("OP", "20", 7, "Good", "%")]
    text = "tag,time,value,quality,unit\n" + "".join(",".join(map(str, row)) + "\n" for row in rows)
    about = {
        "columns": {"level": "PV", "level ref": "SP", "valve": "OP"},
        "outputs": ["level"],
        "inputs": ["valve"],
    }
    e = read(text, **about)
    assert [c.label for c in (*e.channels.y, *e.channels.u)] == ["level [m]", "valve [%]"]
    assert np.array_equal(e.y_ref[:, 0], np.where(e.t < 10.5, 1, 2))
    assert np.array_equal(e.u[:, 0], np.where(e.t < 20, 5, 7))
    bad = text.replace("PV,3,0.976,Good", "PV,3,0.976,Bad")
    with pytest.raises(RecordError, match="line 5, column 'PV': expected a number, got quality Bad"):
        read(bad, **about)
    mended = read(bad, **about, allow="missing")
    assert mended.output(0)[mended.t == 3] == pytest.approx((LEVEL[2] + LEVEL[4]) / 2)


def test_two_values_of_a_tag_at_one_time_are_refused_or_the_last_one_is_kept():
    text = "tag,time,value\n" + "".join(f"{tag},{k},{k}\n" for tag in "ab" for k in (0, 1, 2)) + "a,2,9\n"
    with pytest.raises(RecordError, match="1 times a tag of column 'tag' has several values at one time"):
        read(text)
    assert read(text, allow="duplicates").output(0).tolist() == [0, 1, 9]


@pytest.mark.parametrize(
    "text", ["time,mode,level\n0,auto,1\n1,man,2\n2,auto,3\n", "time,name,level\n0,a,1\n1,b,2\n"]
)
def test_a_column_of_text_beside_a_signal_is_no_tag(text):
    assert [channel.name for channel in read(text).channels.y] == ["level"]


def test_tags_in_columns_without_usual_headings_are_told_by_repeated_times():
    text = "time,Where,How much\n" + "".join(
        f"{k},{tag},{k}\n" for k in range(5) for tag in ("inlet", "outlet")
    )
    assert [channel.name for channel in read(text).channels.y] == ["inlet", "outlet"]


def test_a_cell_of_a_tag_that_is_no_number_is_refused_with_its_line():
    text = "tag,time,value\n" + "".join(f"{tag},{k},{k}\n" for tag in "ab" for k in (0, 1, 2, 3))
    with pytest.raises(RecordError, match="line 3, column 'value': expected a number, got '1x'"):
        read(text.replace("a,1,1", "a,1,1x"))


# --- Headings, row numbers, bad values.


@pytest.mark.parametrize(
    ("heading", "parts"),
    [
        ("x[2]", ("x[2]", None)),
        ("A[1,3]", ("A[1,3]", None)),
        ("x[-1:2]", ("x[-1:2]", None)),
        ("axis[1].pos", ("axis[1].pos", None)),
        ("x[1] [m]", ("x[1]", "m")),
        ("level[m]", ("level", "m")),
        ("level [1]", ("level", "1")),
        ("level [-]", ("level", "-")),
    ],
)
def test_the_subscript_of_a_heading_belongs_to_its_name(heading, parts):
    assert parts_of(heading) == parts


@pytest.mark.parametrize("heading", ["", "Unnamed: 0", "index", "Record", "No."])
@pytest.mark.parametrize("first", [0, 1, 17])
def test_row_numbers_are_no_output(heading, first):
    e = read(f"{heading},time,level\n" + "".join(f"{first + k},{k / 2},{k}\n" for k in range(5)))
    assert [channel.name for channel in e.channels.y] == ["level"]
    assert e.duration == 2.0
    selected = read(f"{heading},time,level\n{first},0,1\n{first + 4},1,2\n{first + 5},2,2\n")
    assert [channel.name for channel in selected.channels.y] == ["level"]


def test_numbers_without_a_heading_are_refused():
    with pytest.raises(RecordError, match="column 2 has numbers but no heading: name it, or remove it"):
        read("time,,level\n0,2.5,1\n1,2.5,1\n")
    assert len(read("time,,level\n0,,1\n1,,1\n").channels.y) == 1


BAD = [
    "Bad",
    "Bad Input",
    "No Data",
    "ERROR",
    "#VALUE!",
    "#REF!",
    "Timeout",
    "I/O Timeout",
    "Calc Failed",
    "---",
]


@pytest.mark.parametrize("word", BAD)
def test_what_is_written_instead_of_a_value_is_a_gap(word):
    text = wide("time,level,valve", lambda k: f"{k},{k if k != 4 else word},{k if k != 7 else word}")
    with pytest.raises(RecordError, match="line 6, column 'level': expected a number, got '"):
        read(text, **USE)
    with pytest.raises(RecordError, match=f"line 9, column 'valve': expected a number, got '{word}'"):
        read(text.replace(f"4,{word}", "4,4"), **USE)
    for table in (text, pd.read_csv(io.StringIO(text))):
        e = read(table, **USE, allow="missing")
        assert np.array_equal(e.output(0), np.arange(30))
        assert e.u[7, 0] == 6


@pytest.mark.parametrize(
    ("quality", "good", "bad"),
    [
        ("quality", "Good", "Bad"),
        ("Quality", "Good (192)", "Bad, Configuration Error"),
        ("OPC quality", 192, 24),
        ("quality", 0, 2147549184),
        ("status", "OK", "Comm Fail"),
        ("valid", "true", "false"),
        ("quality", 1, 0),
        ("quality", "Uncertain", "Not Connected"),
    ],
)
def test_rows_of_bad_quality_are_gaps(quality, good, bad):
    text = wide(
        f"time,level,valve,{quality}", lambda k: f'{k},{99 if k == 4 else k},{k},"{bad if k == 4 else good}"'
    )
    with pytest.raises(RecordError, match="line 6, column 'level': expected a number, got quality "):
        read(text, **USE)
    e = read(text, inputs=["valve"], allow="missing")
    assert [channel.name for channel in e.channels.y] == ["level"]
    assert np.array_equal(e.output(0), np.arange(30))
    assert e.u[4, 0] == 3


def test_a_quality_that_names_its_column_is_that_of_it_alone():
    text = wide("time,TI1,TI1 quality,TI2,TI2.Quality", lambda k: f"{k},{k},{0 if k == 4 else 192},{k},192")
    e = read(text, outputs=["TI2"])
    assert np.array_equal(e.output(0), np.arange(30))
    with pytest.raises(RecordError, match="line 6, column 'TI1': expected a number, got quality 0"):
        read(text)


def test_a_quality_that_is_a_signal_stays_one():
    e = read(wide("time,product quality", lambda k: f"{k},{0.5 + k / 100}"))
    assert e.output(0)[1] == 0.51
    asked = read(wide("time,quality", lambda k: f"{k},{192}"), outputs=["quality"])
    assert set(asked.output(0)) == {192}


# --- The same in the records of a rig.

RIG = Rig(
    Channels((), (Channel("valve", "%"),), (Channel("level", "m"),), "min"),
    (1.0,),
    headings={"time": "Timestamp", "level": "LI", "valve": "V", "level ref": "SP"},
)


def rig_read(text):
    return RIG.read(text, np.ones(1))


def test_a_record_is_held_where_it_is_logged_on_change():
    e = rig_read("Timestamp,LI,V,SP\n0,1,40,2\n1,2,,\n2,2,50,\n3,2,,\n")
    assert (e.u[:, 0].tolist(), e.y_ref[:, 0].tolist()) == ([40, 40, 50, 50], [2, 2, 2, 2])
    with pytest.raises(RecordError, match="line 2, column 'V': expected a number, got nothing"):
        rig_read("Timestamp,LI,V\n0,1,\n1,2,4\n")
    with pytest.raises(RecordError, match="line 3, column 'V': expected a number, got 'Bad'"):
        rig_read("Timestamp,LI,V\n0,1,4\n1,2,Bad\n2,2,4\n")
    with pytest.raises(RecordError, match="line 3, column 'LI': expected a number, got quality Bad"):
        rig_read("Timestamp,LI,V,Quality\n0,1,4,Good\n1,2,4,Bad\n2,2,4,Good\n")


def test_a_record_may_have_one_row_for_each_tag_and_stamps_in_milliseconds():
    plain = rig_read("Timestamp,LI,V,SP\n" + "".join(f"{k / 2},{LEVEL[k]},{k},2\n" for k in range(9)))
    start = 1760000000000
    rows = [(tag, start + 30000 * k, value) for k in range(9) for tag, value in (("LI", LEVEL[k]), ("V", k))]
    text = "tag,Timestamp,value\n" + "".join(f"{a},{b},{c}\n" for a, b, c in [*rows, ("SP", start, 2)])
    assert rig_read(text) == plain


@pytest.mark.parametrize(
    "form",
    [
        "%d/%m/%Y %H:%M:%S",
        "%d/%m/%Y %H:%M",
        "%d.%m.%y",
        "%I:%M:%S %p",
        "%Y-%m-%d, %H:%M",
        "%Y-%m-%dT%H:%M:%S%z",
    ],
)
def test_a_made_up_record_has_stamps_in_the_format_of_the_rig(form):
    rig = Rig(RIG.channels, (1.0,), time_format=form)
    assert len(rig.example(np.ones(1)).t) == 60


# --- Excel.


def workbook(rows):
    """Return a minimal .xlsx of these rows, whose time stamps have a format of dates."""

    def cell(value):
        if isinstance(value, datetime):
            return f'<c s="1"><v>{(value - datetime(1899, 12, 30)).total_seconds() / 86400!r}</v></c>'
        if isinstance(value, str):
            return f'<c t="inlineStr"><is><t>{value}</t></is></c>'
        return "<c/>" if value is None else f"<c><v>{value!r}</v></c>"

    main = 'xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"'
    office = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
    package = "http://schemas.openxmlformats.org/package/2006"
    data = "".join(f"<row>{''.join(map(cell, row))}</row>" for row in rows)
    to = '<Relationship Id="r{}" Type="{}/{}" Target="{}"/>'
    parts = {
        "_rels/.rels": f'<Relationships xmlns="{package}/relationships">'
        + to.format(1, office, "officeDocument", "xl/workbook.xml")
        + "</Relationships>",
        "[Content_Types].xml": f'<Types xmlns="{package}/content-types"/>',
        "xl/workbook.xml": f'<workbook {main} xmlns:r="{office}"><sheets>'
        '<sheet name="S" sheetId="1" r:id="r1"/>'
        "</sheets></workbook>",
        "xl/_rels/workbook.xml.rels": f'<Relationships xmlns="{package}/relationships">'
        + to.format(1, office, "worksheet", "worksheets/sheet1.xml")
        + to.format(2, office, "styles", "styles.xml")
        + "</Relationships>",
        "xl/styles.xml": f'<styleSheet {main}><cellXfs><xf numFmtId="0"/><xf numFmtId="22"/></cellXfs>'
        "</styleSheet>",
        "xl/worksheets/sheet1.xml": f"<worksheet {main}><sheetData>{data}</sheetData></worksheet>",
    }
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        for name, text in parts.items():
            archive.writestr(name, text)
    return content.getvalue()


STAMPED = [
    ["Timestamp", "level [m]", "level ref", "valve"],
    *(
        [datetime(2026, 10, 5, 9) + timedelta(seconds=k / 2), LEVEL[k], 2 if k == 0 else None, k]
        for k in range(20)
    ),
]


@pytest.mark.extended
def test_a_workbook_is_read_as_the_same_table_in_a_csv(tmp_path):
    pytest.importorskip("python_calamine", reason="needs python-calamine: pip install 'prefcal[excel]'")
    path = tmp_path / "run.xlsx"
    path.write_bytes(workbook(STAMPED))
    text = "\n".join(",".join("" if cell is None else str(cell) for cell in row) for row in STAMPED)
    e = read(text, inputs=["valve"])
    assert (e.duration, e.channels.y[0].unit, e.channels.y[0].target) == (9.5, "m", 2)
    assert read(path, inputs=["valve"]) == e
    assert read(str(path), inputs=["valve"]) == e
    shifted = workbook([[None], *STAMPED[:3], [None], *STAMPED[3:]])
    assert read(shifted, inputs=["valve"]) == e
    with pytest.raises(RecordError, match=r"line 4, column 'level': expected a number, got '1\.5 m'"):
        read(workbook([*STAMPED[:3], [STAMPED[3][0], "1.5 m", 2, 2], *STAMPED[4:]]), outputs=["level"])
    with pytest.raises(RecordError, match="the first line only one: remove the lines above the headings"):
        read(workbook([["Plant 7"], *STAMPED]))
    with pytest.raises(RecordError, match="got an empty sheet"):
        read(workbook([]))
    with pytest.raises(RecordError, match="is a workbook or an archive that cannot be read"):
        read(b"PK\x03\x04 workbook")


def test_a_workbook_without_its_library_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "python_calamine", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'prefcal\[excel\]', or save the table as CSV"):
        read(b"PK\x03\x04")


@given(st.integers(0, 29), st.booleans())
def test_a_tag_that_is_logged_now_and_then_follows_the_clock_of_all(change, sorted_by_tag):
    """Over the end of summer time, two rows of a reference do not show alone which hour they are of."""
    stamps = pd.date_range("2026-10-25T00:57:30Z", periods=30, freq="10s").tz_convert("Europe/Berlin")
    rows = [(k, "level", level) for k, level in enumerate(LEVEL)] + [
        (0, "level ref", 1),
        (change, "level ref", 2),
    ]
    rows = rows if sorted_by_tag else sorted(rows, key=lambda row: row[0])
    long = "tag,timestamp,value\n" + "".join(
        f"{tag},{stamps[k]:%Y-%m-%d %H:%M:%S},{value}\n" for k, tag, value in rows
    )
    ref = np.where(np.arange(30) >= change, 2.0, 1.0)
    right = recorded([1.0], np.arange(30) * 10.0, {"level": LEVEL}, reference={"level": ref})
    found, said = None, ""
    try:
        found = read(long, allow=("duplicates",)).kpis
    except RecordError as refused:
        said = str(refused)
    assert found == right.kpis or (sorted_by_tag and "do not show when" in said)


@pytest.mark.parametrize("change", [1, 10])
def test_a_set_point_from_before_the_run_holds_in_it(change):
    """Historians add the last value before the start: an hour of it is no part of the run."""
    begin = pd.Timestamp("2026-10-10 10:00:00")
    rows = [
        (-3600, "level ref", 1.0),
        *((k, "level", level) for k, level in enumerate(LEVEL)),
        (change, "level ref", 2.0),
    ]
    rows.sort(key=lambda row: row[0])
    long = "tag,timestamp,value\n" + "".join(
        f"{tag},{begin + pd.Timedelta(seconds=s)},{value}\n" for s, tag, value in rows
    )
    ref = np.where(np.arange(30) >= change, 2.0, 1.0)
    right = recorded([1.0], np.arange(30.0), {"level": LEVEL}, reference={"level": ref})
    assert read(long).kpis == right.kpis


def test_nothing_is_measured_before_the_first_value_of_a_reference():
    ref = [2.0 if k == 10 else np.nan for k in range(30)]
    found = recorded([1.0], np.arange(30.0), {"level": LEVEL}, reference={"level": ref})
    assert (
        found.kpis == recorded([1.0], np.arange(20.0), {"level": LEVEL[10:]}, reference={"level": 2.0}).kpis
    )
    table = wide("time,level,level ref", lambda k: f"{k},{LEVEL[k]},{2 if k == 10 else ''}")
    with pytest.raises(RecordError, match="column 'level ref': expected a number, got nothing"):
        read(table)
    assert read(table, allow="missing").kpis == found.kpis


def test_subscripts_with_commas_need_no_quotes():
    e = read("time,A[1,3],A[2,3] [m],u\n0,1,2,3\n1,4,5,6\n")
    assert [(c.name, c.unit) for c in e.channels.y] == [("A[1,3]", ""), ("A[2,3]", "m"), ("u", "")]
