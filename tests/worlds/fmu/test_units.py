"""Display units of an FMU: knobs, curves, references and limits in another unit than its own."""

import zipfile

import numpy as np
import pytest

from prefcal_env import FMULoop, Knob
from prefcal_env.errors import KnobError, PlantError
from prefcal_env.worlds.fmu import read_model
from prefcal_env.worlds.fmu.model import units_in
from worlds.fmu.building import built, changed

pytest.importorskip("fmpy")
pytest.importorskip("pythonfmu")

UNITS = """<UnitDefinitions>
<Unit name="K"><BaseUnit K="1"/><DisplayUnit name="degC" offset="-273.15"/>
<DisplayUnit name="degF" factor="1.8" offset="-459.67"/>
<DisplayUnit name="1/K" inverse="true"/></Unit>
<Unit name="s"><BaseUnit s="1"/><DisplayUnit name="min" factor="0.016666666666666666"/></Unit>
</UnitDefinitions>
<TypeDefinitions><SimpleType name="Step"><Real unit="K" relativeQuantity="true"/></SimpleType>
</TypeDefinitions>
<ModelVariables>"""
T_I = Knob("T_i", 0.1, 1.0, "min")


def declared(name, number, old, new):
    """Return what to replace so that a variable of the tank declares its unit."""
    head = f'name="{name}" valueReference="{number}" causality='
    kind = '"parameter" variability="fixed"' if name == "T_i" else '"output"'
    return tuple(f"{head}{kind}>\n\t\t\t{real}" for real in (old, new))


@pytest.fixture(scope="module")
def tank(tmp_path_factory):
    """Return the tank whose level is in K, whose valve is a difference in K, and T_i in s."""
    folder = tmp_path_factory.mktemp("fmus")
    replace = [
        ("<ModelVariables>", UNITS),
        declared("T_i", 1, '<Real start="10"/>', '<Real unit="s" min="6" max="60" start="10"/>'),
        declared("level", 3, "<Real/>", '<Real unit="K" min="0"/>'),
        declared("valve", 4, "<Real/>", '<Real declaredType="Step"/>'),
        declared("target", 5, "<Real/>", '<Real unit="K"/>'),
    ]
    return changed(built(folder, "Tank"), folder / "units.fmu", replace=replace)


def test_a_knob_in_a_display_unit_gives_the_same_run(tank):
    seconds = FMULoop(tank, [Knob("T_i", 6.0, 60.0, "s")], ["level"])
    minutes = FMULoop(tank, [T_I], ["level"])
    assert minutes.space.knobs[0].unit == "min"
    for T_i in (0.1, 0.25, 1.0):
        same = seconds(np.array([60 * T_i]))
        np.testing.assert_allclose(minutes(np.array([T_i])).y, same.y, rtol=1e-12)


def test_curves_references_and_limits_are_in_the_unit_that_is_asked_for(tank):
    plain = FMULoop(tank, [T_I], ["level"], reference={"level": 2.0})
    made = FMULoop(tank, [T_I], ["level [degC]"], ["valve [degF]"], reference={"level": 2.0 - 273.15})
    one, other = plain(np.array([0.2])), made(np.array([0.2]))
    level, valve = made.channels.y[0], made.channels.u[0]
    assert (level.name, level.unit, level.low) == ("level", "degC", -273.15)
    np.testing.assert_allclose(other.output(0), one.output(0) - 273.15)
    # A shift changes no KPI.
    name = "integrated error of level"
    assert other.kpis[name] == pytest.approx(one.kpis[name], rel=1e-9)
    in_kelvin = FMULoop(tank, [T_I], ["level"], ["valve"])(np.array([0.2]))
    assert valve.unit == "degF"
    np.testing.assert_allclose(other.u, 1.8 * in_kelvin.u)  # a difference has no offset


@pytest.mark.parametrize(("said", "own"), [("true", None), (None, "true"), ("true", "false")])
def test_a_variable_that_is_a_difference_has_no_offset(tank, tmp_path, said, own):
    """`said` is what the type says of it, and `own` what it says itself, which counts."""
    of_type = "" if said is None else f' relativeQuantity="{said}"'
    of_variable = "" if own is None else f' relativeQuantity="{own}"'
    replace = [
        ('<Real unit="K" relativeQuantity="true"/></SimpleType>', f'<Real unit="K"{of_type}/></SimpleType>'),
        ('<Real declaredType="Step"/>', f'<Real declaredType="Step"{of_variable}/>'),
    ]
    model = read_model(changed(tank, tmp_path / "difference.fmu", replace=replace))
    difference = "true" in (own, said) and own != "false"
    assert model.variable("valve").difference == difference
    for unit, kelvin in (("degC", 282.15), ("degF", (9 + 459.67) / 1.8)):
        stored = model.variable(f"valve [{unit}]").scale.back(9.0)
        assert stored == pytest.approx((9.0 if unit == "degC" else 5.0) if difference else kelvin)


def test_a_difference_of_fmi_3_is_found_on_the_variable(tmp_path):
    text = (
        '<fmiModelDescription><ModelVariables><Float64 name="band" relativeQuantity="true"/>'
        '<Float64 name="T" relativeQuantity="false"/><Float64 name="p"/>'
        "</ModelVariables></fmiModelDescription>"
    )
    with zipfile.ZipFile(tmp_path / "a.fmu", "w") as file:
        file.writestr("modelDescription.xml", text)
    assert units_in(tmp_path / "a.fmu")[1] == {"band": True, "T": False}


def test_a_reference_that_is_a_variable_follows_the_unit_of_its_output(tank):
    made = FMULoop(tank, [T_I], {"h": "level [°C]"}, reference={"h": "target"})
    assert made.channels.y[0].unit == "°C"
    np.testing.assert_allclose(made(np.array([0.2])).y_ref, 2.0 - 273.15)
    with pytest.raises(PlantError, match="reference 'T_i' is in s, and 'level' in K"):
        FMULoop(tank, [T_I], ["level"], reference={"level": "T_i"})


def test_the_limits_of_the_fmu_hold_in_the_other_unit(tank):
    with pytest.raises(KnobError, match=r"must lie in \[0.1, 1\] min, the limits of the FMU"):
        FMULoop(tank, [Knob("T_i", 0.05, 1.0, "min")], ["level"])
    with pytest.raises(KnobError, match=r"T_i must lie in \[0.1, 1\] min"):
        FMULoop(tank, [T_I], ["level"])(np.array([6.0]))


def test_an_fmu_with_limits_that_leave_no_range_can_be_read(tank, tmp_path):
    both = ('<Real unit="s" min="6" max="60" start="10"/>', '<Real unit="s" min="10" max="10" start="10"/>')
    fixed = changed(tank, tmp_path / "fixed.fmu", replace=[both])
    assert read_model(fixed).variable("T_i [min]").low == pytest.approx(1 / 6)
    with pytest.raises(KnobError, match=r"its range must lie in \[10, 10\] s, the limits of the FMU"):
        FMULoop(fixed, [Knob("T_i", 5.0, 20.0, "s")], ["level"])


def test_another_quantity_is_refused_with_the_units_that_the_fmu_defines(tank):
    with pytest.raises(KnobError, match="its unit must be 's' or 'min' as in the FMU, or alike, got 'm'"):
        FMULoop(tank, [Knob("T_i", 0.1, 1.0, "m")], ["level"])
    words = "unit of 'level' must be 'K' or 'degC' or 'degF' as in the FMU, or alike, got 'bar'"
    with pytest.raises(PlantError, match=words):
        FMULoop(tank, [T_I], ["level [bar]"])


def test_a_unit_that_the_fmu_does_not_define_is_converted_too(tank):
    made = FMULoop(tank, [Knob("T_i", 0.002, 0.016, "h")], ["level [degR]"], reference={"level": 3.6})
    seconds = FMULoop(tank, [Knob("T_i", 6.0, 60.0, "s")], ["level"])
    one, other = seconds(np.array([18.0])), made(np.array([0.005]))
    np.testing.assert_allclose(other.output(0), 1.8 * one.output(0), rtol=1e-12)


def test_an_inverse_display_unit_is_none_to_convert_to(tank):
    assert set(units_in(tank)[0]["K"]) == {"degC", "degF"}
