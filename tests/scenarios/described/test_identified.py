"""A record as a plant: its columns, what is kept beside it, and what a verification varies of it."""

import json
from dataclasses import replace

import numpy as np
import pytest

from prefcal_env.envs.varied_loop import factors_of, varied_plant
from prefcal_env.errors import RecordError, ScenarioError, SettingsError
from prefcal_env.plants.explained import Model
from prefcal_env.plants.systems import LinearPlant
from prefcal_env.sources.varied import within
from prefcal_env.tables import TableColumns
from prefcal_scenarios import load
from prefcal_scenarios.described import identified
from prefcal_scenarios.described.identified import Found, ends, plant_of_record, step_test
from prefcal_scenarios.described.making import plant_at
from prefcal_scenarios.described.pid_scenario import pid_scenario
from prefcal_scenarios.names import KEPT_PLANT
from prefcal_scenarios.own import files_of, fingerprint, runs_code
from prefcal_scenarios.verification import verify
from prefcal_scenarios.verification.nominal import DRAWS, compare_draws, noise_of, nominal_of
from prefcal_scenarios.verification.varied_runs import robustly
from support.step_tests import NOISE, ROWS, T, U, response, table


@pytest.fixture(scope="module")
def record(tmp_path_factory):
    path = tmp_path_factory.mktemp("plant") / "step.csv"
    path.write_text(table(), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def plant(record):
    return plant_of_record(str(record))


def test_the_plant_has_the_values_of_the_record_and_moves_as_far_as_its_limits(plant):
    (u,), (y,) = plant.inputs, plant.outputs
    assert (u.name, u.unit, u.low, u.high) == ("valve", "%", 0, 100)
    assert (y.name, y.unit, plant.time_unit) == ("temperature", "°C", "s")
    assert plant.name == "temperature by valve (around 52 °C at 40 %)"
    assert float(plant.system.at(0j)[0, 0].real) == pytest.approx(1.8, rel=0.05)
    none = np.zeros(0)
    x = plant.hold(np.zeros(len(plant.states)), np.array([46.0]), none, [1e3])[-1]
    assert plant.g(x, np.array([46.0]), none) == pytest.approx(52 + 1.8 * 6, abs=0.2)


def test_a_study_stays_near_what_the_record_has_shown(record, plant):
    """The record moves the valve by 6 %: twice that, and not a fifth of what the valve may reach."""
    scenario = load(f'pid {{"plant": "{record.as_posix()}"}}')
    found = Found.read(record.with_suffix(KEPT_PLANT))
    assert found.moved == pytest.approx(6.0)
    (loop,) = scenario.run.kpis.design.loops
    assert loop.target == pytest.approx(52 + 1.8 * 12, rel=0.02)
    said = f"The runs are without the record's noise of {found.noise:.3g} °C: a gain or derivative that"
    assert said in scenario.brief
    assert "noise" not in pid_scenario(replace(found, noise=0.0).plant()).brief
    beyond = "To rest there, valve moves by 12 %, which is more than the 6 % of step.csv: what the model says"
    assert beyond in scenario.brief
    assert "not measured" not in pid_scenario(plant, reference={"temperature": 58.0}).brief
    wide = replace(found, moved=15.0).plant()
    assert wide.outputs[0].target is None, "a usual step is no farther"


def test_the_noise_of_the_record_is_that_with_which_the_result_runs_again(record, plant):
    scenario, found = (
        load(f'pid {{"plant": "{record.as_posix()}"}}'),
        Found.read(record.with_suffix(KEPT_PLANT)),
    )
    noise = noise_of(scenario.source)
    assert noise.lacking == f"the noise of step.csv, {found.noise:.2g} °C"
    theta = scenario.references["MIGO"]
    _, drawn, lacking = nominal_of(scenario.source, [theta], 0)
    assert lacking == noise.lacking
    assert len({run.kpis["total_move"] for run in drawn[0]}) == DRAWS
    assert min(run.kpis["total_move"] for run in drawn[0]) > scenario.run(theta).kpis["total_move"]
    assert verify(scenario, theta, 2, jobs=1).with_other_noise == compare_draws(
        scenario.kpis, [scenario.run(theta)], drawn, "s", noise.lacking
    )


@pytest.mark.parametrize("kind", ["pid", "lqr"])
def test_a_study_starts_where_the_record_did_with_limits_as_the_actuator_has_them(record, plant, kind):
    scenario = load(f'{kind} {{"plant": "{record.as_posix()}", "reference": {{"temperature": 60}}}}')
    theta = scenario.references["MIGO" if kind == "pid" else "middle"]
    made, settings = scenario.run(theta), scenario.settings(theta)
    assert made.y[0] == pytest.approx(52, abs=0.05)
    assert made.y_ref[0] == 60
    assert made.kpis["settling_time"] < np.inf
    assert made.kpis["recovery"] < np.inf
    limits = settings.get("model", settings)
    assert (np.ravel(limits["low"]), np.ravel(limits["high"])) == (0.0, 100.0)
    if kind == "lqr":
        assert limits["u0"] == [40.0]
        assert limits["y0"] == pytest.approx([52], abs=0.05)


@pytest.mark.parametrize(
    ("start", "unit", "expected"), [(0.0, "%", (0, 100)), (97.0, "", (85, 109)), (97.0, "%", (85, 109))]
)
def test_limits_are_those_of_percent_or_twice_the_move_away(tmp_path, start, unit, expected):
    path = tmp_path / "step.csv"
    path.write_text(table("time", f"valve [{unit}]", "level", columns=(T, U - U[0] + start, response())))
    (valve,) = plant_of_record(str(path)).inputs
    assert (valve.low, valve.high) == expected


@pytest.mark.parametrize(("unit", "limits"), [("%", None), ("", (80.0, 120.0)), ("", None)])
def test_limits_that_nobody_stated_are_assumed_and_the_brief_says_so(tmp_path, unit, limits):
    path = tmp_path / "step.csv"
    start = 40.0 if unit else 97.0
    path.write_text(table("time", f"valve [{unit}]", "level", columns=(T, U - U[0] + start, response())))
    found, _ = identified.identified(path, limits=limits)
    found.write(path.with_suffix(".plant.json"))
    scenario = load(f'pid {{"plant": "{path.as_posix()}"}}')
    said = () if unit or limits else ("Nobody stated limits of valve; 85 to 109 is assumed.",)
    assert scenario.assumed == said
    assert all(each in scenario.brief for each in said)


def test_an_input_that_rests_at_its_limit_stays_there_in_a_narrower_range(tmp_path):
    path = tmp_path / "step.csv"
    path.write_text(table(columns=(T, U - U[0], response())))
    plant = plant_of_record(str(path))
    (valve,) = varied_plant(plant, {"range of valve": 0.9}).inputs
    assert (valve.low, valve.high) == (0, 90)
    scenario = load(f'pid {{"plant": "{path.as_posix()}"}}')
    assert (
        "The plant rests here with valve at its limit of 0 %, from where it can only rise." in scenario.brief
    )


def test_a_record_is_identified_once_and_again_when_it_changes(record, plant, monkeypatch):
    monkeypatch.setattr(identified, "identify", lambda *args, **more: pytest.fail("identified again"))
    kept = record.with_suffix(KEPT_PLANT)
    for source in (str(record), str(kept)):
        again = plant_at(source)
        assert isinstance(again, LinearPlant)
        assert np.array_equal(again.system.A, plant.system.A)
    content = kept.read_text(encoding="utf-8")
    kept.write_text(json.dumps({**json.loads(content), "digest": "of another record"}), encoding="utf-8")
    try:
        with pytest.raises(pytest.fail.Exception, match="identified again"):
            plant_at(str(record))
    finally:
        kept.write_text(content, encoding="utf-8")


def test_a_file_that_is_none_is_refused(tmp_path):
    path = tmp_path / f"step{KEPT_PLANT}"
    with pytest.raises(ScenarioError, match=r"cannot read .*step\.plant\.json"):
        plant_at(str(path))
    path.write_text('{"record": 3}')
    with pytest.raises(ScenarioError, match="cannot be read"):
        plant_at(str(path))


def test_a_best_model_that_is_none_of_the_models_is_refused(record, plant, tmp_path):
    content = json.loads(record.with_suffix(KEPT_PLANT).read_text(encoding="utf-8"))
    path = tmp_path / f"step{KEPT_PLANT}"
    path.write_text(json.dumps({**content, "best": 300}))
    with pytest.raises(ScenarioError, match="best must be a number of a model, got 300"):
        Found.read(path)


@pytest.mark.parametrize("damage", ["", "{", '{"reach": 40}'])
def test_a_damaged_or_older_file_beside_a_record_is_not_used_and_what_to_do_is_said(record, tmp_path, damage):
    path = tmp_path / "step.csv"
    path.write_text(record.read_text(encoding="utf-8"), encoding="utf-8")
    path.with_suffix(KEPT_PLANT).write_text(damage)
    with pytest.raises(ScenarioError, match=r"step\.plant\.json.* Delete it, or identify its record again"):
        plant_at(str(path))


@pytest.mark.parametrize("name", ["step.csv", f"step{KEPT_PLANT}"])
def test_a_study_follows_what_was_identified(record, plant, tmp_path, name):
    for source in (record, record.with_suffix(KEPT_PLANT)):
        (tmp_path / source.name).write_bytes(source.read_bytes())
    scenario, kept = f'pid {{"plant": "{(tmp_path / name).as_posix()}"}}', tmp_path / f"step{KEPT_PLANT}"
    assert kept in files_of(scenario)
    before = fingerprint(scenario)
    kept.write_text(json.dumps({**json.loads(kept.read_text(encoding="utf-8")), "limits": [20, 80]}))
    assert fingerprint(scenario) != before


def test_a_file_that_names_a_record_follows_it_and_its_plant(record, plant, tmp_path):
    for source in (record, record.with_suffix(KEPT_PLANT)):
        (tmp_path / source.name).write_bytes(source.read_bytes())
    study = tmp_path / "study.toml"
    study.write_text('controller = "pid"\nplant = "step.csv"\n')
    assert {path.name for path in files_of(str(study))} == {"study.toml", "step.csv", f"step{KEPT_PLANT}"}
    assert not runs_code(str(study))
    (tmp_path / "own.py").write_text("plant = None\n")
    study.write_text('controller = "pid"\nplant = "own.py:plant"\n')
    assert runs_code(str(study))
    assert runs_code('pid {"plant": "step.csv"}')  # not found from here
    assert runs_code("own.py:scenario")
    assert not runs_code("cstr")


def test_a_study_has_the_same_files_before_and_after_its_plant_is_loaded_again(record, plant, tmp_path):
    path = tmp_path / "step.csv"
    path.write_text(record.read_text(encoding="utf-8"), encoding="utf-8")
    source = f'pid {{"plant": "{path.as_posix()}"}}'
    load(source)  # as before each study begins: the plant is kept beside the record
    before = fingerprint(source)
    load(source)
    assert fingerprint(source) == before


# --- What varies: the models in place of gain, time constants and dead time; the rest as usual.


def test_the_sample_takes_the_place_of_gain_lags_and_dead_time(plant):
    sample, *others = factors_of(plant)
    assert (sample.name, sample.kind, sample.low, sample.high) == (
        "plant identified from step.csv",
        "parameter",
        1.0,
        300.0,
    )
    assert robustly([sample, *others], ()) == ((sample,), (*others,)), "a robust study varies it, too"
    assert "identified: gain 1.79 to 1.81 °C/%, time constant 1 19.7 to 20.2 s, dead time" in sample.told
    assert [each.name for each in others] == ["range of valve"]


def test_each_number_is_another_plant_that_rests_where_the_study_does(plant):
    (sample, *_) = factors_of(plant)
    made = [varied_plant(plant, {sample.name: float(k)}).plant for k in (1, 150, 300)]
    assert len({each.system.A.tobytes() for each in made}) == 3
    for each in made:
        assert not each.f(np.zeros(len(plant.states)), plant.u0, np.zeros(0)).any()
        assert each.system.at(0j)[0, 0].real == pytest.approx(1.8, rel=0.1)
    nominal = varied_plant(plant, {}).plant
    assert np.array_equal(nominal.system.A, plant.system.A)
    assert nominal.input_delay == plant.input_delay


def test_the_sample_can_be_left_out_or_cut_but_never_grown(plant):
    factors = [*factors_of(plant)]
    assert [f.name for f in within(factors, {"parameter": 0.0})] == ["range of valve"]
    with pytest.raises(SettingsError, match="only 1 to 300 is possible"):
        within(factors, {"parameter": 0.5})


def test_a_verification_names_the_record_and_what_it_leaves_open(record, plant):
    scenario = load(f'pid {{"plant": "{record.as_posix()}"}}')
    found = verify(scenario, scenario.references["MIGO"], 4, jobs=1)
    assert found.factors[0].name == "plant identified from step.csv"
    assert {run.values[found.factors[0].name] for run in found.runs} <= {float(k) for k in range(1, 301)}
    assert "dead time" not in {name for name, _ in found.left_out}
    # The actuator of the record is in the plants that explain it.
    assert ("lag of the actuators", "the record has that of the actuator in it") in found.left_out
    assert all("lag of the actuators" not in run.values for run in found.runs)
    # Its sensor is as noisy as the record is, where that is more than usual.
    noise = next(factor for factor in found.factors if factor.name == "noise")
    step = abs(scenario.run(scenario.references["MIGO"]).y_ref[0] - 52)
    assert noise.high == pytest.approx(NOISE / step, rel=0.2)
    assert noise.high > 0.002
    assert noise.told == "identified: the noise of step.csv, 0.046 °C"
    assert " The runs that were compared are without the noise of step.csv, 0.046 °C." in found.headline
    quiet = replace(found, factors=tuple(factor for factor in found.factors if factor.name != "noise"))
    assert "compared" not in quiet.headline


def test_intervals_are_told_with_a_digit_more_where_their_ends_read_alike():
    assert ends(1.7964, 1.8037) == ("1.796", "1.804")
    assert ends(1.7964, 1.8135) == ("1.8", "1.81")


def test_models_that_integrate_and_others_are_told_as_a_share(record, plant):
    found = Found.read(record.with_suffix(KEPT_PLANT))
    other = Model("an integrator", (0.1,), (1.0, 0.0), 2.0)
    assert "integrate" not in found.told
    mixed = replace(found, models=(*found.models[:285], *[other] * 15), best=0)
    assert mixed.told.endswith("5 % of the models integrate")
    assert "rate 0" not in mixed.told
    assert "gain 1.7" in mixed.told


# --- Which column is which.


@pytest.mark.parametrize(
    ("headings", "columns", "more", "names"),
    [
        (("time", "level", "valve"), (T, response(), U), {}, ("valve", "level")),
        (("time", "a", "b"), (T, response(), U), {}, ("b", "a")),
        (("time", "a", "b"), (T, U, response()), {"given": "b", "output": "a"}, ("b", "a")),
        (("time", "a", "b", "c"), (T, U, response(), response(2)), {"output": "c"}, ("a", "c")),
        (("time", "heater temperature", "heater power"), (T, response(), U), {}, ("heater power",)),
        (("time", "CV", "MV"), (T, response(), response(2)), {}, ("MV", "CV")),
        (("time", "valve_position", "level"), (T, response(), response(2)), {}, ("valve_position", "level")),
    ],
)
def test_columns_are_guessed_or_named(tmp_path, headings, columns, more, names):
    path = tmp_path / "step.csv"
    path.write_text(table(*headings, columns=columns))
    test = step_test(path, **more)
    assert (test.input.name, test.output.name)[: len(names)] == names
    assert np.array_equal(test.t, T)


@pytest.mark.parametrize(
    ("headings", "columns", "more", "said"),
    [
        (("time", "a", "b"), (T, response(), response(2)), {}, "input.* --input: one of a, b"),
        (("time", "a", "b", "c"), (T, U, response(), response(2)), {}, "output.* --output: one of b, c"),
        (("time", "a", "b"), (T, U, response()), {"given": "c"}, "no column of numbers is called 'c'"),
        (("time", "a"), (T, U), {}, "--output: one of none"),
        (("time", "valve", "b"), (T, response(), U), {}, "input.* --input: one of valve, b"),
    ],
)
def test_what_is_not_obvious_is_asked_for(tmp_path, headings, columns, more, said):
    path = tmp_path / "step.csv"
    path.write_text(table(*headings, columns=columns))
    with pytest.raises(RecordError, match=rf"step\.csv: .*{said}"):
        step_test(path, **more)


def test_a_time_in_another_language_is_read_and_where_it_is_not_found_identify_can_be_told(tmp_path):
    path = tmp_path / "sprung.csv"
    path.write_text(table("Zeit", "Ventil", "Temperatur").replace(",", ";").replace(".", ","))
    test = step_test(path, TableColumns(units={"time": "min"}))
    assert (test.input.name, test.time_unit, test.said) == ("Ventil", "min", "time from 'Zeit' in min")
    assert np.array_equal(test.t, T)
    assert step_test(path).said == "time from 'Zeit' in s, as no unit is given"
    path.write_text(table("Ventil", "Temperatur", "Takt", columns=(U, response(), T)))
    with pytest.raises(RecordError, match=r"--time, .* are those of `prefcal identify .*sprung\.csv`, which"):
        plant_of_record(str(path))
    assert np.array_equal(step_test(path, TableColumns(time="Takt")).t, T)


def test_a_record_that_does_not_tell_is_refused_with_its_name(tmp_path):
    path = tmp_path / "step.csv"
    path.write_text(table("time", "valve", "level", columns=(T, np.full(ROWS, 3.0), response())))
    with pytest.raises(RecordError, match=r"step\.csv: there is no step in the input"):
        plant_of_record(str(path))
    assert not path.with_suffix(KEPT_PLANT).exists()
