"""The end compares the result with the first experiment, and says what can be done next."""

from dataclasses import replace

import numpy as np

from prefcal_scenarios.app.session import Choice
from prefcal_scenarios.app.web.view import now_view
from prefcal_scenarios.app.web.view.end import _gain
from prefcal_scenarios.scenario import KPI
from support.looks import asked


def over(tmp_path=None, choice=Choice.LEFT):
    interview, now = asked(*[choice] * 5)
    return interview, now, now_view(interview, report=tmp_path)["over"]


def test_the_main_kpis_of_the_result_stand_beside_those_of_the_first_experiment():
    interview, now, view = over()
    gain = view["gain"]
    assert gain["before"] == "the first experiment"
    assert gain["after"] == now.incumbent + 1
    assert gain["same"] == (now.incumbent == 0)
    before, after = interview.experiment(0), interview.experiment(now.incumbent)
    settled = gain["kpis"][0]
    assert settled["before"] == f"{before.kpis['t_f']:.4g}"
    assert settled["after"] == f"{after.kpis['t_f']:.4g}"
    expected = np.sign(round(before.kpis["t_f"] - after.kpis["t_f"], 3))
    assert settled["verdict"] == {1: "better", -1: "worse", 0: ""}[expected]
    # "largest" has no objective and no better side: nothing can be gained in it.
    assert [kpi["title"] for kpi in gain["kpis"]] == ["settling time t_f", "final level"]


def test_a_change_is_signed_and_never_has_none(tmp_path):
    interview, _, _ = over()
    first = interview.experiment(0)
    kpi = KPI("t_f", "settling time", "h", at_most=20.0)
    never = replace(first, kpis={"t_f": np.inf})
    fast, slow = (replace(first, kpis={"t_f": v}) for v in (3.0, 7.5))
    assert (_gain(kpi, slow, fast)["change"], _gain(kpi, slow, fast)["verdict"]) == (
        "−4.5",
        "better",
    )
    assert (_gain(kpi, fast, slow)["change"], _gain(kpi, fast, slow)["verdict"]) == (
        "+4.5",
        "worse",
    )
    assert _gain(kpi, never, fast)["before"] == "never"
    assert (_gain(kpi, never, fast)["change"], _gain(kpi, never, fast)["verdict"]) == ("", "better")
    nearly = replace(first, kpis={"t_f": 3.0 + 1e-7})
    for other in (fast, nearly):
        assert (_gain(kpi, fast, other)["change"], _gain(kpi, fast, other)["verdict"]) == (
            "no change",
            "",
        )
    assert _gain(kpi, replace(first, kpis={}), fast)["verdict"] == ""
    hardly = replace(first, kpis={"t_f": 3.05})
    assert (_gain(kpi, fast, hardly)["change"], _gain(kpi, fast, hardly)["verdict"]) == (
        "+0.05",
        "",
    )


def test_the_report_opens_and_the_controller_can_be_downloaded(tmp_path):
    (tmp_path / "best.json").write_text("{}")
    _, _, view = over(tmp_path)
    assert view["report"]["link"] == "/report/report.html"
    assert view["next"]["download"] == "/report/best.json"
    assert str(tmp_path / "best.json") in view["next"]["python"]
    _, _, without = over(tmp_path / "nowhere")
    assert (without["next"]["download"], without["next"]["python"]) == (None, "")
