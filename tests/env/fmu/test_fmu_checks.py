"""What is wrong about an FMU, a knob or a name is said in one sentence, before anything runs."""

import numpy as np
import pytest

from prefcal_env import FMULoop, Knob
from prefcal_env.errors import KnobError, PlantError
from prefcal_env.fmu import read_model
from support.fmus import built, edited

GAIN = Knob("K_p", 0.1, 100)


@pytest.fixture(scope="module")
def tank(tmp_path_factory):
    return built(tmp_path_factory.mktemp("fmu"))


@pytest.fixture(scope="module")
def tank3(tmp_path_factory):
    return built(tmp_path_factory.mktemp("fmu3"), 3)


def test_the_model_description_is_read(tank):
    model = read_model(tank)
    assert (model.name, model.stop_time, model.step) == ("Tank", 60.0, 0.1)
    assert [v.name for v in model.parameters] == ["K_p", "T_i", "mode"]
    assert [v.name for v in model.outputs] == ["level", "valve"]
    assert model.variables["K_p"].start == 1


@pytest.mark.parametrize(
    ("knob", "words"),
    [
        (Knob("Kp", 0.1, 100), "no parameter 'Kp'. Did you mean 'K_p'?"),
        (Knob("level", 0, 1), "not a tunable or fixed parameter"),
        (Knob("mode", 0, 4), "needs integer=True"),
    ],
)
def test_a_knob_that_is_no_parameter_is_refused(tank, knob, words):
    with pytest.raises(KnobError) as caught:
        FMULoop(tank, [knob], ["level"])
    assert words in str(caught.value)


def test_no_knob_and_a_knob_given_twice_are_refused(tank):
    with pytest.raises(KnobError, match="it can tune 'K_p', 'T_i', 'mode'"):
        FMULoop(tank, [], ["level"])
    with pytest.raises(KnobError, match="more than once"):
        FMULoop(tank, [GAIN, GAIN], ["level"])


def test_a_knob_with_another_unit_is_refused(tank3):
    with pytest.raises(KnobError, match="its unit must be 's' as in the FMU, got 'min'"):
        FMULoop(tank3, [Knob("T_i", 1, 60, "min")], ["level"])


def test_a_knob_beyond_the_limits_of_the_fmu_is_refused(tank, tmp_path):
    limited = edited(tank, tmp_path / "limited.fmu", '<Real start="1"', '<Real start="1" max="50"')
    with pytest.raises(KnobError, match=r"must lie in .*50.*, the limits of the FMU"):
        FMULoop(limited, [GAIN], ["level"])
    loop = FMULoop(limited, [Knob("K_p", 0.1, 50)], ["level"])
    with pytest.raises(KnobError, match="limits of the FMU, got 60"):
        loop(np.array([60.0]))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"outputs": ["levle"]}, "Did you mean 'level'?"),
        ({"outputs": "level"}, r"write ['level']"),
        ({"outputs": []}, "outputs must name one or more"),
        ({"inputs": ["level"]}, "cannot be both"),
        ({"reference": {"valv": 2}}, "reference 'valv' is not among the outputs"),
        ({"reference": {"level": np.nan}}, "must be a finite number"),
        ({"reference": {"level": "levle"}}, "Did you mean 'level'?"),
        ({"stop_time": 0}, "stop_time must be above the start time 0 s"),
        ({"output_interval": 0}, "output_interval must be above 0 s"),
        ({"timeout": 0}, "timeout must be above 0 s"),
    ],
)
def test_a_wrong_name_or_time_is_refused(tank, arguments, words):
    with pytest.raises(PlantError) as caught:
        FMULoop(tank, **{"knobs": [GAIN], "outputs": ["level"], **arguments})
    assert words in str(caught.value)


def test_a_file_that_is_no_fmu_for_this_computer_is_refused(tank, tmp_path):
    with pytest.raises(PlantError, match=r"give the path of a \.fmu file"):
        read_model(tmp_path / "gone.fmu")
    (tmp_path / "text.fmu").write_text("hello")
    with pytest.raises(PlantError, match="is no FMU that can be read"):
        read_model(tmp_path / "text.fmu")
    bare = edited(tank, tmp_path / "bare.fmu", without="binaries")
    with pytest.raises(PlantError, match=r"bare\.fmu"):
        read_model(bare)
    exchange = edited(tank, tmp_path / "exchange.fmu", "CoSimulation", "ModelExchange")
    with pytest.raises(PlantError, match="co-simulation"):
        read_model(exchange)


def test_an_fmu_without_a_stop_time_asks_for_one(tank, tmp_path):
    endless = edited(tank, tmp_path / "endless.fmu", 'stopTime="60.0" ')
    with pytest.raises(PlantError, match="give stop_time, in seconds"):
        FMULoop(endless, [GAIN], ["level"])
