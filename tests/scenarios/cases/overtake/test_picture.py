"""The overtaking's own figure: what is on it, in the file, and on the page."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from prefcal_agents import RandomSearch
from prefcal_app.report.record import StudyRecord
from prefcal_app.report.write import write_report
from prefcal_env.experiments.experiment import End
from prefcal_env.preferences.answer import Preference, calibrate
from prefcal_scenarios import load
from prefcal_scenarios.cases.cstr import cstr
from prefcal_scenarios.cases.overtake import overtake
from prefcal_scenarios.cases.overtake.kpis import moments
from prefcal_scenarios.cases.overtake.picture import PICTURE, ShownDrive, drawn, shown
from prefcal_scenarios.own import joined_source
from prefcal_scenarios.style import BEST, FIRST, OTHERS, style

PAPER = overtake.run(overtake.references["paper, preferences"])
SLUGGISH = overtake.run(np.array([0.5, 0.2, 12.0, 1.0, -1.0]))
FILE = "overtaking.png"


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
    return StudyRecord(overtake, "overtake", comparisons, held, n_max=2)


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
    write_report(record(), path, [PICTURE])
    return path


def pixels(image, color, tolerance=24):
    """How many pixels have `color`."""
    rgb = np.array([int(color[i : i + 2], 16) for i in (1, 3, 5)])
    return int(np.sum(np.all(np.abs(np.asarray(image.convert("RGB"), int) - rgb) < tolerance, -1)))


def test_the_picture_shows_both_runs_and_the_obstacle_and_not_only_them(folder):
    with Image.open(folder / FILE) as image:
        for color in (BEST, FIRST, OTHERS[0]):
            assert pixels(image, color) > 200
        assert 0.2 < pixels(image, "#ffffff") / (image.width * image.height) < 0.95


def test_a_best_run_that_is_the_first_is_shown_once():
    once = record(preference=Preference.INCUMBENT)
    assert len(shown(once)) == 1
    assert len(shown(record())) == 2
    assert "beside" not in PICTURE.alt(once).partition("Best:")[0]
    with style():
        assert len(PICTURE.draw(once).axes) == 3
        assert len(PICTURE.draw(record()).axes) == 6


def test_a_run_without_an_obstacle_and_one_that_was_stopped_are_drawn_as_well(tmp_path):
    others = {k: v for k, v in PAPER.signals.items() if not k.startswith("obstacle")}
    alone = replace(PAPER, signals=others)
    stopped = until(PAPER, len(PAPER.t) // 2)
    write_report(record(stopped, alone), tmp_path, [PICTURE])
    assert (tmp_path / FILE).is_file()


def test_the_road_is_as_wide_as_that_of_the_run():
    wide = load(joined_source("overtake", {"lanes_count": 3})).run(PAPER.theta)
    with style():
        path, *_ = drawn((ShownDrive(wide, "wide", BEST),), overtake.space).axes
    assert path.get_ylim() == pytest.approx((-2, 10), abs=1)


def test_a_scenario_without_own_pictures_gets_none():
    assert cstr.pictures is None
    assert overtake.pictures is not None
    assert overtake.pictures() == (PICTURE,)


def test_the_five_moments_are_spaced_from_the_begin_until_back_in_the_lane():
    found = moments(PAPER)
    begin, *_, home = PAPER.t[found]
    assert begin == pytest.approx(5.6, abs=0.1)  # the gap of 25.5 m shrinks by 10/3.6 m/s to 10 m
    assert abs(PAPER.x[found[4], 1]) <= 0.1 < PAPER.x[found[4] - 9, 1]
    assert np.diff(PAPER.t[found]) == pytest.approx((home - begin) / 4, abs=0.02)
    cut = moments(until(PAPER, found[2]))
    assert (cut[0], cut[-1]) == (found[0], found[2] - 1)
