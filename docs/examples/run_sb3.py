"""Reinforcement learning on the reactor: as a bandit over θ, or in the place of the controller.

    python run_sb3.py                      # PPO tunes the MPC within exactly 50 experiments
    python run_sb3.py --algorithm SAC      # SAC does
    python run_sb3.py --plant 20000        # PPO learns to control, in 20000 sampling periods

Needs the benchmark with stable-baselines3: pip install './benchmarks[rl]' in a clone of prefcal.
"""

import argparse

import gymnasium as gym
import numpy as np
from stable_baselines3 import PPO, SAC

from prefcal_bench.rl import PPOBandit, SACBandit
from prefcal_env import rollout
from prefcal_env.experiments.experiment import Move
from prefcal_scenarios.cases.cstr import performance_index


def tune(algorithm, n_max):
    """Every experiment is an episode of one step; the reward is minus the score."""
    env = gym.make("prefcal_scenarios:prefcal/CSTRTuning-v0")
    space = env.unwrapped.space
    agent = {"PPO": PPOBandit, "SAC": SACBandit}[algorithm](space, n_max=n_max, seed=0)
    scores = []  # performance index of each experiment, which the agent learns from

    env.reset(seed=0)
    while not agent.done:
        query = agent.ask()

        # One step is one whole closed-loop experiment; the action is θ scaled to [-1, 1].
        action = 2 * space.encode(query.challenger.theta) - 1
        _, reward, *_ = env.step(action.astype(env.action_space.dtype))
        scores.append(-reward)
        agent.tell(query, scores[-1])
        env.reset()

    index = round(min(scores), 3)
    print(f"best θ of {len(scores)}:", space.named(agent.best), "index:", index)


class Policy:
    """A learned policy as a controller: it sees only the observation of the plant environment."""

    def __init__(self, model, env):
        self.model, self.plant, self.T_s = model, env.unwrapped, env.unwrapped.T_s

    def move(self, measurement):
        action, _ = self.model.predict(self.plant.observe(), deterministic=True)
        return Move(self.plant.inputs(action))


def control(algorithm, steps):
    """No MPC and no θ: the action is the coolant temperature, a step is a sampling period."""
    env = gym.make("prefcal_env:prefcal/CSTR-v0")
    # By default, most actions of PPO exceed the limits of the input.
    ppo = {"n_steps": 1000, "batch_size": 100, "policy_kwargs": {"log_std_init": -1.0}}
    sac = {"learning_starts": 1000, "learning_rate": 1e-3, "train_freq": 2}
    kind, options = {"PPO": (PPO, ppo), "SAC": (SAC, sac)}[algorithm]
    model = kind("MlpPolicy", env, gamma=0.98, seed=0, device="cpu", **options)
    for name, count in (("untrained", 0), ("trained", steps)):
        if count:
            model.learn(count)
        # Driven by the policy, an episode is an experiment as any other.
        experiment = rollout(env, Policy(model, env), theta=np.zeros(1))
        index = round(performance_index(experiment), 3)
        ended = f"{experiment.end.value} after {experiment.duration:g} h"
        print(f"{name}, {model.num_timesteps} steps: {ended}, index: {index}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--algorithm", choices=["PPO", "SAC"], default="PPO")
    parser.add_argument("--n-max", type=int, default=50, help="experiments")
    parser.add_argument("--plant", type=int, metavar="STEPS", help="learn to control instead")
    options = parser.parse_args()
    run, count = (tune, options.n_max) if options.plant is None else (control, options.plant)
    run(options.algorithm, count)
