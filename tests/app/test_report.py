"""The folder of a report."""

import base64
import csv
import io
import re
from dataclasses import replace
from importlib.resources import files

import matplotlib
import numpy as np
import pytest

from prefcal_app import figure
from prefcal_app.report.pictures import PICTURES, Drawn, Picture, course, draw, knobs
from prefcal_app.report.record import comparisons_as_csv
from prefcal_app.report.write import page as page_of
from prefcal_app.report.write import write_report
from prefcal_app.summary import Outlook
from prefcal_app.view.question import theta_view
from prefcal_env import PID
from prefcal_env.controllers import as_data
from prefcal_env.errors import SettingsError
from prefcal_env.experiments.experiment import End
from prefcal_env.experiments.panels import without_record
from prefcal_env.knobs import KnobSpace
from prefcal_scenarios import Panel
from prefcal_scenarios.style import canvas
from prefcal_scenarios.wording import folder_for, measured, symbols_in, with_subscripts
from support.pages import Outline, assert_accessible
from toy_study import toy_record, toy_scenario

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("report")
    write_report(toy_record(), path)
    return path


@pytest.fixture(scope="module")
def page(folder):
    return (folder / "report.html").read_text(encoding="utf-8")


def test_the_folder_holds_everything_that_was_promised(folder):
    files = {p.name for p in folder.iterdir()}
    figures = {p.file for p in PICTURES if p.applies(toy_record())}
    assert files == {"report.html", "acceptance.html", "best.json", "comparisons.csv", *figures}


def test_every_figure_is_a_png_of_readme_width(folder):
    for picture in PICTURES:
        if not picture.applies(toy_record()):
            continue
        data = (folder / picture.file).read_bytes()
        assert data.startswith(PNG)
        assert 1000 <= int.from_bytes(data[16:20], "big") <= 1400


def test_the_page_asks_the_network_for_nothing(page):
    assert "http" not in page
    assert "<script" not in page
    assert all(a["src"].startswith("data:image/png;base64,") for a in Outline(page).all("img"))


def test_the_images_of_the_page_are_those_of_the_folder(page, folder):
    inside = [base64.b64decode(m) for m in re.findall(r"base64,([^\"]+)", page)]
    assert inside == [(folder / p.file).read_bytes() for p in PICTURES if p.applies(toy_record())]


def test_the_page_is_accessible_and_follows_the_color_scheme(page):
    assert_accessible(page)


def test_what_follows_an_underscore_is_a_subscript(page):
    assert "T<sub>s</sub>" in page
    assert "&lt;sub" not in page
    assert with_subscripts("a<b_c & d") == "a&lt;b<sub>c</sub> &amp; d"


def test_symbols_in_sentences_have_subscripts_and_names_of_files_stay():
    assert symbols_in('kpis = {"M_s" = {at_most = 2}}') == "kpis = {&#34;M_s&#34; = {at_most = 2}}"
    quotients = str(symbols_in("K_p/T_i, 1/T_i ∫e dt, T_d/N, K_p T_i′/T_i, ∫(u − v)/T_t dt."))
    assert quotients.count("<sub>") == 8
    assert "_" not in quotients
    for path in ("K_p/T_i.py", "K_p/T_i/own.py", "of/K_p.toml", "K_p/own.py", "/T_i", "tmp/T_i"):
        assert symbols_in(path) == path
    said = symbols_in("M_s ≤ 2 (K_p, T_i): docs/own_scenario.py:my_loop and x_1.py stay. Then T_d.")
    assert said == (
        "M<sub>s</sub> ≤\xa02 (K<sub>p</sub>, T<sub>i</sub>): docs/own_scenario.py:my_loop and x_1.py stay. "
        "Then T<sub>d</sub>."
    )


def test_no_text_of_a_study_becomes_markup():
    evil = "<script>alert(1)</script>'\"&"
    record = toy_record()
    knobs = KnobSpace([replace(k, name=f"{k.name}{evil}", unit=evil) for k in record.scenario.space])
    kpis = tuple(replace(k, title=evil, unit=evil) for k in record.scenario.kpis)
    scenario = replace(record.scenario, title=evil, space=knobs, kpis=kpis, references={})
    text = page_of(
        replace(
            record,
            scenario=scenario,
            references={evil: record.trials[0].experiment},
            settings={evil: evil, "calibrator": "human"},
            agent_settings={evil: [evil, evil]},
            command=evil,
            trust=evil,
            outlook=Outlook(evil, evil, evil, evil),
        ),
        [Drawn(Picture("a.png", evil, evil, str, bytes), evil, PNG)],
    )
    outline = Outline(text)
    assert outline.all("script") == []
    assert text.count("alert(1)") > 30
    assert "<script" not in text
    assert outline.all("img")[0]["alt"] == evil


def test_no_markup_is_trusted():
    text = "".join(path.read_text("utf-8") for path in files("prefcal_scenarios").rglob("*.html.j2"))
    assert re.findall(r"{{[^}]*\bsafe\b[^}]*}}", text) == []
    assert "autoescape" not in text


def test_the_page_names_settings_versions_command_and_the_way_back(page):
    for text in ("prefcal calibrate toy --seed 1", "load_controller(", "numpy", "python"):
        assert text in page


def test_a_tuned_pid_is_given_in_each_form_and_says_how_it_becomes_a_program():
    record, pid = toy_record(), as_data(PID(2.0, 10.0, 2.0, T_s=0.5))
    tuned = page_of(replace(record, scenario=replace(record.scenario, settings=lambda theta: pid)), [])
    for text in ("series", "repeats per minute", "prefcal export best.json --to st"):
        assert text in tuned
    assert "prefcal export" not in page_of(record, [])


def test_the_same_study_writes_the_same_bytes(folder, tmp_path):
    write_report(toy_record(), tmp_path)
    for path in folder.iterdir():
        assert path.read_bytes() == (tmp_path / path.name).read_bytes(), path.name


def test_the_csv_has_one_row_for_each_question_with_units(folder):
    record = toy_record()
    rows = list(csv.DictReader(io.StringIO((folder / "comparisons.csv").read_text())))
    assert len(rows) == len(record.asked) == 7
    assert float(rows[0]["challenger T_s [h]"]) == record.thetas[1][0]
    assert rows[0]["incumbent experiment"] == "1"
    assert rows[0]["verdict"] in {"newer better", "about the same", "older better", "can't tell"}
    assert rows[0]["incumbent ended"] == "time is up"


def test_a_partial_study_gets_a_readable_report_that_says_so():
    text = page_of(toy_record(stop_after=3), [])
    Outline(text)
    assert "Partial report" in text
    assert "after 3 of 8 experiments" in text


def test_a_study_of_one_experiment_can_be_reported(tmp_path):
    write_report(toy_record(stop_after=1), tmp_path)
    assert (tmp_path / "best.json").is_file()
    assert (tmp_path / "best_trajectory.png").exists()


def test_a_study_without_any_experiment_leaves_a_page_and_no_stale_result(tmp_path):
    for result in ("best.json", "best_trajectory.png"):
        (tmp_path / result).write_bytes(b"of an earlier report")
    write_report(toy_record(stop_after=0), tmp_path)
    assert {p.name for p in tmp_path.iterdir()} == {"report.html", "comparisons.csv"}
    assert "after 0 of 8 experiments" in (tmp_path / "report.html").read_text("utf-8")


def test_a_scenario_with_nothing_but_knobs_shows_what_was_tried(tmp_path):
    plain = toy_record("plain", learn=False)
    page = write_report(plain, tmp_path).read_text(encoding="utf-8")
    assert {p.name for p in tmp_path.glob("*.png")} == {"tried.png"}
    assert page.count("<figure>") == 1


def test_a_scenario_may_bring_its_own_figures_and_the_plot_settings_survive(tmp_path):
    before = dict(matplotlib.rcParams)
    own = Picture("own.png", "Own", "An own one.", lambda r: "own " * 20, lambda r: canvas(1.0))
    write_report(toy_record(stop_after=2), tmp_path, extra=[own])
    assert dict(matplotlib.rcParams) == before
    assert (tmp_path / "own.png").read_bytes().startswith(PNG)


def test_an_infinite_time_reads_as_never_and_other_values_as_they_are():
    experiment = toy_record().trials[0].experiment
    endless = replace(experiment, kpis={"t_f": np.inf, "largest": np.inf, "final": 2.00004})
    words = [measured(kpi, endless) for kpi in toy_record().kpis]
    assert words == ["never", "2", "∞"]


def test_the_incumbent_is_followed_through_the_answers():
    record = toy_record()
    for comparison, trial in zip(record.comparisons, record.incumbents, strict=True):
        assert np.array_equal(comparison.winner.theta, trial.experiment.theta)
    assert sum(record.verdict_counts().values()) == 7


def test_the_best_so_far_is_what_the_study_held_and_is_not_computed_again():
    along = toy_record()
    other = 2 if along.best.index != 2 else 1
    held = (*(t.index for t in along.incumbents[:-1]), other)
    record = replace(along, held=held)
    assert record.best.index == other
    assert tuple(t.index for t in record.incumbents) == held


def test_a_person_is_not_judged_by_an_index_that_they_never_chose(tmp_path, page):
    write_report(replace(toy_record(), judged=False), tmp_path)
    assert "performance index" not in (tmp_path / "report.html").read_text("utf-8").lower()
    assert "performance index" in page


def test_without_a_learned_cost_experiments_are_drawn_at_their_number():
    for record, words in ((toy_record(), "learned cost"), (toy_record(learn=False), "experiment")):
        axes = knobs(record).axes
        assert axes[0].get_ylabel().startswith(words)
        assert [a.get_title() for a in axes] == [
            f"best {knob['text']}" for knob in theta_view(record.scenario.space, record.best.experiment)
        ]
    tried = axes[0].lines[0]
    assert tried.get_ydata().tolist() == [t.number for t in record.trials]


def test_the_learned_cost_is_never_drawn_below_0():
    record = toy_record()
    assert record.surrogate is not None
    cost = record.surrogate
    # Only the order has a meaning: another zero draws the same picture.
    for zero in (0.0, 5.0):
        drawn = knobs(replace(record, surrogate=lambda thetas, zero=zero: cost(thetas) - zero))
        lowest = [float(np.min(line.get_ydata())) for line in drawn.axes[0].lines]
        assert min(lowest) >= 0
        assert max(lowest) < 2


def test_kpis_over_the_experiments_follow_the_best_so_far():
    record = replace(toy_record(), judged=False)
    drawn = course(record)
    drawn.draw_without_rendering()
    titles = ["settling time $t_{f}$ [h]", "final level [m]", "largest move [%]"]
    assert [axes.get_title() for axes in drawn.axes] == titles
    steps = drawn.axes[0].lines[0]
    held = [t.experiment.kpis["t_f"] for t in record.incumbents]
    np.testing.assert_allclose(steps.get_ydata(), np.clip(held, *drawn.axes[0].get_ylim()))


def test_the_index_that_the_answers_follow_comes_first_with_the_references():
    drawn = course(toy_record()).axes[0]
    assert drawn.get_title() == "performance index (lower is better)"
    labels = [line.get_label() for line in drawn.lines]
    assert {"best so far", *toy_record().references} <= set(labels)


def test_a_csv_without_questions_is_just_the_headings():
    assert comparisons_as_csv(toy_record(stop_after=1)).count("\n") == 1


def test_an_out_that_is_a_file_is_refused(tmp_path):
    (tmp_path / "file").write_text("mine")
    for path in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(SettingsError, match="out must be a folder"):
            folder_for(path)
    assert (tmp_path / "file").read_text() == "mine"


def test_an_out_that_exists_is_taken(tmp_path):
    assert folder_for(tmp_path) == tmp_path
    assert folder_for(tmp_path / "a" / "b").is_dir()


@pytest.mark.parametrize("failed", [(), (0,), (1,), (0, 1)])
def test_a_notebooks_figure_shows_both_runs_on_equal_axes(failed):
    toy = toy_scenario()
    pair = [toy.run(np.array(theta)) for theta in ([0.4, 20, 1.0], [1.0, 8, 5.0])]
    shown = [replace(without_record(e), end=End.FAILED) if k in failed else e for k, e in enumerate(pair)]
    drawn = figure(toy, *shown)
    drawn.draw_without_rendering()
    axes = np.array(drawn.axes).reshape(len(toy.panels), 2)
    for left, right in axes:
        assert left.get_xlim() == right.get_xlim()
        assert left.get_ylim() == right.get_ylim()
    for column, e in enumerate(shown):
        curve = [line for line in axes[0, column].lines if len(line.get_xdata()) == len(e.t)]
        assert bool(curve) == bool(len(e.t))


def test_the_headings_of_a_notebooks_figure_keep_to_their_columns():
    air = Panel("level <h>", title="air temperature", unit="°C", high=230.0, target=200.0, band=2.0)
    toy = replace(toy_scenario(), panels=(air,))
    drawn = figure(toy, toy.run(np.array([0.4, 20, 1.0])), toy.run(np.array([1.0, 8, 5.0])))
    drawn.draw_without_rendering()
    left, right = (axes.title.get_window_extent() for axes in drawn.axes)
    # The left one's own columns end where the right one's begin.
    assert left.x1 < drawn.axes[1].get_window_extent().x0
    assert right.x1 < drawn.get_window_extent().x1


@pytest.mark.parametrize(("name", "shaded"), [("level <h>", True), ("valve", False)])
def test_a_shaded_band_is_named_where_one_is_drawn(name, shaded):
    record = toy_record()
    drawn = draw(replace(record, scenario=replace(record.scenario, panels=(Panel(name),))))
    (caption,) = (each.caption for each in drawn if each.picture.file == "best_trajectory.png")
    assert ("Shaded: the accepted band around a target." in caption) == shaded
    assert caption.endswith("Dashed: limits. A dot ends a run, a cross an interrupted one.")
