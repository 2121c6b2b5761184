"""A twin simulates for a plant, if it has its knobs and KPIs."""

from dataclasses import replace

import pytest

from prefcal_app.simulating import twin_of
from prefcal_env.errors import SettingsError
from support.twins import model, other_knobs, plant, renamed


def test_a_twin_takes_the_ranges_of_the_plant():
    narrow = plant.space.narrowed({"gain": (0.2, 0.5)})
    found = twin_of(replace(plant, space=narrow), model)
    assert found.space == narrow
    assert found.name == "model"


@pytest.mark.parametrize(
    ("wrong", "complaint"),
    [
        (plant, "the twin 'plant' does not let experiments run unseen"),
        (other_knobs, r"expected gain, delay \[s\], got gain, lag \[s\]"),
        (renamed, "it lacks slow, rough, and has speed"),
    ],
    ids=["not simulated", "other knobs", "other KPIs"],
)
def test_a_scenario_that_cannot_be_the_twin_is_refused(wrong, complaint):
    with pytest.raises(SettingsError, match=complaint):
        twin_of(plant, wrong)


@pytest.mark.parametrize("unit", ["min", "m", ""])
def test_a_twin_with_a_kpi_in_another_unit_is_refused(unit):
    first, *others = plant.kpis
    ours, theirs = (
        replace(each, kpis=(replace(first, unit=stated), *others))
        for each, stated in ((plant, "s"), (replace(model, kpis=plant.kpis), unit))
    )
    with pytest.raises(SettingsError, match=f"{first.name!r} is in {unit or 'no unit'}, expected s"):
        twin_of(ours, theirs)
    assert twin_of(ours, replace(theirs, kpis=(replace(first, unit="sec"), *others))).name == "model"


def test_a_plant_needs_kpis_with_a_direction_if_its_twin_has_some():
    bare = replace(plant, kpis=tuple(replace(kpi, better=None) for kpi in plant.kpis))
    with pytest.raises(SettingsError, match="'plant' must have KPIs with a direction, as its twin"):
        twin_of(bare, model)
