"""Tune the reactor's controller by preferences: GLISp asks, a synthetic judge compares.

Every agent that learns from preferences has the same methods: `RandomSearch` in place of `GLISp`
shows the bar that it has to clear.
"""

import gymnasium as gym
import numpy as np

from prefcal_agents import GLISp

env = gym.make("prefcal_scenarios:prefcal/CSTRTuning-v0")
space = env.unwrapped.space
agent = GLISp(space, n_max=50, seed=0)
index = {}  # sample number to performance index, which only the synthetic judge sees

env.reset(seed=0)
while not agent.done:
    query = agent.ask()
    challenger, incumbent = query.challenger, query.incumbent

    # One step is one whole closed-loop experiment; the action is θ scaled to [-1, 1].
    action = 2 * space.encode(challenger.theta) - 1
    _, reward, _, _, info = env.step(action.astype(env.action_space.dtype))
    index[challenger.index] = -reward
    env.reset()

    if incumbent is None:
        agent.tell(query, None)
    else:
        agent.tell(query, int(np.sign(index[challenger.index] - index[incumbent.index])))

print("best θ:", space.named(agent.best), "index:", round(min(index.values()), 3))
