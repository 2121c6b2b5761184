"""Tune the reactor's controller with its score in sight: what GLIS finds without any preference."""

import gymnasium as gym

from prefcal_agents import GLIS

env = gym.make("prefcal_scenarios:prefcal/CSTRTuning-v0")
space = env.unwrapped.space
agent = GLIS(space, n_max=50, seed=0)
scores = []  # performance index of each experiment, which GLIS learns from

env.reset(seed=0)
while not agent.done:
    query = agent.ask()  # it has no incumbent: nothing is compared

    # One step is one whole closed-loop experiment; the action is θ scaled to [-1, 1].
    action = 2 * space.encode(query.challenger.theta) - 1
    _, reward, _, _, info = env.step(action.astype(env.action_space.dtype))
    scores.append(-reward)
    agent.tell(query, scores[-1])
    env.reset()

print("best θ:", space.named(agent.best), "index:", round(min(scores), 3))
