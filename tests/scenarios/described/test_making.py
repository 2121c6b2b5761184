"""Scenarios of TOML files, what is said of a wrong one, and the controllers that they name."""

import os
import sys

import numpy as np
import pytest

from prefcal_env import Move
from prefcal_env.controllers import as_data
from prefcal_env.controllers.stored import KINDS, storable
from prefcal_env.errors import ScenarioError, SettingsError, StudyError
from prefcal_env.knobs import Knob
from prefcal_scenarios import names
from prefcal_scenarios.catalog import load
from prefcal_scenarios.described import description, making
from prefcal_scenarios.described.description import (
    knob_of,
    listed,
    named_numbers,
    resumed_source,
    words_of,
    words_to_resume,
)
from prefcal_scenarios.described.making import controller_of, plant_at
from prefcal_scenarios.names import is_own

OVEN = """
title = "Heating an oven"
show = ["power", "temperature"]

[rig]
instructions = "Let the oven cool."
time_unit = "min"

[rig.outputs]
temperature = { unit = "°C", band = 2, sensor = [0, 400] }

[rig.inputs]
power = { unit = "%", low = 0, high = 100 }

[reference]
temperature = 200

[knobs]
K_p = "0.5:20:log %/K"
K_i = { low = 0.01, high = 2, scale = "log", about = "Integral gain." }

[kpis]
"settling time of temperature" = 20
"overshoot of temperature" = { title = "overshoot" }

[panels]
power = { title = "heating" }

[starts]
now = { K_p = 2, K_i = 0.1 }
"""
KNOB = '[rig.outputs]\na = {}\n[reference]\na = 1\n[knobs]\nk = "1:2"\n'


@pytest.fixture
def written(tmp_path):
    def write(text, name="oven.toml"):
        (tmp_path / name).write_text(text, encoding="utf-8")
        return str(tmp_path / name)

    return write


def test_a_rig_reads_the_headings_and_time_stamps_of_its_logger(written):
    tags = '[rig]\ntime_format = "%m/%d/%y %H:%M"\nheadings = { time = "Stamp", a = "TI-1" }\n'
    log = "Stamp,TI-1\n11/23/26 09:00,1\n11/23/26 09:01,2\n"
    assert np.array_equal(load(written(tags + KNOB)).run.read(log, [1.0]).t, [0.0, 60.0])


def test_a_rig_needs_no_code(written):
    oven = load(written(OVEN))
    assert (oven.name, oven.title) == ("oven", "Heating an oven")
    assert [(k.name, k.unit, k.scale) for k in oven.space] == [("K_p", "%/K", "log10"), ("K_i", "", "log10")]
    assert [(k.title, k.unit, k.at_most) for k in oven.kpis] == [
        ("settling time of temperature", "min", 20.0),
        ("overshoot", "°C", np.inf),
    ]
    assert [(p.name, p.title) for p in oven.panels] == [("power", "heating"), ("temperature", "")]
    np.testing.assert_array_equal(oven.references["now"], [2.0, 0.1])
    record = "time [min],temperature [°C],power [%]\n0,20,100\n1,150,100\n2,200,30\n"
    assert oven.run.read(record, np.array([2.0, 0.1])).kpis["settling time of temperature"] == 2.0


@pytest.mark.parametrize(
    ("stated", "expected"),
    [
        ('"settling time of temperature" = { at_most = 90, unit = "s" }', (1.5, "min")),
        ('"overshoot of temperature" = { at_most = 9, unit = "°F" }', (5.0, "°C")),
        ('"overshoot of temperature" = { at_most = 9, unit = "K" }', (9.0, "°C")),
    ],
)
def test_the_limit_of_a_kpi_is_converted_to_the_unit_in_which_it_is_computed(written, stated, expected):
    head, _, tail = OVEN.partition("[kpis]")
    (kpi,) = load(written(f"{head}[kpis]\n{stated}\n[panels]{tail.partition('[panels]')[2]}")).kpis
    assert (pytest.approx(kpi.at_most), kpi.unit) == expected


def test_the_limit_of_a_kpi_in_a_unit_of_something_else_is_refused(written):
    head, _, tail = OVEN.partition("[kpis]")
    lines = '[kpis]\n"settling time of temperature" = { at_most = 90, unit = "m" }\n[panels]'
    with pytest.raises(ScenarioError, match="its unit must be min, or one that converts into it, got 'm'"):
        load(written(head + lines + tail.partition("[panels]")[2]))


def test_a_file_without_kpis_gets_them_and_one_that_says_none_has_none(written):
    assert load(written(KNOB)).kpis[0].name == "settling time of a"
    assert load(written(f'kpis = "none"\n{KNOB}')).kpis == ()


def test_a_file_defines_kpis_by_formulas(written):
    lines = (
        'peak = "max(temperature) - ref(temperature)"',
        'heat = { formula = "integral(power)", unit = "% min", at_most = 900, title = "heating" }',
        'seen = { formula = "last(time)", better = "higher" }',
        '"overshoot of temperature" = { formula = "max(temperature, after=1)" }',
    )
    head, _, tail = OVEN.partition("[kpis]")
    oven = load(written(head + "[kpis]\n" + "\n".join(lines) + "\n[panels]" + tail.partition("[panels]")[2]))
    assert [(k.name, k.title, k.goal) for k in oven.kpis] == [
        ("peak", "peak", "lower"),
        ("heat", "heating", "lower"),
        ("seen", "seen", "higher"),
        ("overshoot of temperature", "overshoot of temperature", "lower"),
    ]
    record = "time [min],temperature [°C],power [%]\n0,20,100\n1,150,100\n2,200,30\n"
    found = oven.run.read(record, np.array([2.0, 0.1])).kpis
    assert [found[kpi.name] for kpi in oven.kpis] == [0.0, 200.0, 2.0, 200.0]


def test_options_add_to_a_file_and_replace_what_it_says(written):
    source = f'{written(OVEN)} {{"knobs": {{"K_p": "1:2"}}, "reference": {{"temperature": 150}}}}'
    oven = load(source)
    assert [(k.low, k.high) for k in oven.space] == [(1, 2), (0.01, 2)]
    assert oven.run.y_ref == (150.0,)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("knob = 1", "there is no key 'knob'. Did you mean 'knobs'?"),
        ("fmu = 3", "fmu: expected a text, got 3"),
        (KNOB + "\n[kpis]\np = { formula = 'max(a)', of = 'q' }", "there is no key 'of'"),
        ("x = abc", "is not TOML"),
        ("title = 'x'", r"expected one of fmu = .*, got none"),
        ("fmu = 'a.fmu'\ncontroller = 'pid'", "got fmu and controller"),
        ("[rig]", r"\[rig\]: 'outputs' is missing"),
        ("[rig.outputs]\na = { unit = 3 }", r"\[rig.outputs\] a: unit: expected a text, got 3"),
        ("[rig.outputs]\na = {}\n[reference]\nb = 1", "no output of the rig is called 'b'"),
        ("[rig.outputs]\na = {}\n[reference]\na = 1\nb = 'x'", "reference, b: expected a number"),
        ("[rig.outputs]\na = {}", r"needs knobs, for example \[knobs\]"),
        (KNOB.replace('"1:2"', '"1"'), r"\[knobs\]: knob 'k': expected its range LOW:HIGH"),
        (KNOB.replace('"1:2"', "{ low = 1 }"), r"\[knobs\] k: 'high' is missing"),
        (KNOB.replace('"1:2"', "{ low = 1, high = 0 }"), "low must be below high"),
        (KNOB.replace('"1:2"', "{ low = 1, hihg = 2 }"), "Did you mean 'high'?"),
        (f'{KNOB}[kpis]\n"overshot of a" = 1', "Did you mean 'overshoot of a'?"),
        (f"{KNOB}[kpis]\n'overshoot of a' = {{ at_mots = 1 }}", "Did you mean 'at_most'?"),
        (f"{KNOB}[kpis]\npeak = 3", r"there is no KPI .*, or a formula such as 'peak' ="),
        (f"{KNOB}[kpis]\npeak = 'mx(a)'", r"\[kpis\] 'peak': formula 'mx\(a\)': .*Did you mean 'max'"),
        (f"{KNOB}[kpis]\npeak = 'max(b)'", "formula of KPI 'peak': signal 'b': no channel or signal"),
        (f"{KNOB}[panels]\nb = {{}}", "no channel or signal has this name"),
        (f"{KNOB}[starts]\nnow = {{ q = 1 }}", "expected a value for each of k, got q"),
        (f"stop_time = 3\n{KNOB}", "a rig has no stop_time"),
        (f"timeout = 3\n{KNOB}", "timeout is for an FMU"),
        (f"plant = 'm.py:p'\n{KNOB}", "a plant needs controller"),
    ],
)
def test_a_wrong_file_is_refused_with_its_name_table_and_key(written, text, says):
    path = written(text, "bad.toml")
    with pytest.raises(ScenarioError, match=f"bad.*{says}"):
        load(path)


def test_a_file_that_does_not_exist_is_refused():
    with pytest.raises(ScenarioError, match=r"cannot read the scenario 'none\.toml'"):
        load("none.toml")


@pytest.mark.parametrize("source", ["a.toml", "b/loop.fmu", 'pid {"plant": "m.py:p"}', "pid"])
def test_what_data_describe_runs_in_a_process_of_its_own(source):
    assert is_own(source)


def test_a_plant_is_found_in_its_file_and_its_paths_start_at_the_file_that_names_it(written):
    model = written(
        "from prefcal_env import Channel\nfrom prefcal_env.plants import FunctionPlant\n"
        "tank = FunctionPlant(lambda x, u, d: [u[0] - x[0]], states=[Channel('h')],"
        " inputs=[Channel('q')])\nmatrices = ([[-1.0]], [[1.0]], [[1.0]], [[0.0]])\n"
        "word, number = 'x', 5\n",
        "described_model.py",
    )
    assert plant_at(f"{model}:tank").states[0].name == "h"
    assert len(plant_at(f"{model}:matrices").outputs) == 1
    with pytest.raises(ScenarioError, match="Did you mean 'tank'"):
        plant_at(f"{model}:tnak")
    with pytest.raises(ScenarioError, match="must be a prefcal plant"):
        plant_at(f"{model}:word")
    with pytest.raises(ScenarioError, match=r"prefcal plant.*got the number 5"):
        plant_at(f"{model}:number")
    with pytest.raises(ScenarioError, match=r"model\.py:NAME"):
        plant_at(model)


KEPT = 'a/loop.fmu {"knobs": {"K": "1:2"}, "show": ["y"]}'


def test_a_study_keeps_what_is_not_said_again_from_any_folder():
    assert resumed_source(KEPT, "../a/loop.fmu") == f"../{KEPT}"
    assert resumed_source(KEPT, 'loop.fmu {"show": ["y"]}') == KEPT.removeprefix("a/")


def test_a_study_does_not_go_on_with_other_knobs_or_another_file():
    with pytest.raises(SettingsError, match="started with knobs"):
        resumed_source(KEPT, 'loop.fmu {"knobs": {"K": "1:3"}}')
    with pytest.raises(SettingsError, match="started with no reference"):
        resumed_source(KEPT, 'loop.fmu {"reference": {"y": 1}}')
    with pytest.raises(StudyError, match="calibrates"):
        resumed_source(KEPT, "other.fmu")


def test_a_plant_is_a_program_that_must_be_named_again_and_may_have_moved():
    kept = 'pid {"plant": "model.py:plant"}'
    with pytest.raises(SettingsError, match=r"if you trust it, add --plant model.py:plant"):
        resumed_source(kept, "pid")
    moved = f'pid {{"plant": "{os.pardir}/model.py:plant"}}'
    assert resumed_source(kept, moved) == moved
    with pytest.raises(SettingsError, match="started with plant"):
        resumed_source(kept, 'pid {"plant": "model.py:other"}')


def test_a_source_is_written_as_options():
    source = (
        'loop.fmu {"knobs": {"K": "1:2"}, "reference": {"y": 2.0}, "show": ["y", "u"], "limits": ["y <= 1"]}'
    )
    words = ["loop.fmu", "--knob", "K=1:2", "--show", "y,u", "--reference", "y=2.0", "--limit", "y <= 1"]
    assert words_of(source) == words
    assert words_to_resume(source) == ["loop.fmu"]
    assert words_of('overtake {"lanes_count": 3}') == ['overtake {"lanes_count": 3}']
    assert words_to_resume('pid {"plant": "m.py:p"}') == ["pid", "--plant", "m.py:p"]


LAGS = """
from prefcal_env import Channel, Plant
plant = Plant.of(([0.8], [160.0, 28.0, 1.0]), delay=6.0, inputs=[Channel("valve", "%", 0, 100)])
"""


def test_margins_can_be_limits_of_a_pid(tmp_path):
    (tmp_path / "model.py").write_text(LAGS)
    file = tmp_path / "heater.toml"
    text = f'controller = "pid"\nplant = "{tmp_path / "model.py"}:plant"\n[kpis]\nsettling_time = 300\n'
    file.write_text(text)
    without = load(str(file))
    file.write_text(f"{text}phase_margin = {{ at_least = 60 }}\ngain_margin = {{ at_least = 6 }}\n")
    scenario = load(str(file))
    phase, gain = scenario.kpis[1:]
    theta = scenario.references["MIGO"]
    run = scenario.run(theta)
    assert (phase.at_least, phase.unit, gain.at_least) == (60, "°", 6)
    assert not phase.met_by(run)
    assert gain.met_by(run)
    assert 50 < run.kpis["phase_margin"] < 60
    file.write_text(f'{text}M_s = {{ at_most = 170, unit = "%" }}\n')
    assert load(str(file)).kpis[1].at_most == pytest.approx(1.7)
    assert run.kpis["M_s"] == without.run(theta).kpis["M_s"]
    assert "phase_margin" not in without.run(theta).kpis


@pytest.mark.parametrize(
    ("text", "knob"),
    [
        ("K_p=0.1:100:log", Knob("K_p", 0.1, 100, scale="log10")),
        ("T_i=1:60 s", Knob("T_i", 1, 60, "s")),
        ("T_i = 1:60 [s]", Knob("T_i", 1, 60, "s")),
        ("K=0.1:100:log %/(K min)", Knob("K", 0.1, 100, "%/(K min)", scale="log10")),
        ("N=3:40:int", Knob("N", 3, 40, integer=True)),
        ("N=1:100:log:int steps", Knob("N", 1, 100, "steps", scale="log10", integer=True)),
        ("pid.K[1]=-5:-1e-1", Knob("pid.K[1]", -5, -0.1)),
    ],
)
def test_a_knob_is_read(text, knob):
    assert knob_of(text) == knob


@pytest.mark.parametrize("text", ["K_p", "=1:2", "K_p=", "K_p=1", "K_p=1:b", "K_p=1:2:lin", "K=:"])
def test_a_knob_that_is_misspelled_is_refused_with_an_example(text):
    with pytest.raises(ScenarioError, match=r"LOW:HIGH.*K_p=0\.1:100:log %/m"):
        knob_of(text)


def test_names_are_split_at_commas_but_not_inside_of_brackets():
    assert listed(["level, valve", "A[1,2]"]) == ["level", "valve", "A[1,2]"]


def test_references_are_read():
    assert named_numbers(["level=2", "flow=0.5, T = -3"], "--reference") == {
        "level": 2.0,
        "flow": 0.5,
        "T": -3.0,
    }


@pytest.mark.parametrize("text", ["level", "level=", "=2", "level=high", "level=nan"])
def test_a_reference_that_is_misspelled_is_refused_with_an_example(text):
    with pytest.raises(ScenarioError, match="--reference level=2, or, for an FMU"):
        named_numbers([text], "--reference")


@pytest.mark.parametrize(("word", "kind"), names.CONTROLLERS.items())
def test_every_standard_controller_has_a_scenario_and_a_stored_form(word, kind):
    assert making._maker(word).__name__ == f"{word}_scenario"
    assert kind in KINDS


def test_messages_name_every_standard_controller():
    assert names.either(["pid"]) == "pid"
    assert names.either(["pid", "lqr", "smith"]) == "pid, lqr or smith"
    assert all(f'"{word}"' in description._CONTROLLER for word in names.CONTROLLERS)


class Switch:
    """A controller on or off at r, which another package could add."""

    def __init__(self, high):
        self.high, self.T_s = high, 1.0

    def move(self, measurement):
        return Move(np.array([self.high * (measurement.y_ref[0] > measurement.y[0])]))

    def as_data(self):
        return {"high": self.high}

    @classmethod
    def of_data(cls, data):
        return cls(**data)


def test_a_linear_mpc_without_its_model_is_a_word_of_the_scenario():
    assert controller_of({"controller": "LinearMPC", "Q_y": 1.0}) is None


def test_a_controller_of_another_file_is_stored_once_its_row_is_there(monkeypatch):
    monkeypatch.delitem(KINDS, "Switch", raising=False)
    assert making.controller_of({"controller": "Switch", "high": 5.0}) is None
    monkeypatch.setattr(making, "CONTROLLERS", {**names.CONTROLLERS, "switch": "Switch"})
    monkeypatch.setattr(making, "import_module", lambda name: storable(Switch) and sys.modules[__name__])
    monkeypatch.setattr(sys.modules[__name__], "switch_scenario", Switch, raising=False)
    made = making.controller_of({"controller": "Switch", "high": 5.0})
    assert made.high == 5.0
    assert as_data(made) == {"controller": "Switch", "high": 5.0}
    monkeypatch.delitem(KINDS, "Switch")
