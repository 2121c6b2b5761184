"""The overtaking's own figures: what is on them, in the file, and on the page."""

import json
import re
from base64 import b64decode
from dataclasses import replace
from io import BytesIO
from itertools import pairwise

import numpy as np
import pytest
from PIL import Image
from prefcal_scenarios.cases.overtake.pictures.film import RATE
from prefcal_scenarios.cases.overtake.pictures.moments import moments
from prefcal_scenarios.cases.overtake.pictures.pictures import PICTURES

from prefcal_agents import RandomSearch
from prefcal_env.experiments.experiment import End
from prefcal_env.preferences.answer import Preference
from prefcal_env.preferences.loop import calibrate
from prefcal_scenarios.app.presentation.style import BEST, FIRST, OTHERS
from prefcal_scenarios.app.report.record import Record
from prefcal_scenarios.app.report.write import write_report
from prefcal_scenarios.cases.cstr import cstr
from prefcal_scenarios.cases.overtake import overtake

PAPER = overtake.run(overtake.references["paper, preferences"])
SLUGGISH = overtake.run(np.array([0.5, 0.2, 12.0, 1.0, -1.0]))
FILES = ("comparison.png", "final_run.png", "overtaking.gif")


class Always:
    """A calibrator who gives the same verdict."""

    def __init__(self, verdict):
        self.verdict = verdict

    def prefer(self, challenger, incumbent):
        return self.verdict


def record(first=SLUGGISH, second=PAPER, preference=Preference.CHALLENGER):
    """A study of two experiments, in which the second one is the better or not."""
    runs = iter([first, second])
    agent = RandomSearch(overtake.space, n_init=2, n_max=2, seed=0)
    comparisons = tuple(calibrate(agent, lambda theta: next(runs), Always(preference)))
    held = agent.state.history.incumbents()
    return Record(overtake, "overtake", comparisons, held, n_max=2)


def until(experiment, k):
    """`experiment`, stopped at its instant k."""
    n = int(np.sum(experiment.t_control < experiment.t[k - 1]))
    dense = {f: getattr(experiment, f)[:k] for f in ("t", "x", "u")}
    names = ("t_control", "u_control", "y_ref", "iterations", "solve_time", "solved")
    decided = {f: getattr(experiment, f)[:n] for f in names}
    signals = {name: values[:k] for name, values in experiment.signals.items()}
    return replace(experiment, **dense, **decided, signals=signals, end=End.UNSAFE)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("overtaking")
    write_report(record(), path, PICTURES)
    return path


@pytest.fixture
def _few_frames(monkeypatch):
    """One picture a second: the animation takes most of the time of a report."""
    monkeypatch.setattr("prefcal_scenarios.cases.overtake.pictures.film.RATE", 1)


@pytest.fixture(scope="module")
def page(folder):
    return (folder / "report.html").read_text(encoding="utf-8")


def pixels(image, color, tolerance=24):
    """How many pixels have `color`."""
    rgb = np.array([int(color[i : i + 2], 16) for i in (1, 3, 5)])
    return int(np.sum(np.all(np.abs(np.asarray(image.convert("RGB"), int) - rgb) < tolerance, -1)))


@pytest.mark.parametrize("file", FILES)
def test_a_picture_shows_the_car_and_the_obstacle_and_not_only_them(folder, file):
    with Image.open(folder / file) as image:
        assert pixels(image, BEST) > 200
        assert pixels(image, OTHERS[0]) > 200
        assert 0.2 < pixels(image, "#ffffff") / (image.width * image.height) < 0.95


@pytest.mark.parametrize("file", ["comparison.png", "overtaking.gif"])
def test_the_first_run_is_there_in_its_color(folder, file):
    with Image.open(folder / file) as image:
        assert pixels(image, FIRST) > 200


def test_the_animation_runs_in_real_time_and_moves(folder):
    path = folder / "overtaking.gif"
    with Image.open(path) as image:
        assert image.format == "GIF"
        n = image.n_frames
        assert n == pytest.approx(PAPER.t[-1] * RATE, abs=3)
        frames, seconds = [], 0.0
        for k in range(n):
            image.seek(k)
            seconds += image.info["duration"] / 1000
            frames.append(np.asarray(image.convert("RGB")))
    assert seconds - 2 == pytest.approx(PAPER.t[-1], abs=0.5)  # the last one stays for two
    assert all(np.any(a != b) for a, b in pairwise(frames[:-2]))
    assert path.stat().st_size < 2e6


def test_the_page_holds_a_scrubber_that_needs_no_mouse(page):
    assert re.search(r'<input type="range"[^>]*aria-label="Time in seconds"', page)
    assert '<button type="button" aria-label="Play">' in page
    assert page.count('role="img" aria-label="Top view of the') == 2


def test_without_scripts_the_page_shows_each_run_beside_the_obstacle(page):
    stills = re.findall(r'role="img"[^>]*><img src="data:image/png;base64,([^"]+)"', page)
    assert len(stills) == 2
    for still, color in zip(stills, (BEST, FIRST), strict=True):
        with Image.open(BytesIO(b64decode(still))) as image:
            assert pixels(image, color) > 200
            assert pixels(image, OTHERS[0]) > 200


def test_the_page_asks_nothing_of_anyone(page):
    text = re.sub(r'src="data:image/png;base64,[^"]*"', "", page)
    text = text.replace('href="acceptance.html"', "")  # beside the page, on a click
    assert not re.search(r"https?:|//[a-z]|@import|url\(|fetch\(|import\(|\ssrc=|\shref=", text)


def test_the_embedded_positions_are_those_of_the_experiment(page):
    data = json.loads(re.search(r'<script type="application/json">(.*?)</script>', page)[1])
    rows = np.array(data["runs"][0]["rows"])
    assert rows[:, 1].max() == pytest.approx(PAPER.x[:, 1].max(), abs=0.02)  # y_f, m
    assert rows[-1, 0] == pytest.approx(PAPER.x[-1, 0], abs=0.01)  # x_f, m
    assert rows[0].tolist() == [0, 0, 0, 50, 30, 0, 0]  # km/h; the obstacle starts at (30, 0)


@pytest.mark.usefixtures("_few_frames")
def test_equal_studies_have_equal_pictures(tmp_path):
    for name in "ab":
        (tmp_path / name).mkdir()
        write_report(record(), tmp_path / name, PICTURES)
    for file in (*FILES, "report.html"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()


@pytest.mark.usefixtures("_few_frames")
def test_a_best_run_that_is_the_first_is_shown_once_and_its_comparison_is_removed(tmp_path):
    (tmp_path / "comparison.png").write_bytes(b"of an earlier report")
    write_report(record(preference=Preference.INCUMBENT), tmp_path, PICTURES)
    assert not (tmp_path / "comparison.png").exists()
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert page.count('role="img" aria-label="Top view of the') == 1


@pytest.mark.usefixtures("_few_frames")
def test_a_run_without_an_obstacle_and_one_that_was_stopped_are_drawn_as_well(tmp_path):
    others = {k: v for k, v in PAPER.signals.items() if not k.startswith("obstacle")}
    alone = replace(PAPER, signals=others)
    stopped = until(PAPER, len(PAPER.t) // 2)
    write_report(record(stopped, alone), tmp_path, PICTURES)
    assert {*FILES} <= {p.name for p in tmp_path.iterdir()}


def test_the_five_moments_are_in_order_from_the_begin_until_back_in_the_lane():
    found = moments(PAPER)
    begin, _, beside, _, home = [PAPER.t[m.index] for m in found]
    assert begin == pytest.approx(5.6, abs=0.1)  # the gap of 25.5 m shrinks by 10/3.6 m/s to 10 m
    x_o = PAPER.signals["obstacle_x"][found[2].index]
    assert PAPER.x[found[2].index, 0] == pytest.approx(x_o, abs=0.5)
    assert abs(PAPER.x[found[4].index, 1]) <= 0.1
    assert begin < beside < home


def test_a_run_that_is_stopped_shows_its_end_as_the_last_moment():
    whole = moments(PAPER)
    beside, back = whole[2].index, (whole[3].index + whole[4].index) // 2
    for k, names in ((beside, {""}), (back, {m.name for m in whole[:4]} | {"ends on its way"})):
        found = moments(until(PAPER, k))
        assert found[-1].index == k - 1
        assert {m.name for m in found} == names


def test_a_scenario_without_own_pictures_gets_none():
    assert cstr.pictures is None
    assert overtake.pictures is not None
    assert overtake.pictures() == PICTURES
