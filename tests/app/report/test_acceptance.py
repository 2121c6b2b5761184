"""The acceptance sheet says what changes and prints on one or two pages."""

import json
import re
import runpy
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from prefcal_app.report.export import best_as_json
from prefcal_app.report.write import answers, limits_kept, resting, sheet, sheet_of
from prefcal_app.view.end import CURRENT
from prefcal_env.controllers import LQR, as_data
from prefcal_env.experiments.experiment import Channel
from prefcal_env.plants.plant import Plant
from prefcal_scenarios import KPI, load
from prefcal_scenarios.described.pid_scenario import pid_scenario
from prefcal_scenarios.wording import exact_number
from support.browser import CHROMIUM, FLAGS
from support.verified import FOUND
from toy_study import PID_SETTINGS, toy_record


def pages_of(text, folder):
    """Print a page to PDF, and return its number of pages."""
    (folder / "sheet.html").write_text(text, encoding="utf-8")
    subprocess.run(
        [
            CHROMIUM,
            "--headless",
            *FLAGS,
            f"--user-data-dir={folder / 'profile'}",
            "--no-pdf-header-footer",
            f"--print-to-pdf={folder / 'sheet.pdf'}",
            (folder / "sheet.html").as_uri(),
        ],
        check=True,
        timeout=120,
        capture_output=True,
    )
    return len(re.findall(rb"/Type\s*/Page[^s]", (folder / "sheet.pdf").read_bytes()))


def crowded(record):
    """The record with as many long KPIs as nobody has."""
    kpis = tuple(
        KPI(
            f"k{i}",
            f"a key performance indicator with a rather long title, number {i}",
            "kJ/kg",
            at_most=float(i),
        )
        for i in range(20)
    )
    return replace(record, scenario=replace(record.scenario, kpis=kpis, cost=None), judged=False)


def test_the_sheet_names_study_version_values_and_dates():
    record = replace(
        toy_record(),
        study="mine",
        settings={"calibrator": "human"},
        dates=("2026-01-31T10:05:59+00:00", "2026-02-01T11:00:00+00:00"),
    )
    text = sheet(record)
    assert "of study mine, 2026-01-31 10:05 to 2026-02-01 11:00 (UTC)" in text
    assert "Before: first experiment (experiment 1)" in text
    assert f"After: experiment {record.best.number}" in text
    assert "Accepted by" in text
    assert "Tuned by (name) (signature)" in text
    assert "Tuned by Ada (signature)" in sheet(replace(record, by="Ada"))
    assert "comparisons by a person" in text
    rows = len(record.kpis) + len(record.scenario.space)
    assert text.count('<th scope="row">') == rows + 3  # how the run ended, the valve's limits and moves
    assert "valve saturated" in text
    assert "the tuning in use was not given" in text
    tuned = replace(record, baseline=CURRENT, fingerprint="0123456789abcdef")
    text = sheet(tuned)
    assert f'<th scope="col">{CURRENT}</th><th scope="col">experiment' in text
    assert "To go back, set the parameters" in text
    assert "fingerprint of the scenario 0123456789abcdef" in text


def test_a_kpi_with_an_objective_stays_on_a_sheet_without_room_for_all():
    kpis = tuple(KPI(f"k{i}", f"k{i}", better="lower") for i in range(20))
    kpis += (KPI("M_s", "maximum sensitivity M_s", at_most=2.0),)
    record = toy_record()
    record = replace(record, scenario=replace(record.scenario, kpis=kpis, cost=None), judged=False)
    changed = {f"k{i}": 1.0 for i in range(20)} | {"M_s": 2.1}
    for trial in record.trials:
        object.__setattr__(trial, "experiment", replace(trial.experiment, kpis=changed))
    content = sheet_of(record)
    met = {row["name"]: row["cells"][-1]["text"] for row in content["kpis"]["rows"]}
    assert met["maximum sensitivity M_s"] == "NO"
    assert content["more_kpis"] > 0


def test_what_decided_stands_first_before_what_got_worse_and_keeps_its_row():
    kpis = (KPI("worse", "worse", better="lower"), KPI("better", "better", better="lower"))
    kpis += tuple(KPI(f"M{k}", f"M{k}", at_most=2.0) for k in range(20))
    record = toy_record()
    record = replace(record, scenario=replace(record.scenario, kpis=kpis, cost=None), judged=False)
    for trial in record.trials:
        best = trial.index == record.best.index
        values = {"worse": 9.0 if best else 1.0, "better": 1.0 if best else 1.5}
        changed = values | {f"M{k}": 1.0 for k in range(20)}
        object.__setattr__(trial, "experiment", replace(trial.experiment, kpis=changed))
    names = [row["name"] for row in sheet_of(record)["kpis"]["rows"]]
    assert set(names[:2]) == {"worse", "better"}


def test_theta_has_the_digits_of_best_json():
    record = toy_record()
    theta = json.loads(best_as_json(record))["theta"]
    rows = {row["name"]: row["cells"][1]["text"] for row in sheet_of(record)["knobs"]["rows"]}
    assert {n: float(rows[n].replace("−", "-")) for n in theta} == pytest.approx(theta, rel=1e-9)
    assert exact_number(0.8999999999999998) == "0.9"
    assert exact_number(-1.492) == "−1.492"


@pytest.mark.parametrize(("low", "high", "words"), [(0.0, 100.0, "never"), (0.0, 1.0, "100 % of the time")])
def test_the_sheet_says_how_long_an_input_was_at_its_limit(low, high, words):
    e = toy_record().best.experiment
    channel = replace(e.channels.u[0], low=low, high=high)
    e = replace(e, channels=replace(e.channels, u=(channel,)))
    row = next(iter(limits_kept(e, e)))
    limits, before, after, *_ = (cell["text"] for cell in row["cells"])
    assert (row["name"], limits) == ("valve saturated", f"0 to {high:g} %")
    assert before == after == words


def test_the_largest_step_of_an_input_counts_the_first_one_where_its_start_is_known():
    def largest(e, of):
        (row,) = (r for r in limits_kept(e, e, resting(of)) if "largest step" in r["name"])
        return row["name"], float(row["cells"][2]["text"])

    scenario = pid_scenario(Plant.of(([1.0], [50.0, 1.0]), delay=4.0, inputs=[Channel("u", "", 0, 100)]))
    e = scenario.run(np.array([*scenario.references["MIGO"][:3], 1.0]))  # b: all of the step acts at once
    kick, later = e.u[0, 0] - 50.0, np.abs(np.diff(e.u[:, 0])).max()  # it rests in the middle
    assert later < 0.5 * kick
    assert largest(e, scenario) == ("u, largest step between samples", pytest.approx(kick, rel=0.01))
    own = replace(scenario, run=lambda theta: e)
    after = "u, largest step between samples after the first"
    assert largest(e, own) == (after, pytest.approx(later, rel=0.01))
    assert resting(load("lag")) == pytest.approx(load("lag").run.function.__self__.task.u0)


def test_the_sheet_of_a_program_has_no_dates_so_that_it_can_be_repeated():
    assert "2026" not in sheet(replace(toy_record(), dates=("2026-01-31T10:05:59+00:00",)))


def test_names_are_escaped():
    record = toy_record()
    scenario = replace(record.scenario, title="<script>alert(1)</script>")
    assert "<script>" not in sheet(replace(record, scenario=scenario))


@pytest.mark.browser
@pytest.mark.parametrize("change", [lambda record: record, crowded], ids=["usual", "crowded"])
def test_the_sheet_prints_on_two_pages_at_most(tmp_path, change):
    assert pages_of(sheet(change(toy_record()), FOUND), tmp_path) <= 2


def test_the_sheet_names_the_controller_that_is_code_of_ones_own(tmp_path):
    record = toy_record()
    e = record.result.experiment
    often = f"sampled every {e.t_control[1] - e.t_control[0]:.4g} h; form and action as written there"
    rows = dict(answers(record))
    assert rows["The controller"] == (
        f"Code in toy_scenario.py, class Proportional, {often}; only its settings are in best.json."
    )
    (tmp_path / "tank.py").write_text(
        "from functools import partial\nfrom prefcal_env import PID\n"
        "def pi(theta, T_i):\n    return PID(theta[0], T_i, T_s=1.0)\n"
        "made = partial(pi, T_i=3.0)\nnameless = lambda theta: pi(theta, 3.0)\n"
    )
    own = runpy.run_path(str(tmp_path / "tank.py"))
    for made, name in ((own["made"], ", function pi"), (own["nameless"], ""), (None, "")):
        scenario = replace(record.scenario, controller=made, settings=None)
        here = replace(record, scenario=scenario, source=f"{tmp_path / 'tank.py'}:tank")
        assert dict(answers(here))["The controller"] == f"Code in tank.py{name}, {often}; not in best.json."


def test_the_sheet_names_a_controller_that_best_json_holds_and_a_pid_by_its_forms_alone():
    record = toy_record()
    lqr = as_data(LQR(Plant.of(([1.0], [1, 1])), [1.0], [1.0], T_s=0.1))
    held = replace(record, scenario=replace(record.scenario, settings=lambda theta: lqr))
    assert re.fullmatch(
        r"LQR, sampled every [\d.]+ h; complete in best\.json\.", dict(answers(held))["The controller"]
    )
    pid = dict(answers(replace(record, scenario=replace(record.scenario, settings=lambda t: PID_SETTINGS))))
    assert "The PID" in pid
    assert "The controller" not in pid
    assert "The controller" not in dict(answers(replace(record, source="lag")))


def test_symbols_in_the_forms_of_a_pid_are_set_as_all_others():
    record = toy_record()
    text = sheet(replace(record, scenario=replace(record.scenario, settings=lambda theta: PID_SETTINGS)))
    assert "<td>K<sub>p</sub>/T<sub>i</sub></td>" in text
    assert "<td>√(T<sub>i</sub> T<sub>d</sub>)</td>" in text
    assert "∫(u − v)/T<sub>t</sub> dt" in text
