import numpy as np
import pytest

from prefcal_env import End, Knob
from prefcal_env.errors import KnobError, PlantError, RunError, ScenarioError
from prefcal_scenarios.worlds.fmu import fmu_scenario
from worlds.fmu.building import built, changed

pytest.importorskip("fmpy")
pytest.importorskip("pythonfmu")

KNOBS = (Knob("K_p", 0.1, 10.0, scale="log10"), Knob("T_i", 1.0, 60.0))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("fmus")


@pytest.fixture(scope="module")
def tank(folder):
    return built(folder, "Tank")


def test_without_knobs_the_error_lists_the_parameters_with_options_to_copy(tank):
    with pytest.raises(ScenarioError) as found:
        fmu_scenario(tank)
    lines = str(found.value).splitlines()[1:]
    assert lines == [
        '  --knob "K_p=0.1:10:log"  (now 1)',
        '  --knob "T_i=1:100:log"  (now 10)',
        '  --knob "order=-3:7:int"  (now 2)',
    ]


def test_names_and_references_decide_what_is_an_output(tank):
    made = fmu_scenario(tank, knobs=KNOBS, show=["level", "valve"], reference={"level": 2})
    assert [c.name for c in made.run.channels.y] == ["level"]
    assert [c.name for c in made.run.channels.u] == ["valve"]
    assert made.run.channels.y[0].target == 2
    other = fmu_scenario(tank, knobs=KNOBS, show=["valve"])
    assert [c.name for c in other.run.channels.y] == ["valve"]


def test_a_unit_in_show_or_reference_is_the_unit_of_the_curve(tank, folder):
    units = """<UnitDefinitions><Unit name="m"><DisplayUnit name="cm" factor="100"/></Unit>
    </UnitDefinitions><ModelVariables>"""
    level = ['name="level" valueReference="3" causality="output">\n\t\t\t<Real']
    replace = [("<ModelVariables>", units), (level[0], f'{level[0]} unit="m"')]
    path = changed(tank, folder / "metric.fmu", replace=replace)
    for show, reference in (
        (["level [cm]", "valve"], {"level": 200.0}),
        (["valve"], {"level [cm]": 200.0}),
        (["valve", "level"], {"level [cm]": 200.0}),
    ):
        channels = fmu_scenario(path, knobs=KNOBS, show=show, reference=reference).run.channels
        assert [(c.name, c.unit, c.target) for c in channels.y] == [("level", "cm", 200.0)]
        assert [c.name for c in channels.u] == ["valve"]


def test_everything_else_is_found_in_the_fmu(tank):
    made = fmu_scenario(tank, knobs=KNOBS)
    assert made.title == "Tank2"
    assert made.brief == "A tank under PI control."
    assert [c.name for c in made.run.channels.y] == ["level", "target"]
    experiment = made.run(np.array([2.0, 10.0]), seed=3)
    assert experiment.end is End.TIME_UP
    assert fmu_scenario(tank, knobs=KNOBS, title="A", brief="B").title == "A"


@pytest.mark.parametrize(("longest", "simulated"), [(np.inf, True), (0.0, False)])
def test_many_are_simulated_unseen_if_one_is_quick(tank, monkeypatch, longest, simulated):
    monkeypatch.setattr("prefcal_scenarios.worlds.fmu._QUICK", longest)
    assert fmu_scenario(tank, knobs=KNOBS).simulated is simulated


def test_a_run_that_crashes_or_hangs_says_so(folder):
    crashes = fmu_scenario(built(folder, "Crashes"), knobs=KNOBS)
    with pytest.raises(RunError, match="SIGABRT"):
        crashes.run(np.array([4.0, 10.0]))
    hangs = fmu_scenario(built(folder, "Hangs"), knobs=KNOBS, timeout=0.5)
    with pytest.raises(RunError, match=r"longer than 0\.5 s"):
        hangs.run(np.array([4.0, 10.0]))
    assert hangs.run(np.array([2.0, 10.0])).end is End.TIME_UP


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"show": ["levle"]}, PlantError, "Did you mean 'level'?"),
        ({"reference": {"levle": 2}}, PlantError, "Did you mean 'level'?"),
        ({"knobs": [Knob("Kp", 1, 2)]}, KnobError, "Did you mean 'K_p'?"),
        ({"stop_time": -1.0}, PlantError, "stop_time must be above"),
    ],
)
def test_wrong_names_and_times_are_refused_in_one_sentence(tank, options, error, words):
    with pytest.raises(error) as found:
        fmu_scenario(tank, **{"knobs": KNOBS, **options})
    assert words in str(found.value)


def test_an_fmu_with_nothing_to_tune_or_to_show_says_how_to_export_it(tank, folder):
    fixed = changed(tank, folder / "fixed.fmu", replace=[('causality="parameter"', 'causality="local"')])
    with pytest.raises(ScenarioError, match="no tunable parameter: export it again"):
        fmu_scenario(fixed)
    hidden = changed(tank, folder / "hidden.fmu", replace=[('causality="output"', 'causality="local"')])
    with pytest.raises(ScenarioError, match="declares no outputs: say which variables to show"):
        fmu_scenario(hidden, knobs=KNOBS)
