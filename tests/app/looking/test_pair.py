"""Two runs from anywhere on the same panels."""

from dataclasses import replace

import numpy as np
import pytest

from prefcal_app import look
from prefcal_app.looking.pair import NamedRun, aligned_view, in_time_unit
from prefcal_app.report.pictures import DrawnRun, overlaid
from prefcal_env import recorded
from prefcal_env.errors import ExperimentError
from prefcal_env.experiments.panels import combined
from prefcal_scenarios import KPI


def run(speed=0.2, n=101, unit="m", start=0.0, time_unit="s", **more):
    t = np.linspace(0, 50, n)
    y = 2 - 2 * np.exp(-speed * t)
    return recorded(
        [0.0],
        start + t,
        {"level": y, **more},
        inputs={"valve": 4 - y},
        reference={"level": 2.0},
        units={"level": unit},
        time_unit=time_unit,
    )


def shown(found):
    return aligned_view(found.left, found.right, found.panels, found.known, found.notes)


def titles(found):
    return [(p.channel.name, p.channel.unit) for p in found.panels]


def test_curves_share_a_panel_by_name_and_unit_whatever_their_instants():
    found = look(run(), run(0.1, n=77))
    assert titles(found) == [("level", "m"), ("valve", "")]
    view = shown(found)
    assert [len(view[side]["curves"][0][0]["t"]) for side in ("left", "right")] == [101, 77]


def test_another_quantity_gets_a_panel_and_kpis_of_its_own():
    found = look(run(), run(unit="bar"))
    assert titles(found) == [("level", "m"), ("level", "bar"), ("valve", "")]
    rows = [r for r in found.kpis() if r["title"] == "overshoot of level"]
    assert {r["unit"] for r in rows} == {"m", "bar"}
    assert all("–" in (r["left"]["text"], r["right"]["text"]) for r in rows)


@pytest.mark.parametrize(("unit", "size", "shift"), [("cm", 0.01, 0.0), ("metres", 1.0, 0.0)])
def test_another_unit_is_converted_to_the_left_one(unit, size, shift):
    plain, found = look(run(), run(0.1)), look(run(), run(0.1, unit=unit))
    assert titles(found) == titles(plain)
    (one,), (other,) = (
        [r for r in each.kpis() if r["title"] == "integrated error of level"] for each in (plain, found)
    )
    assert (other["unit"], other["left"]) == ("m s", one["left"])
    error = plain.right.experiment.kpis["integrated error of level"]
    assert found.right.experiment.kpis["integrated error of level"] == pytest.approx(size * error)
    level = "level"
    np.testing.assert_allclose(
        found.right.experiment.signals[level], size * plain.right.experiment.signals[level]
    )
    assert any("is converted from cm to m" in note for note in found.notes) == (unit == "cm")


def test_temperatures_are_shifted_and_their_differences_are_not():
    found = look(run(unit="°C"), run(unit="K"))
    left, right = found.left.experiment, found.right.experiment
    np.testing.assert_allclose(right.signals["level"], left.signals["level"] - 273.15)
    name = "integrated error of level"
    assert right.kpis[name] == pytest.approx(left.kpis[name])
    assert {r["unit"] for r in found.kpis() if r["title"] == name} == {"°C s"}


def test_a_curve_of_one_run_only_is_drawn_there():
    found = look(run(), run(flow=np.ones(101)))
    view = shown(found)
    assert titles(found) == [("level", "m"), ("flow", ""), ("valve", "")]
    assert view["left"]["curves"][1] == []
    assert len(view["right"]["curves"][1]) == 1


def test_runs_at_other_times_start_together_and_this_is_said():
    found = look(run(), run(start=1000.0))
    assert found.right.experiment.t[0] == 0
    assert "start at 0" in found.notes[0]
    assert look(run(), run(start=10.0)).right.experiment.t[0] == 10


def test_different_constant_references_are_both_drawn():
    other = recorded(
        [0.0], np.arange(3.0), {"level": np.ones(3)}, reference={"level": 1.0}, units={"level": "m"}
    )
    view = shown(look(run(), other))
    assert view["panels"][0]["target"] is None
    assert [view[s]["references"][0]["y"][0] for s in ("left", "right")] == [2, 1]


def test_what_is_no_experiment_is_refused():
    with pytest.raises(ExperimentError, match="the right run must be an Experiment, got dict"):
        look(run(), {})


def test_a_notebook_gets_a_picture_without_markup_from_names():
    html = look(run(), run(0.1), names=("<b>", "a$b$"))._repr_html_()
    assert "data:image/png;base64," in html
    assert "<b>" not in html


def test_runs_in_minutes_and_seconds_share_the_rows_of_their_kpis():
    found = look(run(), run(0.2 * 60, time_unit="min"))
    rows = [r for r in found.kpis() if r["title"] == "late error of level"]
    assert [(r["unit"], "–" in (r["left"]["text"], r["right"]["text"])) for r in rows] == [("m s²", False)]
    settled = found.right.experiment.kpis["settling time of level"]
    assert found.right.experiment.t[-1] == 3000
    assert found.right.experiment.channels.time_unit == "s"
    assert settled == pytest.approx(60 * run(12.0).kpis["settling time of level"])


def test_limits_of_kpis_are_converted_with_the_time():
    limited = KPI("rise", "rise", "min", at_most=2.0)
    made = run(time_unit="min").with_kpis({"rise": 1.5, "rise (load)": 1.0})
    converted = in_time_unit(NamedRun("", made, (limited,)), "s")
    (kpi,) = converted.kpis
    assert (kpi.unit, kpi.at_most) == ("s", 120)
    assert dict(converted.experiment.kpis) == {"rise": 90, "rise (load)": 60}


def maneuvers(speed):
    step = replace(run(speed), maneuver="step")
    t = np.linspace(0, 50, 101)
    load = recorded(
        [0.0],
        t,
        {"level": 3 - np.exp(-speed * t)},
        {"valve": np.exp(-speed * t)},
        reference={"level": 3.0},
        units={"level": "m"},
    )
    return combined([step, replace(load, maneuver="load")])


def test_every_maneuver_has_kpis_and_references_of_its_own():
    found = look(maneuvers(0.2), maneuvers(0.1))
    groups = dict.fromkeys(row["group"] for row in found.kpis())
    assert list(groups) == ["worst", "mean", "step", "load"]
    view = shown(found)
    assert [part["maneuver"] for part in (view, *view["others"])] == ["step", "load"]
    # The target of the first maneuver must not be drawn in the second one.
    assert view["panels"][0]["target"] is None
    assert [part["left"]["references"][0]["y"][0] for part in (view, *view["others"])] == [2, 3]


def test_a_run_without_maneuvers_stands_beside_each_of_the_other():
    view = shown(look(run(0.3), maneuvers(0.1)))
    parts = (view, *view["others"])
    assert [part["maneuver"] for part in parts] == ["step", "load"]
    assert all(not part["left"]["empty"] for part in parts)


def test_what_has_no_direction_has_no_worst_maneuver():
    parts = [
        replace(recorded([0.0], np.arange(3.0), {"flow": y}), maneuver=name)
        for name, y in (("a", [1.0, 2, 3]), ("b", [4.0, 5, 6]))
    ]
    found = look(combined(parts), combined(parts))
    assert dict.fromkeys(row["group"] for row in found.kpis()).keys() == {"a", "b"}


def test_the_picture_draws_every_maneuver():
    pair = look(maneuvers(0.2), maneuvers(0.1))
    drawn = overlaid(lambda *_: pair.panels, [DrawnRun(pair.left.experiment, "a", "k")])
    places = [axes for axes in drawn.axes if axes.get_visible()]
    assert len(places) == 2 * len(pair.panels)
