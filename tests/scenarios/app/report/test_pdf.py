"""The PDF of a report has A4 pages alone, its own text, and the same bytes for the same study."""

import re
from dataclasses import replace

import pytest

from prefcal_scenarios import KPI
from prefcal_scenarios.app.report.pdf import FILE, document
from prefcal_scenarios.app.report.pdf.lines import broken, width
from prefcal_scenarios.app.report.pdf.paper import HIGH, MARGIN, SMALL, SPACE, WIDE, Paper
from prefcal_scenarios.app.report.pictures import draw
from prefcal_scenarios.app.report.write import write_report
from support.calibrated import without_figures
from toy_study import toy_record


def boxes(content):
    """Return the sizes of the pages of a PDF, in points."""
    found = re.findall(rb"/MediaBox \[ ?0 0 ([\d.]+) ([\d.]+) ?\]", content)
    return [tuple(map(float, box)) for box in found]


@pytest.fixture
def said(monkeypatch):
    """Record the lines that are put on paper."""
    lines = []
    put = Paper._put

    def noted(self, text, *more, **named):
        lines.append((len(self._pages), text))
        put(self, text, *more, **named)

    monkeypatch.setattr(Paper, "_put", noted)
    return lines


def test_every_page_is_a4_and_the_first_one_is_the_acceptance_sheet(said):
    record = replace(toy_record(), study="mine")
    content = document(record, draw(record))
    assert content.startswith(b"%PDF")
    sizes = boxes(content)
    assert len(sizes) >= 3
    assert {(round(w), round(h)) for w, h in sizes} == {(595, 842)}  # points
    first = " ".join(text for page, text in said if page == 1)
    assert "Acceptance sheet of study mine" in first
    assert "Accepted by (name, signature)" in first
    assert all(knob.name in first for knob in record.scenario.space)
    later = [text for page, text in said if page > 1]
    assert "Every comparison" in later
    assert later.count("newer better") + later.count("older better") == record.questions


def test_equal_studies_give_equal_bytes():
    record = toy_record()
    assert document(record, draw(record)) == document(record, draw(record))


def test_many_kpis_fit_on_the_sheet_and_shrink_no_letter_away(said):
    record = toy_record()
    kpis = tuple(
        KPI(f"k{i}", f"a key performance indicator with a rather long title, number {i}", "kJ/kg")
        for i in range(20)
    )
    crowded = replace(record, scenario=replace(record.scenario, kpis=kpis, cost=None), judged=False)
    document(crowded, ())
    first = [text for page, text in said if page == 1]
    assert "Accepted by (name, signature)" in first
    assert "and 9 more: see report.html" in first


@pytest.fixture
def outside(monkeypatch):
    """Record the lines that are put outside of the margins."""
    wide = []
    put = Paper._put

    def checked(self, text, x, look, *, right=False):
        length = width(text, look.size, bold=look.bold)
        start = x - length if right else x
        if start < MARGIN - 0.01 or start + length > WIDE - MARGIN + 0.01:
            wide.append(text)
        assert MARGIN < self._y <= HIGH - MARGIN
        put(self, text, x, look, right=right)

    monkeypatch.setattr(Paper, "_put", checked)
    return wide


def test_nothing_is_written_outside_of_the_margins(outside):
    record = toy_record()
    document(replace(record, command="prefcal calibrate " + "x" * 300), draw(record))
    assert not outside


@pytest.mark.parametrize("knobs", [14, 20])
def test_a_table_of_many_knobs_becomes_several_that_name_the_experiment(knobs, outside, said):
    names = [f"weight_{k} [kJ/kg]" for k in range(knobs)]
    rows = [(f"{i} (best)", *["-1.234e-05"] * knobs, "time is up") for i in range(1, 4)]
    Paper("wide").table(("experiment", *names, "ended"), rows, SMALL)
    assert not outside
    lines = [text for _, text in said]
    parts = lines.count("experiment")
    assert parts == lines.count("2 (best)") > 1
    assert lines.count("ended") == 1
    assert all(lines.count(f"weight_{k}") == 1 for k in range(knobs))
    assert lines.count("-1.234e-05") == 3 * knobs


def test_a_column_wider_than_the_page_breaks_its_lines(outside):
    Paper("wide").table(("experiment", "x" * 300), [("1", "y" * 300)])
    assert not outside


def test_a_heading_is_never_alone_at_the_end_of_a_page(said):
    paper = Paper("low")
    while paper.left > 0.4:
        paper.text("before")
    assert paper.left > 0.2  # enough for a heading, but not for a row below it
    paper.table(("number", "value"), [("1", "1.5")])
    assert said[-4:] == [(2, "number"), (2, "value"), (2, "1"), (2, "1.5")]


def test_dollars_and_backslashes_are_letters_not_formulas(said):
    record = toy_record()
    title = r"a $\frac{1}$ controller with x_2^3 for 5 $"
    document(replace(record, scenario=replace(record.scenario, title=title)), ())
    assert title in [text for _, text in said]


def test_a_long_study_goes_on_on_further_pages():
    paper = Paper("long")
    paper.table(("number", "value"), [(str(k), "1.5") for k in range(200)])
    assert 4 <= len(boxes(paper.content())) <= 6


def test_lines_break_at_spaces_and_only_long_words_inside():
    text = "one two three four five six"
    lines = broken(text, 9, 1.0)
    assert " ".join(lines) == text
    assert all(width(line, 9) <= 1.0 for line in lines)
    word = broken("x" * 400, 9, SPACE)
    assert "".join(word) == "x" * 400
    assert all(width(line, 9) <= SPACE for line in word)
    assert broken("", 9, 1.0) == [""]
    assert broken("a\nb", 9, 1.0) == ["a", "b"]


def test_a_report_without_pdf_removes_the_one_of_an_earlier_report(tmp_path, monkeypatch):
    without_figures(monkeypatch)
    record = toy_record()
    write_report(record, tmp_path, pdf=True)
    assert (tmp_path / FILE).read_bytes().startswith(b"%PDF")
    write_report(record, tmp_path)
    assert not (tmp_path / FILE).exists()
