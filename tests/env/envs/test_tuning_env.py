"""Tuning as an environment: one step, one experiment; preferences as a reward."""

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from prefcal_env.calibrators import LatentCost
from prefcal_env.envs.tuning_env import PreferenceReward, TuningEnv
from prefcal_env.errors import ExperimentError, KnobError, PreferenceError, ProtocolError, SettingsError
from prefcal_env.knobs import Knob, KnobSpace
from support.short_runs import final_level, short_run

SPACE = KnobSpace([Knob("gain", 0.01, 100.0, scale="log10"), Knob("steps", 1, 9, integer=True)])


def run(theta, seed=0):
    return short_run(theta, value=theta[1], kpis={"seed": float(seed)})


def tuning(**changes) -> TuningEnv:
    return TuningEnv(SPACE, run, **{"score": final_level} | changes)


def test_a_step_is_one_experiment_and_one_episode():
    env = tuning()
    observation, info = env.reset()
    assert observation.tolist() == [0.0, 0.0]
    assert info == {}
    assert env.unwrapped.space is SPACE
    observation, reward, terminated, truncated, info = env.step(np.array([0.0, 0.1]))
    assert info["theta"] == pytest.approx([1.0, 5.0])
    assert info["experiment"] == run(info["theta"])
    assert reward == -5.0
    assert (terminated, truncated) == (True, False)
    assert observation == pytest.approx([0.0, 0.0], abs=1e-7)  # snapped: 5 of 1 ... 9


def test_without_a_score_the_reward_is_nothing():
    env = tuning(score=None)
    env.reset()
    assert str(env.step(np.zeros(2))[1]) == "0.0"


@settings(max_examples=50, deadline=None)
@given(z=st.tuples(st.floats(0, 1), st.floats(0, 1)))
def test_the_action_of_a_theta_runs_that_theta(z):
    theta = SPACE.decode(np.array(z))
    found = tuning().theta(2 * SPACE.encode(theta) - 1)
    assert found == pytest.approx(theta, rel=1e-12)


def test_every_experiment_gets_the_seed_of_the_last_seeded_reset():
    env, seeds = tuning(), []
    for seed in (None, 7, None, 3, None):
        env.reset(seed=seed)
        seeds.append(env.step(np.zeros(2))[4]["experiment"].kpis["seed"])
    assert seeds == [0, 7, 7, 3, 3]


def test_a_theta_runs_without_a_step_under_the_seed_of_the_environment():
    env = tuning()
    env.reset(seed=7)
    assert env.run(np.array([1.0, 5.0])) == run(np.array([1.0, 5.0]), seed=7)
    env.step(np.zeros(2))  # the episode is still open
    with pytest.raises(KnobError, match="steps"):
        env.run(np.array([1.0, 5.5]))
    with pytest.raises(ExperimentError, match="must return an Experiment"):
        TuningEnv(SPACE, lambda theta, seed: None).run(np.array([1.0, 5.0]))


@pytest.mark.parametrize("action", [[0.0], [0.0, 1.1], [np.nan, 0.0], "ab", [[0.0, 0.0]], None])
def test_bad_actions_are_refused(action):
    env = tuning()
    env.reset()
    with pytest.raises(KnobError, match=r"an action must be (2 numbers in \[-1, 1\]|numbers)"):
        env.step(action)


def test_a_second_step_is_refused():
    env = tuning()
    with pytest.raises(ProtocolError, match="reset"):
        env.step(np.zeros(2))
    env.reset()
    env.step(np.zeros(2))
    with pytest.raises(ProtocolError, match="one experiment"):
        env.step(np.zeros(2))


@pytest.mark.parametrize("score", [np.nan, np.inf])
def test_a_score_that_is_not_finite_is_refused(score):
    env = tuning(score=lambda e: score)
    env.reset()
    with pytest.raises(ExperimentError, match="score must be finite"):
        env.step(np.zeros(2))


def test_options_are_refused():
    with pytest.raises(SettingsError, match="no reset options"):
        tuning().reset(options={"theta": [1.0, 2.0]})
    with pytest.raises(SettingsError, match="KnobSpace"):
        TuningEnv([], run)
    with pytest.raises(SettingsError, match="got 'human'"):
        tuning(render_mode="human")


def test_vector_environments_waste_no_step():
    env = gym.make_vec("prefcal/Experiment-v0", num_envs=2, space=SPACE, run=run, score=final_level)
    env.reset(seed=5)
    for low, high in ((-1.0, 1.0), (1.0, 0.0)):
        _, rewards, terminated, _, infos = env.step(np.array([[0.0, low], [0.0, high]]))
        assert terminated.all()
        assert rewards.tolist() == [-(5 + 4 * low), -(5 + 4 * high)]
        first, second = infos["final_info"]["experiment"]
        assert (first.theta[1], second.theta[1]) == (5 + 4 * low, 5 + 4 * high)
        assert (first.kpis["seed"], second.kpis["seed"]) == (5, 6)
    env.close()


LEVEL = KnobSpace([Knob("level", 0.0, 2.0)])


class Abstains:
    def prefer(self, challenger, incumbent):
        return None


class Mumbles:
    def prefer(self, challenger, incumbent):
        return "the left one"


def judged(calibrator=None) -> PreferenceReward:
    env = TuningEnv(LEVEL, lambda theta, seed: short_run(theta, value=theta[0]))
    return PreferenceReward(env, calibrator or LatentCost(final_level, tie_band=0.05))


def steps(env: PreferenceReward, *actions: float) -> list[tuple]:
    results = []
    for a in actions:
        env.reset()
        observation, reward, _, _, info = env.step(np.array([a]))
        results.append((reward, info.get("preference"), float(observation[0])))
        assert info["incumbent"].theta[0] == pytest.approx(observation[0] + 1)
    return results


def test_better_is_one_worse_is_minus_one_and_a_tie_nothing():
    assert steps(judged(), 0.0, -0.5, 0.5, -0.53125) == [
        (0.0, None, 0.0),  # the first one has nothing to beat
        (1.0, -1, -0.5),
        (-1.0, 1, -0.5),
        (0.0, 0, -0.5),  # within the tie band: the incumbent stays
    ]


def test_an_abstention_is_nothing_and_the_incumbent_stays():
    assert steps(judged(Abstains()), 0.5, -0.5) == [(0.0, None, 0.5), (0.0, None, 0.5)]


def test_a_seed_starts_over_and_no_seed_carries_on():
    env = judged()
    steps(env, -0.5)
    assert env.reset()[0].tolist() == [-0.5]
    assert env.reset(seed=1)[0].tolist() == [0.0]
    assert steps(env, 0.5) == [(0.0, None, 0.5)]


def test_no_calibrator_and_no_answer_are_refused():
    with pytest.raises(SettingsError, match="method prefer, got 3"):
        PreferenceReward(judged().env, 3)
    with pytest.raises(PreferenceError, match="the left one"):
        steps(judged(Mumbles()), 0.0, 0.1)


def test_an_environment_without_experiments_is_refused():
    from support.tank import tank_env

    env = PreferenceReward(tank_env(), Abstains())
    env.reset()
    with pytest.raises(SettingsError, match="info\\['experiment'\\]"):
        env.step(np.zeros(1))
