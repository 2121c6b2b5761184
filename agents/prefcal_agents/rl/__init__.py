"""Reinforcement learning with stable-baselines3: the extra `rl` installs it.

As agents (`PPOBandit`, `SACBandit`) it tunes a controller within a budget of experiments, as the
others do. On the plant (`train_on_plant`) it learns the control law itself.
"""

from .plant import Evaluation as Evaluation
from .plant import evaluate as evaluate
from .plant import train_on_plant as train_on_plant
from .policy import TrainedPolicy as TrainedPolicy
from .ppo_bandit import PPOBandit as PPOBandit
from .sac_bandit import SACBandit as SACBandit
