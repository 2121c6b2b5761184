"""Every source keeps the contract; a rig's records, and a run of one's own."""

import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contracts.sources import attended, source_contract
from prefcal_env import Channel, Channels, ClosedLoop, Maneuvers, Rig
from prefcal_env.errors import RecordError, RunError, ScenarioError, SettingsError
from prefcal_env.experiments.experiment import End
from prefcal_env.experiments.kpis import Tracking
from prefcal_env.sources.source import Function, Varied, WithKPIs, source_of
from prefcal_env.sources.varied import Factor
from prefcal_scenarios.catalog import load
from prefcal_scenarios.isolated import OwnSource, isolation
from support.device import Device
from support.short_runs import short_run
from support.tank import pi_of, tank_env

OWN = f"{Path(__file__).parents[2] / 'scenarios' / 'toy_scenario.py'}:toy"
TOY = np.array([0.875, 22.0, 1.0])
PI = np.array([1.0, 0.5])
VALVE_RIG = Rig(Channels((), (Channel("valve"),), (Channel("level"),)), (1.0,))


def a_run(theta, seed=0):
    return short_run(theta)


class Cart:
    """Something with a run, which says what can be varied of it."""

    def run(self, theta, seed=0, *, load=1.0):
        return short_run(theta)

    def varied(self):
        mass = Factor("mass", "parameter", 1.0, 0.9, 1.1, "kg")
        return Varied((mass,), (), lambda values: Function(self.run))


@pytest.mark.parametrize("run", [Cart().run, partial(Cart().run, load=2.0)])
def test_what_varies_of_a_method_is_said_by_its_object(run):
    assert [factor.name for factor in Function(run).varied().factors] == ["mass"]


@source_contract
@pytest.mark.parametrize(
    ("source", "theta"),
    [
        (Function(a_run), PI),
        (WithKPIs(Function(a_run), Tracking()), PI),
        (source_of(ClosedLoop(tank_env, pi_of)), PI),
        (Maneuvers({"one": a_run, "other": a_run}), PI),
        (VALVE_RIG, PI),
        (Device(), np.array([2.0, 30.0])),
        (load("cstr").source, next(iter(load("cstr").references.values()))),
        (OwnSource(OWN, None), TOY),
    ],
    ids=["function", "measured", "loop", "maneuvers", "rig", "device", "built-in", "own"],
)
def test_source(clause, source, theta):
    clause(source, theta)


@source_contract
def test_source_in_another_process(clause):
    with isolation(OWN) as isolated:
        clause(isolated(load(OWN)).source, TOY)


def test_a_run_that_was_stopped_before_it_began_says_so():
    with isolation(OWN) as isolated:
        source = isolated(load(OWN)).source
        running, waiting = source.begin(TOY), source.begin(TOY)
        waiting.stop("stopped")
        assert running.advance().kpis
        with pytest.raises(RunError, match="before it began"):
            waiting.advance()


def test_a_run_that_is_stopped_while_it_waits_for_its_worker_does_not_begin():
    with isolation(OWN) as isolated, ThreadPoolExecutor(1) as pool:
        source = isolated(load(OWN)).source
        run = source.begin(TOY)
        with source._workers[0]._running:  # another run is in progress
            waiting = pool.submit(run.advance)
            time.sleep(0.2)
            run.stop("stopped")
        with pytest.raises(RunError, match="before it began"):
            waiting.result(20)
        assert source.run(TOY).kpis


def test_more_kpis_leave_a_source_what_it_is():
    device = WithKPIs(Device(), lambda made: {**made.kpis, "one": 1.0})
    assert (device.asks, device.stops, device.afterward) == ("confirm", False, Device.afterward)
    run = device.begin(np.array([2.0, 30.0]))
    run.supply(run.changes)
    assert run.advance().kpis["one"] == 1.0


def test_what_a_function_declares_is_known_beforehand():
    loop = ClosedLoop(tank_env, pi_of)
    source = source_of(loop)
    assert source.channels == loop.channels
    assert source.controller is pi_of
    assert not source.computes_kpis
    assert source_of(a_run).computes_kpis
    assert source_of(source) is source


def test_a_run_that_asks_for_nothing_takes_nothing():
    with pytest.raises(ScenarioError, match="asks for nothing"):
        Function(a_run).begin(PI).supply(())


def test_a_device_is_attended_from_python():
    made = attended(Device(), np.array([2.0, 30.0]))
    assert made.kpis["integrated error of level"] > 0


CHANNELS = Channels(
    x=(Channel("temperature", "°C"), Channel("flow", "m³/h")),
    u=(Channel("power", "%"),),
    y=(Channel("temperature", "°C"),),
    time_unit="min",
)
RIG = Rig(
    CHANNELS,
    (200.0,),
    kpis=lambda e: {"peak": float(e.x[:, 0].max())},
    ranges={"temperature": (-20.0, 400.0)},
    max_rows=1000,
)
THETA = np.array([1.0, 2.0])
HEAD = "time [min],temperature [°C],flow [m³/h],power [%]"
GOOD = f"{HEAD}\n0,20,1.5,100\n0.5,21,1.5,100\n1.0,23.5,1.6,90\n"


def test_outputs_that_are_no_states_have_columns_of_their_own():
    level, flow = Channel("level", "m"), Channel("flow", "m³/h")
    rig = Rig(Channels((level,), (), (flow, level), "s"), (1.0, 2.0))
    assert rig.template() == "time [s],level [m],flow [m³/h]\n"
    e = rig.read("time,level,flow\n0,1,5\n1,2,6\n", THETA)
    assert e.x[:, 0].tolist() == e.output(1).tolist() == [1, 2]
    assert e.output(0).tolist() == [5, 6]


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


HISTORIAN = """Timestamp;TI-101.PV;FI-2.PV;V-7.OP;Quality
23.11.2026 09:00:00;20;1,5;100;Good
23.11.2026 09:00:30;21;1,5;100;Good
23.11.2026 09:01:00;23,5;1,6;90;Good
"""
TAGS = {"time": "Timestamp", "temperature": "TI-101.PV", "flow": "FI-2.PV", "power": "V-7.OP"}


@pytest.mark.parametrize(
    ("text", "time_format"),
    [
        (HISTORIAN, None),
        (HISTORIAN.replace("23.11.2026 ", "2026-11-23T"), None),
        (HISTORIAN.replace("23.11.2026", "11/23/2026"), "%m/%d/%Y %H:%M:%S"),
    ],
)
def test_a_historian_s_export_is_a_record_by_its_own_headings_and_time_stamps(text, time_format):
    rig = replace(RIG, headings=TAGS, time_format=time_format)
    assert rig.read(text, THETA) == RIG.read(GOOD, THETA)


@pytest.mark.parametrize(
    ("times", "time_format"),
    [
        (("20261123 090000", "20261123 090030", "20261123 090100"), "%Y%m%d %H%M%S"),
        (("20261123090000", "20261123090030", "20261123090100"), "%Y%m%d%H%M%S"),
        (("09:00:00", "09:00:30", "09:01:00"), None),
    ],
)
def test_time_stamps_of_a_record_need_not_begin_with_a_date(times, time_format):
    text = HISTORIAN
    for second, stamp in zip(("09:00:00", "09:00:30", "09:01:00"), times, strict=True):
        text = text.replace(f"23.11.2026 {second}", stamp)
    rig = replace(RIG, headings=TAGS, time_format=time_format)
    assert rig.read(text, THETA) == RIG.read(GOOD, THETA)


def test_the_days_of_a_record_count_in_its_unit_of_time():
    rig = replace(RIG, time_format="%d-%b-%y")
    e = rig.read(f"{HEAD}\n23-Nov-26,20,1.5,100\n24-Nov-26,21,1.5,100\n", THETA)
    assert e.t.tolist() == [0, 1440]


def test_a_bad_time_stamp_is_reported_beside_the_other_problems_of_the_record():
    with pytest.raises(RecordError, match=r"line 3, column 'time': .*'later'.*; line 2, column 'f"):
        RIG.read(f"{HEAD}\n09:00,20,x,100\nlater,21,1.5,100\n", THETA)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("23.11.2026 09:00:00", "", "line 2, column 'Timestamp': expected a time, got nothing"),
        ("23.11.2026 09:00:30", "later", "line 3, column 'Timestamp': expected a number or a time"),
        ("23.11.2026 09:00:30", "", "line 3, column 'Timestamp': expected a time, got nothing"),
        ("23.11.2026", "Nov 23 2026", "give time_format='%d/%m/%Y %H:%M:%S' or the like"),
        ("09:00:30", "08:00:30", "line 3: time must increase"),
    ],
)
def test_a_time_stamp_that_cannot_be_read_is_refused_with_its_line(old, new, words):
    with pytest.raises(RecordError, match=words):
        replace(RIG, headings=TAGS).read(HISTORIAN.replace(old, new), THETA)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "the record is empty: expected time"),
        (HEAD, "2 rows of values or more, got 0"),
        (GOOD.replace("flow", "flaw"), "column 'flow' is missing"),
        (GOOD.replace("flow [m³/h]", "power [%]"), "column 'power' appears 2 times"),
        (GOOD.replace("[°C]", "[bar]"), "column 'temperature' is in bar, expected °C"),
        (GOOD.replace("[min]", "[m]"), "column 'time' is in m, expected min"),
        (GOOD.replace("23.5", "warm"), "line 4, column 'temperature': expected a number, got 'warm'"),
        (GOOD.replace("23.5", ""), "line 4, column 'temperature': expected a number, got nothing"),
        (GOOD.replace("23.5", "nan"), "line 4, column 'temperature'"),
        (GOOD.replace("23.5", "inf"), "line 4, column 'temperature'"),
        (GOOD.replace("1.0,", "0.5,"), "line 4: time must increase, got 0.5 min after 0.5 min"),
        (GOOD + "1.5,20,1,1\n9,20,1,1\n", "line 6: a gap of 7.5 min after 1.5 min, where 0.5 min"),
        (GOOD.replace("23.5", "496"), "line 4, column 'temperature': 496 °C is outside"),
        (GOOD + '1.5,"20,1,1\n', "not valid CSV"),
        (HEAD + "\n" + "\n".join(f"{k},20,1,1" for k in range(1001)), "may have 1000 rows"),
    ],
)
def test_what_is_wrong_with_a_record_is_refused_in_words(text, words):
    with pytest.raises(RecordError) as refused:
        RIG.read(text, THETA)
    assert words in str(refused.value)


def test_several_problems_are_told_at_once_when_refused():
    text = f"{HEAD}\n0,x,1,1\n1,y,,1\n0.5,z,1,500,7\n"
    rig = replace(RIG, ranges={"power": (0.0, 100.0)})
    with pytest.raises(RecordError) as refused:
        rig.read(text, THETA)
    told = str(refused.value).split("; ")
    assert [t.split(":")[0] for t in told] == [
        "line 4 has 5 cells under 4 headings",
        "line 2, column 'temperature'",
        "line 3, column 'flow'",
        "line 4",
        "line 4, column 'power'",
    ]
    assert told[1].endswith("got 'x' (and 2 more)")


def test_no_more_than_five_problems_are_told_when_refused():
    text = HEAD + "\n" + "".join(f"{t},20,1,1\n" for t in np.cumsum([0.1, 0.1, 0.1] + [0.1, 9] * 7))
    with pytest.raises(RecordError, match="and 2 more") as refused:
        RIG.read(text, THETA)
    assert str(refused.value).count("; ") == 5


@pytest.mark.parametrize("cell", ["1_000", "٢٠", "0x10", "1.234.5", "infinity", "1e999", "2 0"])
def test_what_only_python_takes_for_a_number_is_refused(cell):
    with pytest.raises(RecordError, match="line 4, column 'temperature': expected a number"):
        RIG.read(GOOD.replace("23.5", cell), THETA)


def test_a_decimal_comma_that_would_shift_the_columns_is_refused():
    with pytest.raises(RecordError, match="a decimal comma needs semicolons"):
        RIG.read(f"{HEAD}\n0,20,5,1.5,100\n1,21,5,1.5,100\n", THETA)


def test_decimal_commas_among_decimal_points_are_refused():
    text = f"{HEAD}\n0,20.5,1.5,100\n1,21.5,1.5,100\n".replace(",", ";")
    with pytest.raises(RecordError, match="line 2 has a decimal comma, line 3 a decimal point"):
        RIG.read(text.replace("20.5;1.5", "1,205;1,5"), THETA)


def test_values_beyond_every_sensor_are_refused():
    with pytest.raises(RecordError, match=r"column 'flow': 1e\+300 m³/h is outside"):
        RIG.read(GOOD.replace("1.6", "1e300"), THETA)


def test_empty_cells_at_the_end_of_a_line_are_no_harm():
    assert RIG.read(GOOD.replace("90\n", "90,,\n"), THETA) == RIG.read(GOOD, THETA)


def test_the_template_reads_back_whatever_the_channels_are_called():
    names = ("x[0]", "flow, main", 'the "hot" one', "a;b;c;d;e")
    channels = Channels(tuple(Channel(n, "l") for n in names), (), (), "s")
    rig = Rig(channels, ())
    assert rig.read(rig.template() + "0,1,2,3,4\n1,5,6,7,8\n", THETA).x[1, 3] == 8


def test_a_changing_reference_has_a_column():
    head = GOOD.replace("[%]", "[%],temperature ref [°C]", 1)
    text = head.replace(",100\n", ",100,30\n").replace(",90\n", ",90,35\n")
    assert np.array_equal(RIG.read(text, THETA).y_ref[:, 0], [30, 30, 35])


def test_a_reference_of_another_quantity_is_refused():
    with pytest.raises(RecordError, match="column 'temperature ref' is in bar, expected °C"):
        RIG.read(GOOD.replace("[%]", "[%],temperature ref [bar]", 1), THETA)


@pytest.mark.parametrize(
    ("heading", "scale", "shift"),
    [
        ("temperature [K]", 1.0, -273.15),
        ("temperature [degF]", 5 / 9, -160 / 9),
        ("temperature (℃)", 1.0, 0.0),
    ],
)
def test_a_column_in_another_unit_is_converted(heading, scale, shift):
    made = replace(RIG, ranges={}).read(GOOD.replace("temperature [°C]", heading), THETA)
    np.testing.assert_allclose(made.x[:, 0], scale * np.array([20, 21, 23.5]) + shift, atol=1e-9)


@pytest.mark.parametrize("unit", ["minutes", "Min", "MIN"])
def test_a_time_is_in_the_unit_of_the_rig_however_that_is_spelled(unit):
    assert RIG.read(GOOD.replace("[min]", f"[{unit}]"), THETA) == RIG.read(GOOD, THETA)
    made = RIG.read(GOOD.replace("[min]", "[s]"), THETA)
    np.testing.assert_allclose(60 * made.t, [0, 0.5, 1.0])


@pytest.mark.parametrize("kpis", [lambda e: {"t": e.t[[99]]}, lambda e: 3, lambda e: {"t": "x"}])
def test_a_record_whose_kpis_cannot_be_computed_is_refused(kpis):
    with pytest.raises(RecordError, match=r"cannot compute the KPIs of this record \(\w+Error: "):
        replace(RIG, kpis=kpis).read(GOOD, THETA)


def test_a_file_that_is_no_text_is_refused():
    with pytest.raises(RecordError, match="UTF-8"):
        RIG.read(b"\xff\xfe\x00", THETA)


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
