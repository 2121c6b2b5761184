"""Two runs from anywhere on the same panels."""

import numpy as np
import pytest

from prefcal_env import recorded
from prefcal_env.errors import ExperimentError
from prefcal_scenarios import look
from prefcal_scenarios.app.looking.view import pair_view


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


def titles(found):
    return [(p.channel.name, p.channel.unit) for p in found.pair.panels]


def test_curves_share_a_panel_by_name_and_unit_whatever_their_instants():
    found = look(run(), run(0.1, n=77))
    assert titles(found) == [("level", "m"), ("valve", "")]
    view = pair_view(found.pair)
    assert [len(view[side]["curves"][0][0]["t"]) for side in ("left", "right")] == [101, 77]


def test_another_unit_gets_a_panel_and_kpis_of_its_own():
    found = look(run(), run(unit="cm"))
    assert titles(found) == [("level", "m"), ("level", "cm"), ("valve", "")]
    rows = [r for r in found.kpis() if r["title"] == "overshoot of level"]
    assert {r["unit"] for r in rows} == {"m", "cm"}
    assert all("–" in (r["left"]["text"], r["right"]["text"]) for r in rows)


def test_a_curve_of_one_run_only_is_drawn_there():
    found = look(run(), run(flow=np.ones(101)))
    view = pair_view(found.pair)
    assert titles(found)[1] == ("flow", "")
    assert view["left"]["curves"][1] == []
    assert len(view["right"]["curves"][1]) == 1


def test_differences_are_those_of_tracking_kpis():
    (row,) = [r for r in look(run(), run(0.1)).kpis() if r["title"] == "integrated error of level"]
    # Integral of 2 exp(-k t) from 0 to 50, by left Riemann sums with steps of 0.5 s.
    assert row["better"] == "left"
    t = np.arange(0, 50, 0.5)
    left, right = (2 * np.exp(-k * t).sum() * 0.5 for k in (0.2, 0.1))
    assert row["difference"] == f"+{right - left:.3g} m s"


def test_runs_at_other_times_start_together_and_this_is_said():
    found = look(run(), run(start=1000.0))
    assert found.pair.right.experiment.t[0] == 0
    assert "start at 0" in found.pair.notes[0]
    assert look(run(), run(start=10.0)).pair.right.experiment.t[0] == 10


def test_times_are_converted_to_the_unit_of_the_left_run():
    found = look(run(), run(time_unit="min"))
    assert found.pair.right.experiment.t[-1] == pytest.approx(3000)
    assert found.pair.right.experiment.channels.time_unit == "s"


def test_different_constant_references_are_both_drawn():
    other = recorded([0.0], np.arange(3.0), {"level": np.ones(3)}, reference={"level": 1.0},
                     units={"level": "m"})  # fmt: skip
    view = pair_view(look(run(), other).pair)
    assert view["panels"][0]["target"] is None
    assert [view[s]["references"][0]["y"][0] for s in ("left", "right")] == [2, 1]


def test_what_is_no_experiment_is_refused():
    with pytest.raises(ExperimentError, match="the right run must be an Experiment, got dict"):
        look(run(), {})


def test_a_notebook_gets_a_picture_without_markup_from_names():
    html = look(run(), run(0.1), names=("<b>", "a$b$"))._repr_html_()
    assert "data:image/png;base64," in html
    assert "<b>" not in html
