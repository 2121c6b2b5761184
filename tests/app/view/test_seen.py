from dataclasses import replace
from itertools import pairwise

import numpy as np

from prefcal_app.session import Choice
from prefcal_app.view import Seen, now_view
from prefcal_app.view.question import snapped
from prefcal_scenarios.scenario import panels_of
from support.looks import LEVEL, THETA, VALVE, answer, asked, run


def test_axes_cover_every_experiment_so_far_and_only_grow():
    interview, _ = asked()
    seen, axes = Seen(), []
    for choice in (Choice.LEFT, Choice.RIGHT, Choice.LEFT, None):
        axes.append(now_view(interview, seen=seen)["question"]["axes"])
        finished = [interview.past.experiment(i) for i in interview.now().state.finished]
        for i, values in enumerate(([e.x[:, 0] for e in finished], [e.u[:, 0] for e in finished])):
            low, high = axes[-1]["y"][i]
            assert low < min(v.min() for v in values)
            assert max(v.max() for v in values) < high
        if choice is not None:
            answer(interview, choice)
    for before, after in pairwise(axes):
        assert after["x"][0] <= before["x"][0]
        assert after["x"][1] >= before["x"][1]
        for old, new in zip(before["y"], after["y"], strict=True):
            assert new[0] <= old[0]
            assert new[1] >= old[1]


def test_every_experiment_is_looked_at_once(monkeypatch):
    interview, _ = asked(Choice.LEFT)
    read = []
    experiment = interview.past.experiment
    monkeypatch.setattr(interview.past, "experiment", lambda i: (read.append(i), experiment(i))[1])
    seen = Seen().look(interview).look(interview)
    assert sorted(read) == sorted(interview.now().state.finished)
    left = interview.now().question.left.experiment
    panels = panels_of(interview.scenario, left)
    assert seen.drawn(left, panels) is seen.drawn(left, panels)


def test_axes_end_at_whole_steps_so_that_a_little_growth_moves_nothing():
    one = run(THETA)
    longer = replace(one, x=one.x * 1.001)
    assert Seen().frame((LEVEL, VALVE), one) == Seen().frame((LEVEL, VALVE), one, longer)
    nothing = Seen().frame((LEVEL, VALVE))
    assert nothing["x"] == [0.0, 1.0]
    assert all(low < high for low, high in nothing["y"])


def test_the_axis_of_an_input_is_its_whole_range_from_a_twentieth_on():
    one = run(THETA)
    small, larger = (replace(one, u=np.linspace(4.0, 4.0 + w, len(one.t))[:, None]) for w in (0.4, 0.6))
    low, high = Seen().frame((VALVE,), small)["y"][0]  # of 0 to 10 %
    assert low > 3
    assert high < 6
    low, high = Seen().frame((VALVE,), larger)["y"][0]
    assert low < 0
    assert high > 10


def test_no_further_run_takes_any_of_an_axis_away():
    one = run(THETA)
    runs = [replace(one, x=np.full_like(one.x, level)) for level in (1.5, 10.1, 11.5)]
    axes = [Seen().frame((LEVEL,), *runs[:count])["y"][0] for count in range(1, 4)]
    for before, after in pairwise(axes):
        assert after[0] <= before[0]
        assert after[1] >= before[1]


def test_a_range_just_below_a_whole_power_of_ten_has_an_axis():
    assert snapped(0.0, 1.9999999999999998) == (0.0, 2.0)  # its logarithm is rounded up


def test_limits_are_on_the_axes_where_curves_come_near_and_noise_is_not_magnified():
    one = run(THETA)
    still = replace(one, u=np.full_like(one.u, 5.0))
    low, high = Seen().frame((VALVE,), still)["y"][0]
    assert high - low >= 0.1  # a hundredth of 0 to 10 %
    small = replace(one, u=np.linspace(5.0, 5.07, len(one.t))[:, None])
    low, high = Seen().frame((VALVE,), small)["y"][0]
    assert high - low <= 0.2  # on an axis of a tenth of 0 to 10 %, this curve is a flat line
    full = replace(one, u=np.linspace(1.0, 9.0, len(one.t))[:, None])
    low, high = Seen().frame((VALVE,), full)["y"][0]
    assert low < 0
    assert high > 10
