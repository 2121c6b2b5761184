"""The room of the CSTR: knobs, controller, index, KPIs and what they are in the paper."""

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from prefcal_env.envs.cstr import START
from prefcal_env.errors import KnobError
from prefcal_env.experiments.experiment import End
from prefcal_env.plants import CSTR
from prefcal_env.preferences.answer import Preference
from prefcal_scenarios import load
from prefcal_scenarios.cases.cstr import compute_kpis, cstr, performance_index
from prefcal_scenarios.scenario import panels_of
from support.short_runs import short_run

PREFERRED, AUTOMATED = (cstr.run(cstr.references[k]) for k in ("paper, preferences", "paper, automated"))
LAZY = cstr.run(np.array([1.5, 4.0, 3.0]))
"""So reluctant to move that it never leaves the start."""
_, T_C_START = CSTR().steady_state_at_concentration(START)


def made_up(C_A: list[float], T_c: list[float], duration: float, end: End):
    """An experiment with these samples, T_c from the initial steady state's on."""
    n = len(T_c)
    t = np.linspace(0, duration, n + 1)
    x = np.column_stack([np.full(n + 1, 350.0), C_A])
    u = np.array(T_c)[:, None]
    return short_run(
        [0.25, 26.0, -1.0],
        t=t,
        x=x,
        u=np.vstack([u, u[-1:]]),
        t_control=t[:-1],
        u_control=u,
        y_ref=np.zeros((n, 2)),
        iterations=np.zeros(n, dtype=int),
        solve_time=np.zeros(n),
        solved=np.ones(n, dtype=bool),
        channels=PREFERRED.channels,
        end=end,
    )


def test_the_room_is_found_by_name():
    assert load("cstr") is cstr
    assert cstr.space.names == ("T_s", "N_p", "log Q_Δu")
    assert [(k.low, k.high) for k in cstr.space] == [(0.25, 1.5), (4, 40), (-5, 3)]


def test_the_index_at_the_papers_tunings_is_that_of_the_design():
    assert performance_index(AUTOMATED) == pytest.approx(0.699, abs=0.01)
    assert performance_index(PREFERRED) == pytest.approx(0.816, abs=0.01)


@pytest.mark.parametrize("experiment", [PREFERRED, AUTOMATED], ids=["preferred", "automated"])
def test_the_papers_tunings_reach_the_target(experiment):
    assert experiment.end is End.SETTLED
    assert experiment.x[-1, 1] == pytest.approx(2.0, abs=0.01)
    assert experiment.u[-1, 0] == pytest.approx(304.4, abs=0.1)
    assert experiment.solved.all()
    assert experiment.kpis["largest_move"] <= 10.0 + 1e-6
    assert experiment.u.min() >= 284.0
    assert experiment.u.max() <= 310.0


def test_the_index_by_hand():
    # moves 4, 3, -1 K: 26/3 K2; ends 0.03 off: half of what is acceptable
    T_c = (T_C_START[0] + np.array([4.0, 7.0, 6.0])).tolist()
    settled = made_up([8.56, 5.0, 3.0, 2.03], T_c, 12.0, End.SETTLED)
    assert performance_index(settled) == pytest.approx(12 / 48 + 26 / 3 / 10 + 0.5)
    late = made_up([8.56, 5.0, 3.0, 2.03], T_c, 48.05, End.TIME_UP)
    assert performance_index(late) == pytest.approx(1.0 + 26 / 3 / 10 + 0.5)


def test_an_interrupted_run_is_worse_than_any_other_and_the_longer_the_better():
    T_c = T_C_START.tolist() * 2
    short = made_up([8.56, 5.0, 3.0], T_c, 12.0, End.UNSAFE)
    long = made_up([8.56, 5.0, 3.0], T_c, 36.0, End.UNSAFE)
    assert performance_index(short) == pytest.approx(1000.75)
    assert performance_index(long) == pytest.approx(1000.25)
    assert performance_index(LAZY) < 1000


def test_kpis_by_hand():
    T_c = (T_C_START[0] + np.array([4.0, 7.0, 6.0])).tolist()
    kpis = compute_kpis(made_up([8.56, 1.9, 2.1, 2.03], T_c, 12.0, End.SETTLED))
    assert kpis["settling_time"] == 12.0
    assert kpis["final_concentration"] == 2.03
    assert kpis["largest_move"] == pytest.approx(4.0)
    assert kpis["mean_square_move"] == pytest.approx(26 / 3)
    assert kpis["peak_temperature"] == 350.0
    assert kpis["undershoot"] == pytest.approx(0.1)
    assert kpis["band_entry"] == 12.0
    assert kpis["unsolved"] == 0.0
    assert set(kpis) == {k.name for k in cstr.kpis}


def test_what_never_happens_is_infinite_and_does_not_meet_its_objective():
    assert LAZY.end is End.TIME_UP
    by_name = {k.name: k for k in cstr.kpis}
    assert LAZY.kpis["settling_time"] == LAZY.kpis["band_entry"] == math.inf
    assert by_name["settling_time"].met(LAZY.kpis["settling_time"]) is False
    assert by_name["final_concentration"].met(LAZY.kpis["final_concentration"]) is False
    assert by_name["final_concentration"].met(AUTOMATED.kpis["final_concentration"]) is True


def test_a_run_is_repeatable_and_independent_of_the_seed():
    theta = cstr.references["paper, automated"]
    assert cstr.run(theta) == cstr.run(theta, seed=5) == AUTOMATED


@settings(max_examples=15, deadline=None)
@given(z=st.tuples(*[st.floats(0, 1)] * 3))
def test_everywhere_in_the_box_an_experiment_has_a_finite_index(z):
    experiment = cstr.run(cstr.space.decode(np.array(z)))
    assert 0 < cstr.cost(experiment) < 1001
    assert np.isfinite(experiment.x).all()


@pytest.mark.parametrize("theta", [[0.2, 26, -1], [0.31, 26.5, -1], [0.31, 26], [0.31, 26, np.nan]])
def test_a_theta_outside_the_box_is_refused(theta):
    for function in (cstr.run, cstr.controller, cstr.settings):
        with pytest.raises(KnobError):
            function(np.array(theta))


def test_the_controller_is_the_papers():
    s = cstr.settings(np.array([0.31, 26.0, -1.79]))
    json.dumps(s)
    assert s["linearization"] == "point"
    assert (s["T_s"], s["N_p"], s["N_u"]) == (0.31, 26, 9)
    assert s["Q_du"] == ((pytest.approx(10**-1.79),),)
    assert s["Q_y"] == ((0.0, 0.0), (0.0, 1.0))
    assert (s["u_min"], s["u_max"]) == ((284.0,), (310.0,))
    assert (s["du_min"], s["du_max"]) == ((-10.0,), (10.0,))
    assert cstr.controller(np.array([0.31, 26.0, -1.79])).T_s == 0.31


@pytest.mark.parametrize(("N_p", "N_u"), [(4, 1), (5, 2), (10, 3), (25, 8), (26, 9), (40, 13)])
def test_the_control_horizon_is_a_third_rounded(N_p, N_u):
    assert cstr.settings(np.array([0.31, N_p, 0.0]))["N_u"] == N_u


def test_the_calibrators_agree_that_a_run_that_stays_put_is_worse():
    for make in cstr.calibrators.values():
        assert make(seed=0).prefer(AUTOMATED, LAZY) is Preference.CHALLENGER
        assert make(seed=0).prefer(LAZY, AUTOMATED) is Preference.INCUMBENT
    synthetic = cstr.calibrators["synthetic"]()
    assert synthetic.prefer(AUTOMATED, PREFERRED) is Preference.CHALLENGER


def test_panels_show_concentration_with_its_band_and_coolant_with_its_limits():
    concentration, coolant, temperature = panels_of(cstr, AUTOMATED)
    assert (concentration.channel.target, concentration.channel.band) == (2.0, 0.06)
    assert (coolant.channel.low, coolant.channel.high) == (284.0, 310.0)
    assert temperature.channel.high == 400.0
    assert np.array_equal(concentration.values(AUTOMATED), AUTOMATED.x[:, 1])
    assert np.array_equal(coolant.values(AUTOMATED), AUTOMATED.u[:, 0])
    assert np.array_equal(temperature.values(AUTOMATED), AUTOMATED.x[:, 0])
