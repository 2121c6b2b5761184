"""Provide reinforcement learning with stable-baselines3, which the extra `rl` installs.

As agents, `PPOBandit` and `SACBandit` tune a controller within a budget of experiments. On the
plant, `train_on_plant` learns the control law itself.
"""

from .plant import Evaluation as Evaluation
from .plant import evaluate as evaluate
from .plant import train_on_plant as train_on_plant
from .policy import TrainedPolicy as TrainedPolicy
from .ppo_bandit import PPOBandit as PPOBandit
from .sac_bandit import SACBandit as SACBandit
