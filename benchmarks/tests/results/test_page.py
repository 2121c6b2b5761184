"""The folder of a campaign and its page."""

import base64
import csv
import re
import subprocess
import sys

import pytest

from bench_support.campaigns import duel, failed, grid, result
from bench_support.worths import published, study, walks
from prefcal_bench.cells.duels import PAPER
from prefcal_bench.results.campaign import campaign_of
from prefcal_bench.results.page import write
from prefcal_bench.results.pictures import Material, draw_loops, draw_overview
from prefcal_env.errors import SettingsError
from support.pages import Outline, assert_accessible

FACTORS = {"GLISp": 1.0, "<Own> & co": 3.0, "RandomSearch": 100.0}
FIGURES = ["gap-answers.png", "gap-experiments.png"]


def campaign():
    return [
        *grid(FACTORS),
        failed("GLISp", "bowl", 9, "the worker <died>", n_max=3),
        *[result(a, "road", s, None, n_max=3, seconds=0.01) for a in FACTORS for s in range(3)],
    ]


def duels():
    names = list(FACTORS)
    found = [duel(a, PAPER, s, -1) for a in names for s in range(3)]
    return found + [duel(names[0], name, s, s - 1) for name in names[1:] for s in range(3)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("bench") / "made"
    notes = ("GLIS on road: <no> cost",)
    index = write(campaign(), duels(), path, command="prefcal bench --jobs 2", digest="ab12", notes=notes)
    assert index == path / "index.html"
    return path


@pytest.fixture(scope="module")
def page(folder):
    return (folder / "index.html").read_text(encoding="utf-8")


def test_the_folder_holds_every_figure_the_tables_and_the_page(folder):
    names = sorted(p.name for p in folder.iterdir())
    assert names == sorted(["index.html", "table.csv", "worth.csv", "duels.csv", *FIGURES])
    rows = list(csv.DictReader((folder / "table.csv").open()))
    assert len(rows) == 12
    assert {row["agent"] for row in rows} == set(FACTORS)


def test_the_page_holds_every_figure_and_asks_the_network_for_nothing(folder, page):
    inside = {base64.b64decode(m) for m in re.findall(r"base64,([^\"]+)", page)}
    assert inside == {(folder / name).read_bytes() for name in FIGURES}
    assert "http" not in page
    assert "<script" not in page


def test_the_page_is_accessible_and_follows_the_color_scheme(page):
    assert_accessible(page)


@pytest.mark.parametrize(
    "words",
    [
        "prefcal bench --jobs 2",
        "ab12",
        "numpy",
        "python",
        "1e-9",
        "GLISp on bowl, perfect, seed 9",
        "the worker &lt;died&gt;",
        "GLIS on road: &lt;no&gt; cost",
        "bowl, perfect calibrator: no seed 9 of",
        "Not complete",
        "&lt;Own&gt; &amp; co",
    ],
)
def test_the_page_lists_command_versions_failures_and_what_was_left_out_escaped(page, words):
    assert words in page
    assert "<Own>" not in page


def test_alternative_texts_say_what_the_figures_say(page):
    alts = " ".join(a["alt"] for a in Outline(page).all("img"))
    assert "Lowest median gap at the end: bowl GLISp (0.0025)" in alts


def test_the_lowest_median_of_each_problem_is_tinted(page):
    table = page[page.index("Median gaps") :]
    table = table[: table.index("</table>")]
    rows = re.findall(r'<tr><th scope="row">(\w+)</th>(.*?)</tr>', table)
    for name, cells in rows:
        assert cells.count('class="best"') == 1, name
    assert "<td>3 of 3</td><td>0 of 3</td><td>0 of 3</td>" in table
    assert "<td>1.00</td><td>2.00</td><td>3.00</td>" in table


def test_equal_results_write_equal_bytes_in_whatever_order(folder, tmp_path, page):
    write(
        reversed(campaign()),
        reversed(duels()),
        tmp_path,
        command="prefcal bench --jobs 2",
        digest="ab12",
        notes=("GLIS on road: <no> cost",),
    )
    for path in folder.iterdir():
        assert path.read_bytes() == (tmp_path / path.name).read_bytes(), path.name


def made(folder, results, **options):
    """The text of a page, and the names of the figures beside it."""
    write(results, [], folder, **options)
    return (folder / "index.html").read_text(encoding="utf-8"), {p.name for p in folder.glob("*.png")}


def column(path, name):
    return {row[name] for row in csv.DictReader(path.open())}


def test_a_smaller_campaign_takes_the_figures_of_a_larger_one_away(tmp_path):
    for name in ("ranking.png", "gaps-noisy.png", "worth-drift-noisy.png", "holiday.png", "duels.txt"):
        (tmp_path / name).write_bytes(b"")
    text, _ = made(tmp_path, [result("GLISp", "p", s, (1.0, 0.1)) for s in range(2)])
    names = {"index.html", "table.csv", "worth.csv", "duels.csv", *FIGURES, "holiday.png", "duels.txt"}
    assert {p.name for p in tmp_path.iterdir()} == names
    assert "Not complete" not in text
    assert "Seconds per proposal: measured in serial runs only" in text


def test_several_calibrators_have_figures_each(tmp_path):
    named = ("perfect", "noisy")
    text, figures = made(
        tmp_path, [result("GLISp", "p", s, (1.0, 0.1), calibrator=c) for c in named for s in range(2)]
    )
    assert {name for name in figures if "-e" in name} == {f"gap-experiments-{name}.png" for name in named}
    assert text.index("Median gaps (perfect calibrator)") < text.index("(noisy calibrator)")


@pytest.mark.parametrize("results", [[], [failed()]])
def test_a_campaign_without_any_result_has_a_page_that_says_so(tmp_path, results):
    text, figures = made(tmp_path, results)
    Outline(text)
    assert "No study has finished yet" in text
    assert not figures


def test_a_baseline_without_results_is_told(tmp_path):
    assert "there are no results of GLISp" in made(tmp_path, [result("A", "p", 0, (1.0, 0.1))])[0]


def test_nothing_is_written_of_impossible_results(tmp_path):
    with pytest.raises(SettingsError):
        write([result(), result(gaps=(1.0, 0.3))], [], tmp_path / "made")
    assert not (tmp_path / "made").exists()


CAPTIONS = """end => [...document.querySelectorAll(".scroll")]
  .filter((box) => box.querySelector("caption") && box.scrollWidth > box.clientWidth).map((box) => {
    box.scrollLeft = end;
    const words = document.createRange();
    words.selectNodeContents(box.querySelector("caption"));
    const [of, within] = [words, box].map((each) => each.getBoundingClientRect());
    return [of.left - within.left, of.right - within.left, box.clientWidth].map(Math.round);
  })"""
LOOPS = walks({"GLISp": 1.3, "GLIS": 1.6, "RandomSearch": 1.0}, seeds=2, n_max=5)


def test_closed_loops_come_first_and_have_no_gaps(tmp_path):
    page, _ = made(tmp_path, [*LOOPS, *grid(FACTORS)])
    assert_accessible(page)
    headings = re.findall(r"<h2>(.*?)</h2>", page)
    assert headings[:3] == ["Worth after 5 experiments", "Worth along the study", "Worth: weights"]
    assert headings.index("Worth: weights") < headings.index("Median gaps")
    assert column(tmp_path / "table.csv", "problem") == {"bowl", "valley", "waves"}
    assert column(tmp_path / "worth.csv", "taste") == {"weights"}
    assert column(tmp_path / "worth.csv", "agent") == {"GLISp", "GLIS", "RandomSearch"}


def test_a_caption_is_in_sight_wherever_its_table_is_scrolled(tmp_path, browser):
    text, _ = made(tmp_path, LOOPS)
    page = browser.new_page(viewport={"width": 420, "height": 900})
    page.set_content(text)
    for end in (0, 10_000):
        ends = page.evaluate(CAPTIONS, end)
        assert ends
        assert all(0 <= left <= right <= room for left, right, room in ends), ends
    assert page.evaluate("document.documentElement.scrollWidth") == 420


def test_of_closed_loops_alone_the_page_does_not_speak_of_gaps(tmp_path):
    page, figures = made(tmp_path, LOOPS)
    assert " gap" not in page[page.index("</style>") :]
    assert figures == {f"worth-{name}.png" for name in ("summary", "drift", "experiments", "answers")}


def test_published_studies_stand_beside_ours(tmp_path):
    mine = walks({"own.py:Mine": 1.4}, seeds=2, n_max=5)
    page, _ = made(tmp_path, mine, baseline="own.py:Mine", published=published(LOOPS))
    assert "Beside them, 3 published agents." in page
    assert "beats own.py:Mine" in page
    assert column(tmp_path / "worth.csv", "agent") == {"own.py:Mine", "GLISp", "GLIS", "RandomSearch"}


def test_a_table_alone_loads_no_plots():
    code = "import sys, prefcal_bench.results as r; r.table([]); "
    code += "print([m for m in ('matplotlib', 'torch') if m in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        env={"PYTHONPATH": ":".join(p for p in sys.path if p)},
    )
    assert done.stdout.strip() == "[]"


def shown(results, baseline="GLISp"):
    material = Material(campaign_of(results), baseline=baseline)
    return {one.file: one for one in (*draw_overview(material), *draw_loops(material))}


def test_every_taste_has_figures_by_loop_but_not_those_with_wrong_answers():
    tastes = ("weights", "limits", "weights-noisy10")
    found = shown(walks({"GLISp": 1.2, "Own": 1.0}, ("servo",), tastes, 2, n_max=5))
    assert list(found) == [
        "worth-summary.png",
        "worth-drift.png",
        "worth-summary-noisy.png",
        "worth-drift-noisy.png",
        *(f"worth-{by}-{taste}.png" for taste in tastes[:2] for by in ("experiments", "answers")),
    ]
    assert all(one.content.startswith(b"\x89PNG") for one in found.values())


def test_without_others_or_answers_there_are_fewer():
    found = shown([study("GLIS", questions=(0, 0))])
    assert list(found) == ["worth-summary.png", "worth-drift.png", "worth-experiments.png"]
    assert shown([]) == {}


def test_alternative_texts_say_what_the_figures_of_worth_say():
    results = [study(worth=(1, 8, 4)), study("Own", worth=(1, 2, 40))]
    found = shown(results)
    assert "weights: Own 40, GLISp 4.0" in found["worth-summary.png"].alt
    assert "Own 1.0, GLISp 2.0" in found["worth-drift.png"].alt
    assert "servo Own (40)" in found["worth-experiments.png"].alt
