"""The pages of a report fit on screens of any width, and curves on paper are large."""

import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from prefcal_app.report.pictures import best_against
from prefcal_app.report.write import page as page_of
from prefcal_app.report.write import sheet
from prefcal_env.knobs import Knob, KnobSpace
from support.verified import FOUND
from toy_study import toy_record

PAPER = 703
"""Width of a line on A4 paper, in pixels."""


def many_knobs(record, count):
    """The record with as many knobs, and with values as long as numbers get."""
    knobs = KnobSpace([Knob(f"weight_{k}", -1.0, 1.0, unit="kJ/kg") for k in range(count)])

    def moved(comparison):
        sides = {
            name: replace(side, theta=np.full(count, -1.234e-5))
            for name in ("challenger", "incumbent")
            if (side := getattr(comparison, name)) is not None
        }
        return comparison._replace(**sides)

    return replace(
        record,
        scenario=replace(record.scenario, space=knobs, references={}),
        references={},
        comparisons=tuple(map(moved, record.comparisons)),
        surrogate=None,
    )


@pytest.fixture
def text():
    record = replace(
        toy_record(),
        study="./mine.prefcal",
        fingerprint="0123456789abcdef",
        settings={"calibrator": "human", "scenario": 'pid {"plant": "some/where/model.py:plant"}'},
        dates=("2026-01-31T10:05:59+00:00", "2026-02-01T11:00:00+00:00"),
    )
    return page_of(record, [])


@pytest.mark.parametrize("width", [390, 1280])
def test_no_table_reaches_over_its_place(browser, text, width):
    page = browser.new_page(viewport={"width": width, "height": 800})
    page.set_content(text)
    assert page.evaluate("document.documentElement.scrollWidth") == width
    listings = "all => all.map(t => [t.scrollWidth, t.parentElement.clientWidth])"
    assert all(own <= room for own, room in page.eval_on_selector_all("details > table", listings))
    ends = page.eval_on_selector_all(
        ".pair > table", "all => all.map(t => t.getBoundingClientRect()).map(b => [b.left, b.right])"
    )
    assert len(ends) == 3
    assert width == 390 or all(a[1] <= b[0] for a, b in pairwise(ends))


WORDS = "usual: this is a range that nobody stated, " + "and what is said of it takes more than a line " * 3


@pytest.mark.parametrize(
    "made", [sheet, lambda record, found: page_of(record, [], found)], ids=["sheet", "report"]
)
@pytest.mark.parametrize("width", [390, 1280])
def test_what_varied_wraps_and_is_never_cut(browser, made, width):
    long = (("time constant of the jacket temperature", "0.9 to 1.1 of that of the model", WORDS),)
    page = browser.new_page(viewport={"width": width, "height": 800})
    page.set_content(made(toy_record(), replace(FOUND, varied=long, left_out=(("jitter of it", WORDS),))))
    assert page.evaluate("document.documentElement.scrollWidth") == width
    varied = page.locator("[aria-label='What varied'], [aria-label^='What was not varied']")
    rooms = varied.evaluate_all("all => all.map(box => [box.scrollWidth, box.clientWidth])")
    assert len(rooms) == (0 if made is sheet else 2)  # a list on the sheet
    assert width == 390 or all(own <= room for own, room in rooms)


def test_on_a_phone_what_was_gained_needs_no_scrolling(browser, text):
    page = browser.new_page(viewport={"width": 390, "height": 800})
    page.set_content(text)
    box = page.locator("[aria-label='What was gained']")
    assert box.evaluate("box => box.scrollWidth <= box.clientWidth")


@pytest.mark.parametrize("knobs", [3, 20])
def test_a_printed_report_names_every_experiment_and_cuts_nothing_off(browser, knobs):
    record = toy_record() if knobs == 3 else many_knobs(toy_record(), knobs)
    page = browser.new_page(viewport={"width": PAPER, "height": 1000}, color_scheme="dark")
    page.set_content(page_of(record, []))
    page.emulate_media(media="print")
    assert page.evaluate("document.documentElement.scrollWidth") == PAPER
    too_wide = "all => all.filter(b => b.scrollWidth > b.clientWidth).length"
    assert page.eval_on_selector_all(".scroll", too_wide) == 0
    tried = page.locator("[aria-label=Experiments] tbody")
    assert tried.locator("tr").count() == len(record.trials)
    assert tried.locator("th.best").inner_text() == str(record.best.number)
    asked = page.locator("[aria-label=Comparisons] tbody tr").first.locator("th, td")
    assert [cell.is_visible() for cell in asked.all()].count(True) == 5
    printed = page.pdf(format="A4", prefer_css_page_size=True)
    assert len(re.findall(rb"/Type\s*/Page[^s]", printed)) in (2, 3, 4)


def test_curves_are_large_enough_to_read_and_before_differs_from_after(browser):
    page = browser.new_page(viewport={"width": 900, "height": 1200})
    page.set_content(sheet(toy_record()))
    picture = page.locator("figure img").bounding_box()
    assert picture["height"] > 200
    first = best_against(toy_record(), references=False, panels=3, most=5.0).axes[0]
    before, after = (line for line in first.lines if line.get_label()[0] != "_")
    assert before.get_color() != after.get_color()
    assert first.get_position().height > 0.2
