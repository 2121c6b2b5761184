"""Panels find their curve by the name of a channel, and say what there is if they do not."""

from dataclasses import replace

import numpy as np
import pytest

from prefcal_env import Channel, Channels, End, Experiment
from prefcal_env.errors import ScenarioError
from prefcal_env.experiments.panels import Panel, plots_of

BALL = Channel("ball", "m", symbol="p")
BEAM = Channel("beam", "rad")
MOTOR = Channel("motor", "V", low=-12.0, high=12.0)
Y0 = Channel("y0", "%", target=1.0, band=0.05)
T = np.arange(4.0)


def run(**changes):
    """A run whose curves all differ: ball 0 to 3, beam 10 to 13, motor 20 to 23, y0 30 to 33."""
    fields = {
        "theta": np.ones(1),
        "t": T,
        "x": np.stack([T, T + 10], axis=1),
        "u": T[:, None] + 20,
        "t_control": T,
        "u_control": T[:, None] + 20,
        "y_ref": np.zeros((4, 2)),
        "iterations": np.zeros(4, int),
        "solve_time": np.zeros(4),
        "solved": np.ones(4, bool),
        "end": End.TIME_UP,
        "signals": {"gap": T + 40},
        "channels": Channels((BALL, BEAM), (MOTOR,), (Channel("ball", "m", target=2.0, band=0.1), Y0)),
        "y": np.stack([T, T + 30], axis=1),
    }
    return Experiment(**fields | changes)


@pytest.mark.parametrize(
    ("panel", "first", "held"),
    [
        (Panel("ball"), 0, False),
        (Panel("beam"), 10, False),
        (Panel("motor"), 20, True),
        (Panel("y0"), 30, False),
        (Panel("gap"), 40, False),
        (Panel("p"), 0, False),
        (Panel("ball", "y"), 0, False),
        (Panel("beam", "x"), 10, False),
    ],
)
def test_a_panel_draws_the_channel_that_it_names(panel, first, held):
    plot = panel.plot(run())
    assert plot.values(run())[0] == first
    assert plot.held == held


def test_a_channel_is_found_anew_in_an_experiment_with_another_order():
    e = run()
    turned = replace(e, x=e.x[:, ::-1], channels=replace(e.channels, x=(BEAM, BALL)), y=None)
    assert Panel("beam").plot(e).values(turned)[0] == 10


def test_an_experiment_that_lacks_the_curve_has_no_values_there():
    bare = replace(run(), y=None, signals={})
    assert np.isnan(Panel("y0").plot(run()).values(bare)).all()
    assert np.isnan(Panel("gap").plot(run()).values(bare)).all()


def test_a_state_that_is_an_output_shows_the_outputs_target():
    channel = Panel("ball").plot(run()).channel
    assert (channel.target, channel.band, channel.symbol) == (2.0, 0.1, "p")


def test_a_panel_states_what_differs_from_its_channel_and_scales_the_rest():
    plot = Panel("motor", title="voltage", unit="mV", scale=1000.0, high=9000.0).plot(run())
    assert plot.channel == Channel("voltage", "mV", low=-12000.0, high=9000.0)
    assert plot.values(run())[0] == 20000.0
    upside_down = Panel("motor", unit="-V", scale=-1.0).plot(run()).channel
    assert (upside_down.low, upside_down.high) == (-12.0, 12.0)


@pytest.mark.parametrize(
    ("panel", "words"),
    [
        (
            Panel("beem"),
            r"there are states 'ball', 'beam'; inputs 'motor'; outputs 'ball', "
            r"'y0'; signals 'gap'\. Did you mean 'beam'\?",
        ),
        (Panel("motor", "x"), "of kind 'x' has this name"),
        (Panel("ball", reference="asked"), r"no signal is called 'asked'.*there are 'gap'"),
        (Panel("motor", low=13.0), "low must be below high"),
    ],
)
def test_a_panel_without_a_curve_says_what_there_is(panel, words):
    with pytest.raises(ScenarioError, match=words):
        panel.plot(run())


def test_a_name_that_means_two_curves_is_refused():
    twice = run(channels=Channels((BALL, BALL), (MOTOR,), ()), y=None, y_ref=np.zeros((4, 0)))
    with pytest.raises(ScenarioError, match="2 curves have this name"):
        Panel("ball").plot(twice)
    assert [p.values(twice)[0] for p in plots_of(twice.channels)] == [0, 10, 20]
    noisy = run(y=run().y + 1.0)
    with pytest.raises(ScenarioError, match="a state and an output have this name, and differ"):
        Panel("ball").plot(noisy)
    assert Panel("ball", "y").plot(noisy).values(noisy)[0] == 1.0


def test_a_state_and_an_output_of_another_unit_need_a_kind():
    e = run()
    degrees = replace(e, channels=replace(e.channels, y=(Channel("beam", "°"), Y0)))
    with pytest.raises(ScenarioError, match="2 curves have this name"):
        Panel("beam").plot(degrees)
    assert Panel("beam", "x").plot(degrees).channel.unit == "rad"
    assert Panel("beam", "y").plot(degrees).channel.unit == "°"


def test_an_output_that_is_not_recorded_is_not_guessed():
    with pytest.raises(ScenarioError, match=r"does not record the output 'y0'.*y="):
        Panel("y0").plot(run(y=None))
    assert Panel("ball", "y").plot(run(y=None)).values(run(y=None))[0] == 0


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Panel("beam", "z"), r"kind must be one of \['x', 'u', 'y', 'signal'\].*got 'z'"),
        (lambda: Panel("beam", "states"), "got 'states'"),
        (lambda: Panel(""), "needs the name"),
        (lambda: Panel("beam", scale=57.3), "give the new one as unit="),
        (lambda: Panel("beam", unit="°", scale=0.0), "scale must be finite and not 0"),
        (lambda: Panel("beam", band=0.0), "band must be above 0"),
    ],
)
def test_an_impossible_panel_is_refused_where_it_is_written(make, words):
    with pytest.raises(ScenarioError, match=words):
        make()


def test_by_default_each_state_input_and_further_output_is_drawn_once():
    plots = plots_of(run().channels)
    assert [(p.kind, p.name) for p in plots] == [("x", "ball"), ("x", "beam"), ("u", "motor"), ("y", "y0")]
