"""The acceptance sheet says what changes and prints on one page."""

import re
import subprocess
from dataclasses import replace

import pytest

from prefcal_scenarios import KPI
from prefcal_scenarios.app.report.acceptance import sheet
from support.browser import CHROMIUM, FLAGS
from toy_study import toy_record


def pages_of(text, folder):
    """Print a page to PDF, and return its number of pages."""
    (folder / "sheet.html").write_text(text, encoding="utf-8")
    subprocess.run(
        [CHROMIUM, "--headless", *FLAGS, f"--user-data-dir={folder / 'profile'}",
         "--no-pdf-header-footer", f"--print-to-pdf={folder / 'sheet.pdf'}",
         (folder / "sheet.html").as_uri()],
        check=True, timeout=120, capture_output=True,
    )  # fmt: skip
    return len(re.findall(rb"/Type\s*/Page[^s]", (folder / "sheet.pdf").read_bytes()))


def crowded(record):
    """The record with as many long KPIs as nobody has."""
    kpis = tuple(
        KPI(f"k{i}", f"a key performance indicator with a rather long title, number {i}", "kJ/kg",
            at_most=float(i))
        for i in range(20)
    )  # fmt: skip
    return replace(record, scenario=replace(record.scenario, kpis=kpis, cost=None), judged=False)


def test_the_sheet_names_study_version_values_and_dates():
    record = replace(
        toy_record(), study="mine", settings={"calibrator": "human"},
        dates=("2026-01-31T10:05:59+00:00", "2026-02-01T11:00:00+00:00"),
    )  # fmt: skip
    text = sheet(record)
    assert "of study mine, 2026-01-31 10:05 to 2026-02-01 11:00 (UTC)" in text
    assert "Before: first experiment (experiment 1)" in text
    assert f"After: experiment {record.best.number}" in text
    assert "Accepted by" in text
    assert text.count('<th scope="row">') == len(record.kpis) + len(record.scenario.space) + 1
    tuned = replace(record, settings={"calibrator": "human", "start": "T_s=1"})
    assert "your tuning at the start" in sheet(tuned)


def test_the_sheet_of_a_program_has_no_dates_so_that_it_can_be_repeated():
    assert "2026" not in sheet(replace(toy_record(), dates=("2026-01-31T10:05:59+00:00",)))


def test_names_are_escaped():
    record = toy_record()
    scenario = replace(record.scenario, title="<script>alert(1)</script>")
    assert "<script>" not in sheet(replace(record, scenario=scenario))


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium here")
@pytest.mark.parametrize("change", [lambda record: record, crowded], ids=["usual", "crowded"])
def test_the_sheet_prints_on_exactly_one_page(tmp_path, change):
    assert pages_of(sheet(change(toy_record())), tmp_path) == 1
