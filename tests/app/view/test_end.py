"""The end compares the result with the first experiment, and says what can be done next."""

import json
from dataclasses import replace

import numpy as np
import pytest

from prefcal_agents.screening.findings import Findings, RobustResult
from prefcal_app.session import Choice, actions
from prefcal_app.summary import Spread
from prefcal_app.view import now_view
from prefcal_app.view.end import (
    NOMINAL,
    Told,
    baseline_of,
    curves_of_both,
    gain_view,
    gained,
    runs_held,
    tell_noise,
)
from prefcal_env import PID, Channel, Channels
from prefcal_env.controllers import as_data
from prefcal_env.plain import to_plain
from prefcal_scenarios.scenario import KPI
from prefcal_scenarios.verification.nominal import Redrawn
from support.interviews import begin
from support.looks import asked
from toy_study import toy_scenario


def over(tmp_path=None, choice=Choice.LEFT):
    interview, now = asked(*[choice] * 5)
    return interview, now, now_view(interview, report=tmp_path)["over"]


def test_every_kpi_of_the_result_stands_beside_the_first_experiment_largest_change_first():
    interview, now, view = over()
    gain = view["gain"]
    heads = [column["name"] for column in gain["table"]["columns"]]
    assert heads == ["", "first experiment (1)", f"best ({now.incumbent + 1})", "change", ""]
    assert gain["same"] == (now.incumbent == 0)
    before, after = interview.past.experiment(0), interview.past.experiment(now.incumbent)
    rows = {row["name"]: row["cells"] for row in gain["table"]["rows"]}
    assert set(rows) == {"settling time t_f", "final level", "largest move"}
    old, new, *_ = rows["settling time t_f"]
    assert [float(text["text"]) for text in (old, new)] == [
        pytest.approx(e.kpis["t_f"], abs=0.05) for e in (before, after)
    ]
    assert new["met"] == (after.kpis["t_f"] <= 20)


@pytest.mark.parametrize("baseline", ["current tuning", "paper"])
def test_the_tuning_that_the_person_gave_stands_beside_the_result(baseline):
    theta, best = [{"name": "T_s"}], 3
    found = gain_view(baseline, best, [], theta)
    assert found["before"] == theta
    assert f"To go back, set the values of the {baseline}" in found["back"]
    assert gain_view("first experiment", best, [], theta)["before"] == []  # it was in no plant
    assert gain_view(baseline, 0, [], theta)["before"] == []  # nothing was changed


def test_without_a_result_there_is_no_reason_for_one():
    interview = begin(toy_scenario(), n_max=3)
    interview.do(actions.Finish())
    assert now_view(interview)["over"]["why"] == []


@pytest.mark.parametrize(
    ("verdicts", "first"),
    [
        (["better", "better", "better", "worse", "worse", "better", ""], 5),
        (["better", "better"], 2),
        (["", "", "", ""], 3),
        (["worse", "worse", ""], 2),
        ([], 0),
    ],
)
def test_gains_and_all_that_they_cost_are_shown_before_other_kpis(verdicts, first):
    row = {"title": "a", "before": "1", "after": "2", "met": None, "change": "", "unit": "", "about": ""}
    rows = [row | {"verdict": verdict, "objective": ""} for verdict in verdicts]
    assert gain_view("first experiment", 1, rows, [])["first"] == first


def test_the_rows_of_every_screen_begin_with_the_largest_gains_and_all_that_they_cost():
    first = asked()[0].past.experiment(0)
    kpis = [KPI(name, name, better="lower") for name in "abcdefg"]
    before = replace(first, kpis=dict.fromkeys("abcdefg", 1.0))
    after = replace(first, kpis=dict(zip("abcdefg", (1.001, 0.8, 9.0, 0.1, 0.5, 0.3, 1.5), strict=True)))
    rows = gained(before, after, kpis, Spread())
    assert "".join(row["title"] for row in rows) == "dfecgba"
    assert gain_view("first experiment", 1, rows, [])["first"] == 5


NOISE = Redrawn(
    (("a [s]", "1 (0 to 3)", "2 (1 to 3)", "12 of 20"), ("b", "1", "2 (1.8 to 2.2)", "20 of 20")),
    {"a": "better with 12 of 20"},
    ("b ≤ 2 is kept with 18 of 20 draws",),
)


def test_a_change_within_the_noise_is_neither_a_gain_nor_a_cost():
    first = asked()[0].past.experiment(0)
    kpis = [KPI(name, name, better="lower") for name in "abc"]
    before = replace(first, kpis={"a": 2.0, "b": 2.0, "c": 1.0})
    after = replace(first, kpis={"a": 0.5, "b": 1.0, "c": 1.0})
    rows = gained(before, after, kpis, Spread(), noise=NOISE)
    assert [(row["title"], row["verdict"]) for row in rows] == [
        ("b", "better"),
        ("a", "within noise"),
        ("c", ""),
    ]
    shown = gain_view("first experiment", 1, rows, [])
    assert shown["first"] == 1
    assert shown["headline"] == "B: 2 → 1"
    assert gain_view("first experiment", 0, rows, [])["headline"] == ""
    assert gain_view("first experiment", 1, rows[1:], [])["headline"] == ""
    assert [row["cells"][3]["text"] for row in shown["table"]["rows"]] == ["better", "within noise", ""]
    assert tell_noise(rows, NOISE) == (
        "All experiments share one draw of the sensor noise. Of 20 others, at least 19 confirm each “better” "
        "and “worse” that is measured in a run. Within the noise: a (better with 12 of 20). "
        "B ≤ 2 is kept with 18 of 20 draws."
    )


def test_without_noise_nothing_is_said_of_it_and_what_is_not_known_has_its_reason():
    rows = [{"title": "a", "verdict": "better"}]
    assert tell_noise(rows, Redrawn()) == tell_noise(rows, "") == ""
    assert tell_noise(rows, "40 runs take more than 20 s") == (
        "All experiments share one draw of the sensor noise. Others were not tried at the end of the study: "
        "40 runs take more than 20 s."
    )
    first = "All experiments share one draw of the sensor noise."
    lacking = replace(NOISE, lacking="the noise of step.csv, 0.4 °C", unsteady={}, remarks=())
    assert tell_noise(rows, lacking) == (
        "The runs that were compared are without the noise of step.csv, 0.4 °C. Of 20 draws of it, at least "
        "19 confirm each “better” and “worse” that is measured in a run."
    )
    assert tell_noise([{"title": "a", "verdict": ""}], replace(NOISE, remarks=())) == first
    assert tell_noise(rows, Redrawn((("a [s]", "1 (0 to 3)"),))) == first  # the result is the first one


def test_what_is_told_of_noise_stands_below_what_was_gained(tmp_path):
    (tmp_path / NOMINAL).write_text(json.dumps({"noise": to_plain(NOISE)}))
    assert Told.read(tmp_path) == Told(noise=NOISE)
    gain = over(tmp_path)[2]["gain"]
    assert gain["noise"].endswith("B ≤ 2 is kept with 18 of 20 draws.")
    (tmp_path / NOMINAL).write_text(json.dumps({"noise": "a run failed"}))
    assert over(tmp_path)[2]["gain"]["noise"].endswith("at the end of the study: a run failed.")
    assert Told.read(None) == Told.read(tmp_path / "none") == Told()


def test_a_slight_change_that_meets_an_objective_is_a_gain():
    found = row(20.05, 19.95)
    assert (found["verdict"], found["met"]) == ("better", True)


def row(before, after, *, kpi=None, study=()):
    first = asked()[0].past.experiment(0)
    kpi = kpi or KPI("t_f", "settling time", "h", at_most=20.0)
    runs = [replace(first, kpis={} if v is None else {kpi.name: v}) for v in (before, after)]
    spread = Spread({kpi.name: v} for v in study)
    return next(iter(gained(*runs, [kpi], spread)), None)


@pytest.mark.parametrize(
    ("before", "after", "change", "verdict"),
    [
        (7.5, 3.0, "−4.5 h", "better"),
        (3.0, 7.5, "+4.5 h", "worse"),
        (np.inf, 3.0, "", "better"),
        (3.0, 3.0, "no change", ""),
        (3.0, 3.0 + 1e-7, "no change", ""),
        (3.0, 3.05, "+0.05 h", ""),
    ],
)
def test_a_change_is_signed_and_a_slight_one_is_neither_better_nor_worse(before, after, change, verdict):
    found = row(before, after)
    assert (found["change"], found["verdict"]) == (change, verdict)


def pictured(wiggle=0.0, time=1.0):
    """The picture of a loop whose pressure hardly moves, and whose level then wiggles by so much."""
    level, pressure = Channel("level", "m"), Channel("pressure", "bar")
    valve, heater = Channel("valve", "%"), Channel("heater", "kW")
    t = np.linspace(0.0, 10.0, 101)
    still = np.exp(-t)
    first = asked()[0].past.experiment(0)
    before = replace(
        first,
        t=t,
        x=np.column_stack([still, still]),
        u=np.column_stack([still, still]),
        u_control=np.column_stack([first.u_control, first.u_control]),
        y_ref=np.zeros((len(first.t_control), 0)),
        channels=Channels(x=(pressure, level), u=(valve, heater), y=(), time_unit="h"),
        signals={},
    )
    moved = replace(before, x=np.column_stack([still, still + wiggle * np.sin(t) * (t < time)]))
    return curves_of_both(before, moved, replace(toy_scenario(), panels=()))


def test_the_picture_has_the_response_that_differs_most_and_an_input_of_both():
    found = pictured(wiggle=0.5, time=4.0)
    assert [panel["title"] for panel in found["panels"]] == ["level", "valve"]
    (result,), (baseline,) = found["left"]["curves"][0], found["right"]["curves"][0]
    at = result["t"].index(2.0)
    assert result["y"][at] == pytest.approx(np.exp(-2) + 0.5 * np.sin(2), abs=1e-5)
    assert baseline["y"][at] == pytest.approx(np.exp(-2), abs=1e-5)
    assert "level: from 1 to" in found["left"]["stories"][0]
    assert found["axes"]["x"][1] < 10  # nothing moves any more
    assert found["axes"]["y"][0][1] < 1.2  # and nothing is as high as other experiments of a study
    assert found["time_unit"] == "h"


def test_without_any_difference_there_is_no_picture():
    assert pictured() is None


def test_a_robust_study_gains_runs_that_hold_before_all():
    first = asked()[0].past.experiment(0)
    run, kpi = replace(first, kpis={"t_f": 3.0}), KPI("t_f", "settling time", "h", at_most=20.0)

    def top(**counts):
        found = Findings(True, 9, robustness=RobustResult(**counts))
        row, _ = gained(run, run, [kpi], Spread(), runs_held(found))
        return row["title"], row["before"], row["after"], row["change"], row["verdict"]

    title = "varied runs that hold, of 300"
    assert top(kept=280, first=36) == (title, "36", "280", "+244", "better")
    assert top(kept=36, first=280) == (title, "280", "36", "−244", "worse")
    assert top(kept=300, first=298) == (title, "298", "300", "+2", "")
    assert top(kept=7, first=7) == (title, "7", "7", "no change", "")
    assert runs_held(Findings(True, 9, robustness=RobustResult(300))) is None, "the first one is the result"
    assert runs_held(Findings(True, 9)) is None


def test_what_is_usual_in_the_study_decides_whether_a_change_is_slight():
    assert row(3.0, 3.05, study=[3.0, 3.01, 3.02, 3.05])["verdict"] == "worse"


def test_a_change_of_a_few_percent_is_not_the_largest_though_the_study_hardly_varied():
    first = asked()[0].past.experiment(0)
    kpis = [KPI("error", "error"), KPI("move", "move"), KPI("M_s", "M_s", at_most=2.0)]
    before = replace(first, kpis={"error": 1.0, "move": 52.0, "M_s": 1.95})
    after = replace(first, kpis={"error": 0.97, "move": 116.0, "M_s": 2.05})
    study = ({"error": 1.0 + k * 1e-3, "move": 50.0 + k, "M_s": 2.0} for k in range(9))
    rows = gained(before, after, kpis, Spread(study))
    assert [row["title"] for row in rows] == ["M_s", "move", "error"]


@pytest.mark.parametrize(
    ("start", "name"),
    [
        ([], "first experiment"),
        (["T_s=1, N_p=5, gain=1"], "current tuning"),
        (["paper"], "paper"),
        (["/of/mine.prefcal:best", "paper"], "mine.prefcal:best"),
        (["a/of/best.json"], "result of of"),
        (["best.json"], "result of an earlier study"),
    ],
)
def test_the_result_is_compared_with_the_tuning_that_the_person_gave(start, name):
    _, now = asked()
    options = {**now.state.configuration["options"], "start": start}
    state = replace(now.state, configuration={**now.state.configuration, "options": options})
    assert baseline_of(state) == name


def test_the_report_opens_and_the_controller_can_be_downloaded(tmp_path):
    (tmp_path / "best.json").write_text("{}")
    _, _, view = over(tmp_path)
    assert view["report"] == {
        "place": str(tmp_path / "report.html"),
        "link": "/report/report.html",
        "acceptance": "/report/acceptance.html",
    }
    assert over()[2]["report"] is None
    assert view["next"]["download"] == "/report/best.json"
    assert str(tmp_path / "best.json") in view["next"]["python"]
    _, _, without = over(tmp_path / "nowhere")
    assert (without["next"]["download"], without["next"]["python"]) == (None, "")


def test_the_end_gives_a_pid_in_each_form_and_says_how_to_write_the_controller(tmp_path):
    new, old = (as_data(PID(K_p, 20.0, 8.0, T_s=1.0)) for K_p in (2.0, 1.0))
    content = {"settings": new, "before": {"what": "paper", "settings": old}, "channels": {"time_unit": "s"}}
    (tmp_path / "best.json").write_text(json.dumps(content))
    found = over(tmp_path)[2]["next"]
    forms = found["forms"]
    assert [column["name"] for column in forms["columns"]] == ["", "form", "best", "paper"]
    cells = {row["name"]: [cell["text"] for cell in row["cells"]] for row in forms["rows"]}
    assert cells["K_i"] == ["parallel", "0.1", "0.05"]
    assert cells["T_i′"] == ["series", "–", "–"]  # 4 * 8 > 20
    assert "–: the series form cannot have a T_d above about a quarter of T_i." in forms["caption"]
    assert found["margins"] == ""
    for odd in ("{", "{}", "3", '{"margins": 3}', '{"noise": {"rows": 3}}'):
        (tmp_path / NOMINAL).write_text(odd)
        assert over(tmp_path)[2]["next"]["margins"] == ""
        assert over(tmp_path)[2]["gain"]["noise"] == ""
    words = ["gain margin [dB]: 9 (before 7)", "phase margin [°]: 50 (before 41)"]
    (tmp_path / NOMINAL).write_text(json.dumps({"margins": words}))
    assert over(tmp_path)[2]["next"]["margins"] == (
        "Margins of the nominal loop: gain margin [dB]: 9 (before 7); phase margin [°]: 50 (before 41)."
    )
    best = tmp_path / "best.json"
    assert [each["command"] for each in found["export"]] == [
        f"prefcal export {best} --to st",
        f"prefcal export {best} --to c",
    ]


def test_a_dash_stands_for_what_only_one_of_two_pids_has(tmp_path):
    pi, p = (as_data(PID(2.0, T_i, T_s=1.0)) for T_i in (20.0, np.inf))
    for new, old, told in (
        (pi, p, ["all", "20", "–"]),
        (p, pi, ["all", "–", "20"]),
        (pi, {}, ["all", "20", "–"]),
    ):
        content = {
            "settings": new,
            "before": {"what": "paper", "settings": old},
            "channels": {"time_unit": "s"},
        }
        (tmp_path / "best.json").write_text(json.dumps(content))
        forms = over(tmp_path)[2]["next"]["forms"]
        cells = {row["name"]: [cell["text"] for cell in row["cells"]] for row in forms["rows"]}
        assert cells["T_t (tracking time of the anti-windup)"] == told
        assert "–:" not in forms["caption"]  # that is for the series form


def test_other_controllers_have_no_forms_at_the_end(tmp_path):
    (tmp_path / "best.json").write_text(json.dumps({"settings": {"controller": "LQR"}}))
    found = over(tmp_path)[2]["next"]
    assert found["forms"] is None
    assert [each["what"] for each in found["export"]] == ["C (C99)"]
    odd = {"controller": "PID", "K_p": "high"}
    for text in (
        '{"settings": {"gain": 1.0}}',
        "not JSON",
        "[3]",
        '{"settings": null, "before": null, "channels": 3}',
        json.dumps({"settings": {"controller": []}, "before": {"settings": odd}}),
    ):
        (tmp_path / "best.json").write_text(text)
        assert over(tmp_path)[2]["next"]["export"] == over()[2]["next"]["export"] == []
