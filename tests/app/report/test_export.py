"""best.json and the way back to a controller."""

import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from prefcal_app.report.export import (
    REBUILD,
    best_as_json,
    equations,
    export_controller,
    holds,
    jsonable,
    load_controller,
    model,
    tuning_of,
)
from prefcal_app.report.record import written_as
from prefcal_env import LQR, PID, LinearMPC, MPCSettings, Plant
from prefcal_env.controllers import as_code, as_data
from prefcal_env.disk import digest_of
from prefcal_env.errors import ScenarioError, SettingsError, StaleError
from prefcal_env.experiments.experiment import Channel, Channels, Measurement
from prefcal_scenarios.catalog import load
from prefcal_scenarios.names import CLOSED_LOOPS
from prefcal_scenarios.own import joined_source
from prefcal_scenarios.scenario import KPI
from toy_study import TOY_FILE, toy_record


@pytest.fixture
def best(tmp_path):
    path = tmp_path / "best.json"
    path.write_text(best_as_json(toy_record()), encoding="utf-8")
    return path


def changed(path, **changes):
    """Write other content, as a version that took no fingerprint of it would have."""
    content = json.loads(path.read_text("utf-8")) | changes
    content.pop("written as", None)
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


def test_limits_that_nobody_stated_are_named_as_assumed_in_best_json_sheet_and_export(tmp_path):
    assumed = "Nobody stated limits of valve; 20 to 60 % is assumed."
    record = toy_record()
    record = replace(record, scenario=replace(record.scenario, assumed=(assumed,)))
    path = tmp_path / "best.json"
    path.write_text(best_as_json(record), encoding="utf-8")
    assert json.loads(path.read_text("utf-8"))["assumed"] == [assumed]
    assert assumed in model(record)
    assert holds(path).endswith(f"run prefcal verify best.json. {assumed}")
    assert "assumed" not in best_as_json(toy_record())


def test_best_json_says_all_about_the_tuned_controller(best):
    record = toy_record()
    content = json.loads(best.read_text("utf-8"))
    theta = record.best.experiment.theta
    assert list(content["theta"]) == ["T_s", "N_p", "gain"]
    assert content["theta"]["T_s"] == theta[0]
    assert isinstance(content["theta"]["N_p"], int)
    assert content["settings"]["gain"] == theta[2]
    assert content["cost"] == record.best.cost
    assert content["complete"]
    assert set(content["versions"]) >= {"prefcal", "python", "numpy"}


@pytest.mark.parametrize(
    ("system", "given", "text"),
    [
        (([0.8], [20, 1]), {"delay": 6.0}, "y = 0.8 e^(−6 s)/(20 s + 1) u (time in s)"),
        (([2.0], [5, 1]), {"rest": (40.0, -3.0)}, "(y + 3) = 2/(5 s + 1) (u − 40) (time in s)"),
        (([-2.0, 1], [1, 0.4, 0]), {}, "y = (−5 s + 2.5)/(2.5 s² + s) u (time in s)"),
        (([1.0], [1, -1]), {"output_delay": 2.0}, "y = 1 e^(−2 s)/(s − 1) u (time in s)"),
        (([1.0], [1, 0, 0]), {"time_unit": "min"}, "y = 1/s² u (time in min)"),
        (3.0, {}, "y = 3 u (time in s)"),
        (
            [[([12.8], [16.7, 1]), ([-18.9], [21.0, 1])], [([6.6], [10.9, 1]), ([0], [1])]],
            {"delay": [[1.0, 3.0], [7.0, 3.0]]},
            "y1 = 12.8 e^(−1 s)/(16.7 s + 1) u1 − 18.9 e^(−3 s)/(21 s + 1) u2; "
            "y2 = 6.6 e^(−7 s)/(10.9 s + 1) u1 (time in s)",
        ),
        (
            ([[0.5]], [[1.0]], [[2.0]], [[0.0]], 0.1),
            {"delay": 0.3},
            "y = 2 z^−3/(z − 0.5) u (z of a sample of 0.1 s)",
        ),
    ],
)
def test_a_linear_plant_is_written_as_transfer_functions(system, given, text):
    assert equations(Plant.of(system, **given)) == text


def test_a_plant_too_large_to_read_has_a_digest_that_tells_it_from_others():
    gains, waits = (1.0, 1.0, 1.1, 1.0), (1.0, 1.0, 1.0, 9.0)
    one, same, *others = (
        equations(Plant.of(([k], [1, 5, 10, 10, 5, 1]), delay=wait))
        for k, wait in zip(gains, waits, strict=True)
    )
    assert one.startswith("plant: linear, 5 states, SHA-256 of its matrices, dead times and ")
    assert one == same
    assert len({one, *others}) == 3


def test_the_model_of_a_study_is_named_by_its_file_and_its_digest_or_by_its_page(tmp_path):
    record = toy_record()
    code = tmp_path / "own.py"
    code.write_text("import numpy")
    said = model(replace(record, source=f"{code}:tank", fingerprint="ab12"))
    assert f"own.py (SHA-256 {digest_of(code)[:16]}…)" in said
    assert "fingerprint of the scenario ab12, prefcal " in said
    lag = load("lag")
    said = model(replace(record, scenario=lag, source="lag"))
    assert "Equations in code, states: " in said
    assert said.endswith("Built in, documented in docs/loops.md.")
    for name in ("cstr", "overtake", *CLOSED_LOOPS):
        page = model(replace(record, source=name)).rpartition("documented in ")[2].rstrip(".")
        assert name in (Path(__file__).parents[3] / page).read_text(encoding="utf-8").lower()


def test_the_configuration_of_a_scenario_is_said_in_words():
    limits = ["overshoot <= 8 %", "phase_margin >= 45"]
    config = {"plant": "oven.py:plant", "limits": limits, "reference": {"T": 60.0}, "stop_time": 300.0}
    said = model(replace(toy_record(), source=joined_source("pid", config)))
    words = (
        "limits overshoot <= 8 % and phase_margin >= 45, plant oven.py:plant, reference T = 60, stop time 300"
    )
    assert said.startswith(f"pid: {words}, prefcal ")
    cars = {"lanes_count": 3, "cars": [{"x": 1.0}, {"x": 2.0}], "quiet": True}
    said = model(replace(toy_record(), source=joined_source("overtake", cars)))
    assert said.startswith("overtake: cars (2 entries), lanes count 3, quiet True, prefcal ")


def test_a_study_is_complete_where_little_is_left_to_gain():
    left = toy_record(stop_after=4)
    enough = replace(left, ended="little is left to gain")
    assert [json.loads(best_as_json(record))["complete"] for record in (left, enough)] == [False, True]


def test_the_printed_code_rebuilds_the_controller(best, monkeypatch):
    monkeypatch.chdir(best.parent)
    names = {}
    exec(REBUILD, names)
    assert type(names["controller"]).__name__ == "Proportional"


def test_a_scenario_file_is_also_found_beside_best_json(best):
    (best.parent / "moved.py").write_text(TOY_FILE.read_text("utf-8"), encoding="utf-8")
    assert load_controller(changed(best, scenario="moved.py:toy")).T_s > 0


def test_the_plant_of_a_pid_is_found_beside_best_json_or_the_study(best, tmp_path, monkeypatch):
    plant = "from prefcal_env.plants.plant import Plant\nplant = Plant.of(([1.0], [9.0, 1.0]), delay=2.0)\n"
    theta = {"K_p": 1.0, "T_i": 9.0, "T_d": 0.0, "b": 1.0}
    moved = changed(best, scenario='pid {"plant": "own_lag.py:plant"}', theta=theta, ranges={}, before={})
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    with pytest.raises(ScenarioError, match=r"no file 'own_lag\.py'"):
        tuning_of(moved)
    (tmp_path / "study").mkdir()
    (tmp_path / "study" / "own_lag.py").write_text(plant, encoding="utf-8")
    changed(best, origin={"study": str(tmp_path / "study" / "mine.prefcal")})
    assert tuning_of(moved).scenario.name == "pid-own_lag"
    changed(best, origin={})
    (best.parent / "own_lag.py").write_text(plant, encoding="utf-8")
    assert tuning_of(moved).scenario.name == "pid-own_lag"


def test_other_settings_than_todays_are_refused_unless_wanted(best):
    changed(best, settings={"T_s": 9.0})
    with pytest.raises(ScenarioError, match=r"T_s: 9\.0 in the file"):
        load_controller(best)
    assert load_controller(best, check=False).T_s > 0


@pytest.mark.parametrize(
    ("changes", "error", "words"),
    [
        ({"scenario": "nowhere"}, ScenarioError, "no scenario is called 'nowhere'"),
        ({"scenario": f"{TOY_FILE}:plain"}, ScenarioError, "how to build a controller"),
        ({"format": 99}, ScenarioError, "format 99"),
        ({"theta": {"T_s": 1.0}}, ScenarioError, "must name the knobs"),
        ({"theta": {"T_s": 9.0, "N_p": 4, "gain": 1.0}}, ScenarioError, "must be in"),
        ({"theta": {"T_s": "x", "N_p": 4, "gain": 1.0}}, ScenarioError, "does not fit"),
        ({"theta": {"T_s": 10**400, "N_p": 4, "gain": 1.0}}, ScenarioError, "does not fit"),
        ({"theta": "x" * 3000}, ScenarioError, r"must name the knobs .* got x{200}$"),
        ({"ranges": {"T_s": [0.1, 10**400]}}, ScenarioError, "does not fit"),
        ({"scenario": 3}, ScenarioError, r"'scenario' in .*best\.json' must be text, got 3"),
        ({"units": []}, ScenarioError, r"'units' in .* must be a table, got \[\]"),
        ({"units": {"T_s": 3}}, ScenarioError, "knob 'T_s' is in 3 there"),
        ({"origin": "mine"}, ScenarioError, "'origin' in .* must be a table, got 'mine'"),
        ({"units": {"T_s": "min"}}, ScenarioError, "knob 'T_s' is in min there, and in h in scenario"),
    ],
)
def test_a_best_json_that_does_not_fit_is_refused(best, changes, error, words):
    with pytest.raises(error, match=words):
        load_controller(changed(best, **changes))


@pytest.mark.parametrize("key", ["theta", "settings"])
@pytest.mark.parametrize("use", [tuning_of, load_controller, partial(export_controller, to="st")])
def test_theta_and_settings_that_were_changed_by_hand_are_not_used(best, use, key):
    content = json.loads(best.read_text("utf-8"))
    best.write_text(json.dumps(content, indent=4), encoding="utf-8")  # laid out anew, but the same
    if use in (tuning_of, load_controller):
        use(best)
    content[key]["T_s"] = content[key]["T_s"] * 0.9
    best.write_text(json.dumps(content), encoding="utf-8")
    error = ScenarioError if use is load_controller else StaleError
    with pytest.raises(error, match=r"best\.json' was changed by hand: theta and settings are not"):
        use(best)


def test_what_is_written_is_read_again(best):
    content = json.loads(best.read_text("utf-8"))
    assert content["written as"] == written_as(content)


def test_what_another_program_writes_anew_is_no_change_by_hand(best):
    content, theta = json.loads(best.read_text("utf-8")), tuning_of(best).theta.tolist()
    for as_number in (int, float):  # as `jq .` and Node do, or others
        whole = lambda text, kind=as_number: kind(n) if (n := float(text)).is_integer() else n  # noqa: E731
        again = json.loads(json.dumps(content, sort_keys=True), parse_int=whole, parse_float=whole)
        best.write_text(json.dumps({**again, "format": 1}, sort_keys=True), encoding="utf-8")
        assert list(json.loads(best.read_text("utf-8"))["theta"]) == ["N_p", "T_s", "gain"]
        assert tuning_of(best).theta.tolist() == theta
    said = {"theta": {"b": 2.0, "a": 0.1}, "settings": {"N": 10, "T_f": None, "on": True}}
    assert written_as(said) == written_as(
        {"settings": {"on": True, "T_f": None, "N": 10.0}, "theta": {"a": 0.1, "b": 2}}
    )
    assert written_as(said) != written_as({**said, "theta": {"b": 2.0, "a": 0.2}})


def test_the_first_experiment_that_keeps_all_limits_is_known_where_the_best_one_does_not(tmp_path):
    record = toy_record()
    own = record.result.experiment
    name, other = next(
        (name, trial)
        for name in own.kpis
        for trial in record.trials
        if not trial.experiment.end.interrupted and trial.experiment.kpis[name] > own.kpis[name]
    )
    limit = KPI(name, "limited", at_least=other.experiment.kpis[name])
    strict = replace(record, scenario=replace(record.scenario, kpis=(limit,)))
    first = next(t for t in record.trials if limit.met_by(t.experiment) and not t.experiment.end.interrupted)
    (tmp_path / "best.json").write_text(best_as_json(strict), encoding="utf-8")
    found = tuning_of(tmp_path / "best.json").scenario.references
    assert next(iter(found)) == f"experiment {first.number}"
    assert found[f"experiment {first.number}"].tolist() == first.experiment.theta.tolist()
    assert "keeping" not in best_as_json(record)  # no limit is missed


@pytest.mark.parametrize("text", ["", "[]", "{}", "not json"])
def test_something_that_is_no_best_json_is_refused(tmp_path, text):
    path = tmp_path / "best.json"
    path.write_text(text)
    with pytest.raises(ScenarioError, match=r"best\.json"):
        load_controller(path)


def test_an_end_that_no_experiment_has_is_refused(best):
    with pytest.raises(ScenarioError, match=r"\"ended\" in .* must be one of \[.*time is up.*, got 'bored'"):
        tuning_of(changed(best, ended="bored"))


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(ScenarioError, match="cannot read"):
        load_controller(tmp_path / "best.json")


def test_nothing_can_be_exported_before_the_first_experiment():
    with pytest.raises(ScenarioError, match="before the first experiment"):
        best_as_json(toy_record(stop_after=0))


def test_json_stays_strict():
    value = {"a": np.inf, "b": np.array([1.5, np.nan]), "c": (np.int64(2), True), "d": None}
    assert jsonable(value) == {"a": None, "b": [1.5, None], "c": [2, True], "d": None}


# --- The controller in the form of the plant's system.

CHANNELS = {"time_unit": "s", "x": [], "u": [["valve", "%"]], "y": [["T", "°C"]]}
HEATER = PID(2.0, 120.0, 10.0, T_s=1.0, b=0.5, low=0.0, high=100.0)


@pytest.fixture
def heater(best):
    units = {"T_s": "h", "N_p": "", "gain": "", "K_p": "%/°C"}
    return changed(best, settings=as_data(HEATER), channels=CHANNELS, units=units)


def test_best_json_names_what_its_controller_is_connected_to(best):
    channels = toy_record().best.experiment.channels
    said = json.loads(best.read_text("utf-8"))["channels"]
    assert said["time_unit"] == channels.time_unit == "h"
    assert said["y"] == [[c.name, c.unit] for c in channels.y]


@pytest.mark.parametrize("to", ["st", "c"])
def test_code_is_that_of_the_controller_and_says_where_it_is_from(heater, to):
    text = export_controller(heater, to, name="heater")
    named = Channels((), (Channel("valve", "%"),), (Channel("T", "°C"),), "s")
    expected = as_code(HEATER, to, named, name="heater")
    first, held, rest = text.split("\n", 2)
    assert held.startswith("   Not verified on other plants than the modeled one")
    assert rest == "   " + expected[len("/* ") :]  # two lines more in the first comment
    assert json.loads(heater.read_text("utf-8"))["title"] in first
    assert "SHA-256 of best.json: " in first


def test_the_forms_have_equations_numbers_and_units(heater):
    lines = [" ".join(line.split()) for line in export_controller(heater, "forms", time="min").splitlines()]
    assert "parallel: K_p e + K_i ∫e dt + K_d de/dt" in lines
    assert "T_i 2 min" in lines
    assert "1/T_i (repeats per minute) 0.5 1/min" in lines
    assert "K_i 1 %/(°C min)" in lines
    in_percent = export_controller(heater, "forms", spans=(50.0, 100.0))
    lines = [" ".join(line.split()) for line in in_percent.splitlines()]
    assert "PB (proportional band) 100 %" in lines  # 2 %/°C over 50 °C: 1 % a %
    assert [line.split()[0] for line in lines[-4:]] == ["K", "PB", "K′", "PB′"]


def test_numbers_to_copy_have_no_typographic_signs(heater):
    text = export_controller(changed(heater, settings=as_data(HEATER) | {"K_p": -2e-7}), "forms")
    values = [line[37:].split()[0] for line in text.splitlines() if line.startswith("  ")]
    assert "-2e-07" in values
    assert "".join(values).isascii()


def test_a_form_that_a_pid_does_not_have_says_why(heater):
    text = export_controller(changed(heater, settings=as_data(HEATER) | {"T_d": 60.0}), "forms")
    assert "K_p′ – (the series form cannot have a T_d above about a quarter of T_i)" in " ".join(text.split())


def test_a_best_json_of_before_says_no_channels_and_is_exported_all_the_same(heater):
    content = json.loads(heater.read_text("utf-8"))
    del content["channels"]
    heater.write_text(json.dumps(content))
    assert "sampling time of 1 (the plant's unit of time)" in export_controller(heater, "st")
    assert "T_i" in export_controller(heater, "forms")
    with pytest.raises(SettingsError, match="times in no unit cannot be shown in 'min'"):
        export_controller(heater, "forms", time="min")


def test_what_cannot_be_exported_says_why(heater):
    with pytest.raises(SettingsError, match="for 'forms' only"):
        export_controller(heater, "st", time="min")
    lqr = as_data(LQR(Plant.of(([1.0], [1, 1])), [1.0], [1.0], T_s=0.1))
    changed(heater, settings=lqr)
    with pytest.raises(SettingsError, match="only a PID has forms"):
        export_controller(heater, "forms")
    with pytest.raises(SettingsError, match="in C only"):
        export_controller(heater, "st")


@pytest.mark.parametrize("to", ["st", "c", "forms"])
def test_an_export_executes_no_file_of_a_scenario(best, tmp_path, to):
    (tmp_path / "own.py").write_text("raise SystemExit('executed')")
    none = r"best\.json' holds no controller, since its scenario states no settings: state settings=lambda "
    other = r"describe no PID, LQR, LQG or LinearMPC, .*as_code and load_controller"
    for settings, words in (({}, none), ({"gain": 1.0}, other), (None, none)):
        changed(best, scenario=f"{tmp_path / 'own.py'}:toy", settings=settings)
        with pytest.raises(ScenarioError, match=words):
            export_controller(best, to)


@pytest.mark.parametrize(
    "changes",
    [
        {"title": "PID of T by valve (changes from 52 °C at 40 %)"},
        {"channels": CHANNELS | {"u": [["change of valve", "%"]]}},
        {"channels": CHANNELS | {"y": [["T", "°C (changes)"]]}},
    ],
)
@pytest.mark.parametrize("to", ["st", "c"])
def test_a_controller_of_changes_says_so_before_all_else(heater, to, changes):
    assert "changes" not in export_controller(heater, to)
    text = export_controller(changed(heater, **changes), to)
    assert text[3:].startswith("ATTENTION: tuned on changes. All signals and limits are changes")


@pytest.mark.parametrize("to", ["st", "forms"])
def test_what_settings_leave_out_is_as_in_a_new_pid(heater, to):
    whole = export_controller(heater, to).split("\n", 1)[1]
    settings = as_data(HEATER)
    del settings["N"], settings["c"]  # 10 and 0
    assert export_controller(changed(heater, settings=settings), to).split("\n", 1)[1] == whole


@pytest.mark.parametrize("y", [[3], "ab", [{"T": 1, "K": 2}], None, [["T"]], [["T", 3]]])
def test_channels_that_are_none_are_refused(heater, y):
    with pytest.raises(ScenarioError, match="must name channels"):
        export_controller(changed(heater, channels=CHANNELS | {"y": y}), "st")


@pytest.mark.parametrize("key", ["u", "y"])
def test_fewer_channels_than_the_controller_has_are_refused(heater, key):
    with pytest.raises(ScenarioError, match=f"must name at least 1 of '{key}'.*got 0"):
        export_controller(changed(heater, channels=CHANNELS | {key: []}), "st")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"theta": 3}, "theta in .* must be a table of numbers, got 3"),
        ({"theta": [2.0, 1.0]}, "must be a table of numbers"),
        ({"theta": {"K_p": None}}, "must be a table of numbers, got .*None"),
        ({"theta": {"K_p": "high"}}, "must be a table of numbers, got .*'high'"),
        ({"settings": as_data(HEATER) | {"K_p": 10**400}}, "data of a PID do not fit"),
        ({"settings": as_data(HEATER) | {"low": True}}, "must be numbers, got true or false"),
        ({"settings": {"controller": "LQR"}}, "data of a LQR do not fit: 'model' is missing"),
        ({"settings": {"controller": ["PID"]}}, "describe no PID"),
    ],
)
def test_a_best_json_with_something_else_in_it_is_refused(heater, changes, words):
    with pytest.raises(ScenarioError, match=words):
        export_controller(changed(heater, **changes), "c")


def test_an_mpc_of_a_linear_plant_is_exported_and_loaded_from_best_json_alone(heater):
    mpc = LinearMPC(Plant.of(([1.0], [9.0, 1.0])), MPCSettings(1.0, 9, 2, [[1.0]], [[0.1]], u_max=[4.0]))
    changed(heater, settings=as_data(mpc), channels=CHANNELS | {"x": [["x1", ""]]})
    text = export_controller(heater, "c", name="heater")
    assert "MPC, to be called once in every sampling time of 1 s" in text
    assert "static inline int heater(" in text
    m = Measurement(t=0.0, x=np.ones(1), u=np.zeros(1), d=np.zeros(0), y_ref=np.full(1, 3.0))
    assert load_controller(heater).move(m).u == mpc.move(m).u
    with pytest.raises(SettingsError, match="in C only"):
        export_controller(heater, "st")
